"""A kinematic chain in other conventions: rows with a Hayati angle become rows of four parameters.

The axis of a joint is a line; where on it the next row begins, and how that row is turned about it,
is convention. So a row `Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)` equals a row of another
convention times `Rz(phi) Tz(e)` along the next axis, and phi and e are added to theta and d of the
next row. Sources: Hayati & Mirmirani 1985; Craig 1989, sec. 3.4 (modified DH); Lynch & Park 2017,
sec. 4.1 (product of exponentials).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, forward
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import PARALLEL
from ballbar.cell.number_text import significant_text

_PARALLEL = 1e-6  # [rad] angle of two axes below which their common normal is lost in rounding
# [m] along an axis from the present origin to the common normal: beyond the reach of any arm, d of
# two rows are large numbers that cancel, and a program with seven digits loses the robot
FAR = 5.0


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a table; after the last one the tool turns by `tool_beta` about its y axis."""

    a: Array  # (J,) [m]
    d: Array  # (J,) [m]
    alpha: Array  # (J,) [rad]
    theta: Array  # (J,) [rad]
    beta: Array  # (J,) [rad] of Hayati rows, else 0
    tool_beta: float  # [rad]


def standard_rows(chain: Chain) -> Rows:
    """Standard DH rows of a chain.

    Raises InputError where axes are so nearly parallel that their common normal is not defined or
    far away.
    """
    rows = _rows_of(chain)
    for i in np.flatnonzero(rows.beta):
        _to_common_normal_inplace(rows, int(i))
    return rows


def parallel_rows(nominal: Chain) -> list[int]:
    """Rows, from 0, whose axis is nominally parallel to the next one."""
    return [int(i) for i in np.flatnonzero(np.abs(np.sin(nominal.alpha[:-1])) < PARALLEL)]


def hayati_rows(chain: Chain, parallel: Iterable[int]) -> Rows:
    """Standard DH rows, but in rows of nearly parallel axes an angle beta replaces d.

    parallel : those rows, from 0, `parallel_rows`.
    """
    rows = _rows_of(chain)
    by_beta = sorted(parallel)
    for i in np.flatnonzero(rows.beta).tolist():
        if i not in by_beta:
            _to_common_normal_inplace(rows, i)
    for i in by_beta:
        _to_hayati_inplace(rows, i)
    return rows


def _to_hayati_inplace(rows: Rows, i: int) -> None:
    """Makes row i one of Hayati's with the same next axis, theta within a quarter turn of now."""
    rotation, tip = _end_of(rows, i)
    axis, start = rotation[:, 2], float(rows.theta[i])
    e = float(tip[2] / axis[2])
    across = tip - e * axis  # point of the next axis in the plane of this joint
    length = float(np.hypot(across[0], across[1]))
    if length > 0.0:
        theta = float(np.arctan2(across[1], across[0]))
        if np.cos(theta - start) < 0.0:
            theta, length = theta + np.pi, -length
        rows.theta[i] = start + float(np.arctan2(np.sin(theta - start), np.cos(theta - start)))
    rows.a[i], rows.d[i] = length, 0.0
    along = _turn_z(rows.theta[i]).T @ axis
    rows.beta[i], rows.alpha[i] = np.arcsin(along[0]), np.arctan2(-along[1], along[2])
    _carry_inplace(rows, i, rotation, e)


def product_of_exponentials(chain: Chain) -> tuple[Array, Array]:
    """Screw axes of the joints and home pose, in the base frame.

    Returns screws (J, 6): w [1] and v = -w x p [m]; and the pose (4, 4) [m] at q = 0.
    """
    frames = forward(chain, np.zeros((1, chain.rows)))
    axes, points = frames.z[:-1, :, 0], frames.origin[:-1, :, 0]
    return np.hstack((axes, -np.cross(axes, points))), frames.poses()[0]


def _rows_of(chain: Chain) -> Rows:
    """The rows of a chain as they are, the beta of the last one apart; arrays may be changed."""
    beta = chain.beta.copy()
    tool_beta, beta[-1] = float(beta[-1]), 0.0
    return Rows(
        a=chain.a.copy(),
        d=chain.d.copy(),
        alpha=chain.alpha.copy(),
        theta=chain.theta.copy(),
        beta=beta,
        tool_beta=tool_beta,
    )


def _end_of(rows: Rows, i: int) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) [m] of row i at joint angle zero."""
    row = (v[i : i + 1] for v in (rows.a, rows.d, rows.alpha, rows.theta, rows.beta))
    frames = forward(Chain(*row), np.zeros((1, 1)))
    return frames.rotation()[:, :, 0], frames.tip[:, 0]


def _to_common_normal_inplace(rows: Rows, i: int) -> None:
    """Makes row i a standard one with the same next axis; row i + 1 begins at the common normal.

    Of the two solutions that with theta within a quarter turn of the present one.
    """
    rotation, tip = _end_of(rows, i)
    axis, start = rotation[:, 2], float(rows.theta[i])
    sine = float(np.hypot(axis[0], axis[1]))
    if sine < _PARALLEL:
        raise InputError(
            f"joints {i + 1} and {i + 2} are parallel within {sine:.1g} rad and carry a Hayati "
            "angle: a DH table cannot hold that to rounding. Export with --to hayati."
        )
    theta = float(np.arctan2(axis[0], -axis[1]))
    if np.cos(theta - start) < 0.0:
        theta, sine = theta + np.pi, -sine
    theta = start + float(np.arctan2(np.sin(theta - start), np.cos(theta - start)))
    x, y = _turn_z(theta).T[:2]
    e = -float(tip @ y) / sine
    if abs(e) > FAR:
        angle = significant_text(np.degrees(abs(sine)))
        raise InputError(
            f"joints {i + 1} and {i + 2} are {angle} deg from parallel and carry a Hayati angle "
            f"(rbeta{i + 1}): their common normal lies {abs(e):.0f} m along the axis, which rows "
            "of a DH table would hold as large lengths that cancel. Export with --to hayati."
        )
    rows.a[i], rows.d[i] = tip @ x, tip[2] - e * axis[2]
    rows.alpha[i], rows.theta[i], rows.beta[i] = np.arctan2(sine, axis[2]), theta, 0.0
    _carry_inplace(rows, i, rotation, e)


def _carry_inplace(rows: Rows, i: int, rotation: Array, e: float) -> None:
    """Adds to row i + 1 the turn and the shift along its axis that row i no longer has.

    rotation : (3, 3) end of row i before it was changed. e : [m] shift.
    """
    turn = _end_of(rows, i)[0].T @ rotation
    rows.theta[i + 1] += np.arctan2(turn[1, 0], turn[0, 0])
    rows.d[i + 1] += e


def _turn_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
