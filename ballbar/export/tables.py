"""Tables of the identified robot as CSV: standard and modified DH, Hayati, screw axes.

Lines that begin with # stand before the table. Every number is written with all its digits.
`theta` is the offset added to the joint angle; the row `tool` turns with no joint.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain
from ballbar.cell.foreign_text import one_line
from ballbar.export.result import Result, noted_text, numbers
from ballbar.export.rows import (
    Rows,
    hayati_rows,
    parallel_rows,
    product_of_exponentials,
    standard_rows,
)

_HEADER = "joint,a_m,d_m,alpha_rad,theta_rad,beta_rad"


def dh_table(result: Result) -> str:
    """Table of standard DH rows, `Rz(theta + q) Tz(d) Tx(a) Rx(alpha)`."""
    chain, dropped = without_negligible_angles(result)
    comments = [
        "Standard DH: T = product over rows of Rz(theta + q) Tz(d) Tx(a) Rx(alpha).",
        _last(result),
        *dropped,
    ]
    lines = _dh_lines(result, standard_rows(chain))
    return noted_text(result, "#", comments, [_HEADER, *lines])


def hayati_table(result: Result) -> str:
    """Table of standard DH rows, those of nearly parallel axes by Hayati.

    `Rz(theta + q) Tx(a) Rx(alpha) Ry(beta)`.
    """
    parallel = parallel_rows(result.nominal)
    pairs = ", ".join(f"{i + 1} and {i + 2}" for i in parallel)
    comments = ["DH: T = product over rows of Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta)."]
    if parallel:
        comments.append(f"Nearly parallel axes ({pairs}) have Hayati's rows: beta in place of d.")
    else:
        comments.append("No neighbouring axes are parallel: these are the standard rows.")
    rows = hayati_rows(result.chain, parallel)
    lines = _dh_lines(result, rows)
    return noted_text(result, "#", [*comments, _last(result)], [_HEADER, *lines])


def modified_dh_table(result: Result) -> str:
    """Table of modified DH rows (Craig), `Rx(alpha) Tx(a) Rz(theta + q) Tz(d)`.

    a and alpha are those of the standard row before, theta and d those of the same row.
    """
    chain, dropped = without_negligible_angles(result)
    rows = standard_rows(chain)
    a, alpha = (np.concatenate(([0.0], v)) for v in (rows.a, rows.alpha))
    d, theta = (np.concatenate((v, [0.0])) for v in (rows.d, rows.theta))
    beta = np.concatenate((np.zeros(rows.a.size), [rows.tool_beta]))
    last = "tool" if result.calibration.of_logs else None
    if last is None and (a[-1], alpha[-1]) != (0.0, 0.0):
        last = "flange"
    comments = [
        "Modified DH (Craig): T = product over rows of Rx(alpha) Tx(a) Rz(theta + q) Tz(d).",
        _last(result).replace(f"after row {result.robot.joints}", "last"),
        *dropped,
    ]
    lines = _lines(a, d, alpha, theta, beta, last=last)
    return noted_text(result, "#", comments, [_HEADER, *lines])


def without_negligible_angles(result: Result) -> tuple[Chain, list[str]]:
    """The chain without the Hayati angles that stay below their own sigma, and what was dropped."""
    chain, beta, dropped = result.chain, result.chain.beta.copy(), []
    for parameter in result.parameters:
        if parameter.kind != "beta" or parameter.row == chain.rows - 1:
            continue
        sigma, value = result.entry(parameter).sigma, float(beta[parameter.row])
        if value != 0.0 and sigma is not None and abs(value) < sigma:
            beta[parameter.row] = 0.0
            dropped.append(
                f"DROPPED: {parameter.name} = {value!r} rad, below its sigma of {sigma:.2g} rad; "
                "--to hayati has it."
            )
    return replace(chain, beta=beta), dropped


def poe_table(result: Result) -> str:
    """Table of the screw axes in the base frame and the home pose."""
    screws, home = product_of_exponentials(result.chain)
    j = result.robot.joints
    comments = [
        f"Product of exponentials, base frame: T = exp([S1] q1) ... exp([S{j}] q{j}) M.",
        f"Rows 1 to {j}: screw axis S = (w, v), v = -w x p in m.",
        "Rows M1 to M3: the upper rows of the home pose M, four numbers each.",
    ]
    lines = [_csv(str(i + 1), screw) for i, screw in enumerate(screws)]
    lines += [_csv(f"M{i + 1}", home[i]) + ",," for i in range(3)]
    return noted_text(result, "#", comments, ["row,w_x,w_y,w_z,v_x_m,v_y_m,v_z_m", *lines])


def _last(result: Result) -> str:
    """A sentence on the last row of a table; of still poses with the targets on the flange."""
    if result.calibration.of_logs:
        last = result.robot.joints
        return f"Row `tool` has no joint: after row {last} the tool turns about its y by beta."
    targets = []
    for name, entry in result.calibration.file.targets.items():
        text = f"{one_line(name)} at ({numbers(entry.position_m)}) m"
        if entry.rotation_vector_rad is not None:
            text += f", rotation vector ({numbers(entry.rotation_vector_rad)}) rad"
        targets.append(text)
    return f"The last row ends at the flange; the targets on it: {'; '.join(targets)}."


def _dh_lines(result: Result, rows: Rows) -> list[str]:
    columns = (rows.a, rows.d, rows.alpha, rows.theta, rows.beta)
    tool = (0.0, 0.0, 0.0, 0.0, rows.tool_beta)
    both = (np.append(column, last) for column, last in zip(columns, tool, strict=True))
    return _lines(*both, last="tool" if result.calibration.of_logs else None)


def _lines(*columns: Array, last: str | None) -> list[str]:
    """CSV lines of columns (J + 1,) [m, rad]; the last row, where named, has no joint."""
    names = [str(i + 1) for i in range(len(columns[0]) - 1)]
    rows = np.stack(columns, axis=1)
    if last is not None:
        names.append(last)
    return [_csv(name, row) for name, row in zip(names, rows, strict=False)]


def _csv(name: str, values: Iterable[float]) -> str:
    return f"{name},{numbers(values, ',')}"
