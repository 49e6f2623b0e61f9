"""Tables of the identified robot as CSV: standard and modified DH, Hayati, screw axes.

Lines that begin with # stand before the table. Every number is written with all its digits.
`theta` is the offset added to the joint angle; the row `tool` turns with no joint.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ballbar.export.result import Result, notes
from ballbar.export.rows import Rows, hayati_rows, product_of_exponentials, standard_rows
from cell.arrays import Array

_TOOL = "Row `tool` has no joint: after the last row the tool turns about its y by beta."
_HEADER = "joint,a_m,d_m,alpha_rad,theta_rad,beta_rad"


def dh_table(result: Result) -> str:
    """Table of standard DH rows, `Rz(theta + q) Tz(d) Tx(a) Rx(alpha)`."""
    comments = ["Standard DH: T = product over rows of Rz(theta + q) Tz(d) Tx(a) Rx(alpha).", _TOOL]
    if np.any(result.chain.beta[:-1]):
        comments += [
            "The fit has a Hayati angle at nearly parallel axes: their common normal, and with it",
            "d of both rows, may lie far away.",
        ]
    return _table(result, comments, _HEADER, _dh_lines(standard_rows(result.chain)))


def hayati_table(result: Result) -> str:
    """Table of DH rows, parallel axes by Hayati: `Rz(theta + q) Tx(a) Rx(alpha) Ry(beta)`."""
    parallel = result.calibration.geometry.table.hayati_rows[:-1]
    joints = ", ".join(f"{row + 1} (nearly parallel to {row + 2})" for row in parallel)
    comments = [
        f"DH with Hayati's rows for joints: {joints or 'none'}:",
        "Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta), d = 0.",
        _TOOL,
    ]
    return _table(result, comments, _HEADER, _dh_lines(hayati_rows(result.chain, parallel)))


def modified_dh_table(result: Result) -> str:
    """Table of modified DH rows (Craig), `Rx(alpha) Tx(a) Rz(theta + q) Tz(d)`.

    a and alpha are those of the standard row before, theta and d those of the same row.
    """
    rows = standard_rows(result.chain)
    a, alpha = (np.concatenate(([0.0], v)) for v in (rows.a, rows.alpha))
    d, theta = (np.concatenate((v, [0.0])) for v in (rows.d, rows.theta))
    beta = np.concatenate((np.zeros(rows.a.size), [rows.tool_beta]))
    comments = [
        "Modified DH (Craig): T = product over rows of Rx(alpha) Tx(a) Rz(theta + q) Tz(d).",
        _TOOL.replace("after the last row", "last"),
    ]
    return _table(result, comments, _HEADER, _lines(a, d, alpha, theta, beta))


def poe_table(result: Result) -> str:
    """Table of the screw axes in the base frame and the home pose."""
    screws, home = product_of_exponentials(result.chain)
    comments = [
        "Product of exponentials, base frame: T = exp([S1] q1) ... exp([SJ] qJ) M.",
        "Rows 1 to J: screw axis S = (w, v), v = -w x p in m.",
        "Rows M1 to M3: the upper rows of the home pose M, four numbers each.",
    ]
    lines = [_csv(str(i + 1), screw) for i, screw in enumerate(screws)]
    lines += [_csv(f"M{i + 1}", home[i]) + ",," for i in range(3)]
    return _table(result, comments, "row,w_x,w_y,w_z,v_x_m,v_y_m,v_z_m", lines)


def number(value: float) -> str:
    """All digits of a float64, and no negative zero."""
    return repr(float(value) + 0.0)


def _dh_lines(rows: Rows) -> list[str]:
    columns = (rows.a, rows.d, rows.alpha, rows.theta, rows.beta)
    tool = (0.0, 0.0, 0.0, 0.0, rows.tool_beta)
    return _lines(*(np.append(column, last) for column, last in zip(columns, tool, strict=True)))


def _lines(*columns: Array) -> list[str]:
    """CSV lines of columns (J + 1,) [m, rad]; the last row is the tool's."""
    names = [*(str(i + 1) for i in range(len(columns[0]) - 1)), "tool"]
    rows = np.stack(columns, axis=1)
    return [_csv(name, row) for name, row in zip(names, rows, strict=True)]


def _csv(name: str, values: Iterable[float]) -> str:
    return ",".join([name, *(number(v) for v in values)])


def _table(result: Result, comments: list[str], header: str, lines: list[str]) -> str:
    head = [f"# {comment}" for comment in [*comments, *notes(result)]]
    return "".join(f"{line}\n" for line in [*head, header, *lines])
