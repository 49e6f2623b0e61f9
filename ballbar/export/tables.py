"""Tables of the identified robot: standard and modified DH, Hayati, product of exponentials; CSV with `#` lines before it.

Every number is written with all its digits. `theta` is the offset added to the joint angle; `tool` rows turn with no joint.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ballbar.export.result import Result, notes
from ballbar.export.rows import Rows, hayati_rows, product_of_exponentials, standard_rows

_TOOL = "Row `tool` has no joint: after row 6 the tool turns about its y by beta."


def dh_table(result: Result) -> str:
    """Standard DH, `Rz(theta + q) Tz(d) Tx(a) Rx(alpha)`."""
    rows = standard_rows(result.chain)
    said = ["Standard DH: T = product over rows of Rz(theta + q) Tz(d) Tx(a) Rx(alpha).", _TOOL]
    if np.any(result.chain.beta[:-1]):
        said.append(
            "The fit has a Hayati angle at joints 2 and 3: their common normal, so d of rows 2 and 3, may lie far away."
        )
    return _written(
        result, said, "joint,a_m,d_m,alpha_rad,theta_rad,beta_rad", _dh_lines(rows, rows.beta)
    )


def hayati_table(result: Result) -> str:
    """Standard DH, joint 2 by Hayati: `Rz(theta + q) Tx(a) Rx(alpha) Ry(beta)`."""
    rows = hayati_rows(result.chain)
    said = [
        "DH with Hayati's row for joint 2, nearly parallel to joint 3: Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta), d = 0.",
        _TOOL,
    ]
    return _written(
        result, said, "joint,a_m,d_m,alpha_rad,theta_rad,beta_rad", _dh_lines(rows, rows.beta)
    )


def modified_dh_table(result: Result) -> str:
    """Modified DH (Craig), `Rx(alpha) Tx(a) Rz(theta + q) Tz(d)`: a, alpha of the row before, theta, d of its own."""
    rows = standard_rows(result.chain)
    a, alpha = (np.concatenate(([0.0], v)) for v in (rows.a, rows.alpha))
    d, theta = (np.concatenate((v, [0.0])) for v in (rows.d, rows.theta))
    beta = np.concatenate((np.zeros(rows.a.size), [rows.tool_beta]))
    said = [
        "Modified DH (Craig): T = product over rows of Rx(alpha) Tx(a) Rz(theta + q) Tz(d).",
        _TOOL.replace("after row 6", "last"),
    ]
    return _written(
        result, said, "joint,a_m,d_m,alpha_rad,theta_rad,beta_rad", _lines(a, d, alpha, theta, beta)
    )


def poe_table(result: Result) -> str:
    """Screw axes in the base frame and the home pose."""
    screws, home = product_of_exponentials(result.chain)
    said = [
        "Product of exponentials, base frame: T = exp([S1] q1) ... exp([S6] q6) M.",
        "Rows 1 to 6: screw axis S = (w, v), v = -w x p in m. Rows M1 to M3: the upper rows of the home pose M, four numbers each.",
    ]
    lines = [_csv(str(i + 1), s) for i, s in enumerate(screws)] + [
        _csv(f"M{i + 1}", home[i]) + ",," for i in range(3)
    ]
    return _written(result, said, "row,w_x,w_y,w_z,v_x_m,v_y_m,v_z_m", lines)


def number(value: float) -> str:
    """All digits of a float64, and no negative zero."""
    return repr(float(value) + 0.0)


def _dh_lines(rows: Rows, beta: Sequence[float] | np.ndarray) -> list[str]:
    last = [0.0]
    columns = (rows.a, rows.d, rows.alpha, rows.theta)
    return _lines(
        *(np.concatenate((c, last)) for c in columns), np.concatenate((beta, [rows.tool_beta]))
    )


def _lines(*columns: np.ndarray) -> list[str]:
    names = [*(str(i + 1) for i in range(len(columns[0]) - 1)), "tool"]
    return [
        _csv(name, values) for name, values in zip(names, np.stack(columns, axis=1), strict=True)
    ]


def _csv(name: str, values: Iterable[float]) -> str:
    return ",".join([name, *(number(v) for v in values)])


def _written(result: Result, said: list[str], header: str, lines: list[str]) -> str:
    return "".join(
        f"{line}\n" for line in [*(f"# {note}" for note in [*said, *notes(result)]), header, *lines]
    )
