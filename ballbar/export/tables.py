"""Tables of the identified robot as CSV: standard and modified DH, Hayati, screw axes.

Lines that begin with # stand before the table. Every number is written with all its digits.
`theta` is the offset added to the joint angle; the row `tool` turns with no joint.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ballbar.export.result import AnyResult, PoseResult, Result, notes
from ballbar.export.rows import (
    Rows,
    hayati_rows,
    parallel_rows,
    product_of_exponentials,
    standard_rows,
)
from cell.arrays import Array
from cell.chain import Chain
from cell.foreign_text import comment, one_line

_HEADER = "joint,a_m,d_m,alpha_rad,theta_rad,beta_rad"


def dh_table(result: AnyResult) -> str:
    """Table of standard DH rows, `Rz(theta + q) Tz(d) Tx(a) Rx(alpha)`."""
    chain, dropped = without_negligible_angles(result)
    comments = [
        "Standard DH: T = product over rows of Rz(theta + q) Tz(d) Tx(a) Rx(alpha).",
        _last(result),
        *dropped,
    ]
    return _table(result, comments, _HEADER, _dh_lines(result, standard_rows(chain)))


def hayati_table(result: AnyResult) -> str:
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
    return _table(result, [*comments, _last(result)], _HEADER, _dh_lines(result, rows))


def modified_dh_table(result: AnyResult) -> str:
    """Table of modified DH rows (Craig), `Rx(alpha) Tx(a) Rz(theta + q) Tz(d)`.

    a and alpha are those of the standard row before, theta and d those of the same row.
    """
    chain, dropped = without_negligible_angles(result)
    rows = standard_rows(chain)
    a, alpha = (np.concatenate(([0.0], v)) for v in (rows.a, rows.alpha))
    d, theta = (np.concatenate((v, [0.0])) for v in (rows.d, rows.theta))
    beta = np.concatenate((np.zeros(rows.a.size), [rows.tool_beta]))
    last = _last_row(result)
    if last is None and (a[-1], alpha[-1]) != (0.0, 0.0):
        last = "flange"
    comments = [
        "Modified DH (Craig): T = product over rows of Rx(alpha) Tx(a) Rz(theta + q) Tz(d).",
        _last(result).replace(f"after row {result.robot.joints}", "last"),
        *dropped,
    ]
    return _table(result, comments, _HEADER, _lines(a, d, alpha, theta, beta, last=last))


def without_negligible_angles(result: AnyResult) -> tuple[Chain, list[str]]:
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


def poe_table(result: AnyResult) -> str:
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
    return _table(result, comments, "row,w_x,w_y,w_z,v_x_m,v_y_m,v_z_m", lines)


def number(value: float) -> str:
    """All digits of a float64, and no negative zero."""
    return repr(float(value) + 0.0)


def _last(result: AnyResult) -> str:
    """What the last row of a table is."""
    if isinstance(result, Result):
        last = result.robot.joints
        return f"Row `tool` has no joint: after row {last} the tool turns about its y by beta."
    return f"The last row ends at the flange; the targets on it: {_targets(result)}."


def _targets(result: PoseResult) -> str:
    """Position of every target in the flange's frame, and its rotation vector where known."""
    each = []
    for name, entry in result.calibration.file.targets.items():
        parts = [f"({_triple(entry.position_m)}) m"]
        if entry.rotation_vector_rad is not None:
            parts.append(f"rotation vector ({_triple(entry.rotation_vector_rad)}) rad")
        each.append(f"{one_line(name)} at {', '.join(parts)}")
    return "; ".join(each)


def _triple(values: Iterable[float]) -> str:
    return " ".join(number(v) for v in values)


def _last_row(result: AnyResult) -> str | None:
    """Name of the row without joint at the end of a table: the tool's of logs."""
    return "tool" if isinstance(result, Result) else None


def _dh_lines(result: AnyResult, rows: Rows) -> list[str]:
    columns = (rows.a, rows.d, rows.alpha, rows.theta, rows.beta)
    tool = (0.0, 0.0, 0.0, 0.0, rows.tool_beta)
    both = (np.append(column, last) for column, last in zip(columns, tool, strict=True))
    return _lines(*both, last=_last_row(result))


def _lines(*columns: Array, last: str | None) -> list[str]:
    """CSV lines of columns (J + 1,) [m, rad]; the last row, where named, has no joint."""
    names = [str(i + 1) for i in range(len(columns[0]) - 1)]
    rows = np.stack(columns, axis=1)
    if last is not None:
        names.append(last)
    return [_csv(name, row) for name, row in zip(names, rows, strict=False)]


def _csv(name: str, values: Iterable[float]) -> str:
    return ",".join([name, *(number(v) for v in values)])


def _table(result: AnyResult, comments: list[str], header: str, lines: list[str]) -> str:
    head = [comment("#", text) for text in [*comments, *notes(result)]]
    return "".join(f"{line}\n" for line in [*head, header, *lines])
