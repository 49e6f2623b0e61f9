"""A kinematic chain in other conventions: rows with a Hayati angle become rows of four parameters.

The axis of a joint is a line; where on it the next row begins, and how that row is turned about it,
is convention. So a row `Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)` equals a row of another
convention times `Rz(phi) Tz(e)` along the next axis, and phi and e are added to theta and d of the
next row. Sources: Hayati & Mirmirani 1985; Craig 1989, sec. 3.4 (modified DH); Lynch & Park 2017,
sec. 4.1 (product of exponentials).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.chain import Chain, forward
from cell.errors import InputError

PARALLEL_ROW = 1  # joint 2, whose axis is nearly parallel to the next
_PARALLEL = 1e-6  # [rad] angle of two axes below which their common normal is lost in rounding


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

    Raises InputError where axes are so nearly parallel that their common normal is not defined.
    """
    a, d, alpha, theta, beta, tool_beta = _parts(chain)
    for i in np.flatnonzero(beta):
        rotation, tip = _row(a[i], d[i], alpha[i], theta[i], beta[i])
        a[i], d[i], alpha[i], theta[i], phi, e = _on_common_normal(rotation, tip, theta[i], int(i))
        beta[i] = 0.0
        theta[i + 1] += phi
        d[i + 1] += e
    return Rows(a, d, alpha, theta, beta, tool_beta)


def hayati_rows(chain: Chain) -> Rows:
    """Standard DH rows, but in row 2, of nearly parallel axes, an angle beta replaces d."""
    a, d, alpha, theta, beta, tool_beta = _parts(chain)
    i = PARALLEL_ROW
    rotation, tip = _row(a[i], d[i], alpha[i], theta[i], beta[i])
    axis = rotation[:, 2]
    e = tip[2] / axis[2]
    across = tip - e * axis  # point of the next axis in the plane of this joint
    theta[i] = np.arctan2(across[1], across[0])
    a[i], d[i] = np.hypot(across[0], across[1]), 0.0
    along = _turn_z(theta[i]).T @ axis
    beta[i], alpha[i] = np.arcsin(along[0]), np.arctan2(-along[1], along[2])
    bare, _ = _row(a[i], 0.0, alpha[i], theta[i], beta[i])
    theta[i + 1] += _angle_z(bare.T @ rotation)
    d[i + 1] += e
    return Rows(a, d, alpha, theta, beta, tool_beta)


def product_of_exponentials(chain: Chain) -> tuple[Array, Array]:
    """Screw axes of the joints and home pose, in the base frame.

    Returns screws (J, 6): w [1] and v = -w x p [m]; and the pose (4, 4) [m] at q = 0.
    """
    frames = forward(chain, np.zeros((1, chain.rows)))
    axes, points = frames.z[:-1, :, 0], frames.origin[:-1, :, 0]
    return np.hstack((axes, -np.cross(axes, points))), frames.poses()[0]


def _parts(chain: Chain) -> tuple[Array, Array, Array, Array, Array, float]:
    beta = chain.beta.copy()
    tool_beta, beta[-1] = float(beta[-1]), 0.0
    return chain.a.copy(), chain.d.copy(), chain.alpha.copy(), chain.theta.copy(), beta, tool_beta


def _row(a: float, d: float, alpha: float, theta: float, beta: float) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) [m] of one row at joint angle zero."""
    frames = forward(Chain(*(np.array([v]) for v in (a, d, alpha, theta, beta))), np.zeros((1, 1)))
    return frames.rotation()[:, :, 0], frames.tip[:, 0]


def _on_common_normal(
    rotation: Array, tip: Array, start: float, row: int
) -> tuple[float, float, float, float, float, float]:
    """a, d, alpha, theta of a standard row with the same next axis, and phi, e along that axis.

    rotation (3, 3), tip (3,) [m] : end of the row. Of two solutions that with theta within a
    quarter turn of `start` [rad].
    """
    axis = rotation[:, 2]
    sine = float(np.hypot(axis[0], axis[1]))
    if sine < _PARALLEL:
        raise InputError(
            f"joints {row + 1} and {row + 2} are parallel within {sine:.1g} rad and carry a Hayati "
            "angle: a DH table cannot hold that to rounding. Export with --to hayati."
        )
    theta = float(np.arctan2(axis[0], -axis[1]))
    if np.cos(theta - start) < 0.0:
        theta, sine = theta + np.pi, -sine
    theta = start + float(np.arctan2(np.sin(theta - start), np.cos(theta - start)))
    alpha = float(np.arctan2(sine, axis[2]))
    x, y = _turn_z(theta).T[:2]
    e = -float(tip @ y) / sine
    a, d = float(tip @ x), float(tip[2] - e * axis[2])
    bare, _ = _row(a, d, alpha, theta, 0.0)
    return a, d, alpha, theta, _angle_z(bare.T @ rotation), e


def _turn_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _angle_z(rotation: Array) -> float:
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))
