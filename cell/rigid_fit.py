"""Nominal tool positions moved onto measured points, to see whether the two belong together.

A target that is fixed to the flange at an unknown point t is measured at

    p_i = R (x_i + F_i t) + o

with the position x_i and rotation F_i of the flange. R and o by Kabsch (1976), t by least squares,
in turn. With det R = -1 the measuring frame is left-handed: an axis has the wrong sign, or two are
swapped.
"""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.chain import Chain, Frames, forward
from cell.descriptions import Robot

_ROUNDS = 60  # of the two steps in turn; each shortens the way to the least squares solution


def nominal_frames(robot: Robot, q: Array) -> Frames:
    """Frames of the catalogue robot at joint angles q (N, J) [rad]; the last is the flange's."""
    return forward(Chain(robot.a, robot.d, robot.alpha, robot.theta, np.zeros(robot.a.size)), q)


def rigid_fit_rms(frames: Frames, points: Array, *, mirrored: bool = False) -> float:
    """[m] root mean square distance of measured points (N, 3) [m] to the nominal ones on them.

    mirrored : the points are those of a left-handed frame.
    """
    position, turns = frames.tip.T, frames.rotation().transpose(2, 0, 1)  # (N, 3), (N, 3, 3)
    centre = points.mean(axis=0)
    tool, rest = np.zeros(3), np.inf
    centred = turns - turns.mean(axis=0)
    for _ in range(_ROUNDS):
        nominal = position + turns @ tool
        nominal -= nominal.mean(axis=0)
        rotation = kabsch(nominal, points - centre, mirrored=mirrored)
        wanted = (points - centre) @ rotation - (position - position.mean(axis=0))
        tool = np.linalg.lstsq(centred.reshape(-1, 3), wanted.ravel(), rcond=1e-9)[0]
        residual = wanted - centred @ tool
        rms = float(np.sqrt((residual * residual).sum(axis=1).mean()))
        if rest - rms < 1e-4 * rms:
            return rms
        rest = rms
    return rest


def kabsch(points: Array, target: Array, *, mirrored: bool = False) -> Array:
    """(3, 3) rotation R with R @ point nearest to its target; both (N, 3) [m] with mean 0.

    mirrored : the best with determinant -1 instead of +1.
    """
    u, _, vt = np.linalg.svd(target.T @ points)
    sign = np.sign(np.linalg.det(u @ vt)) * (-1.0 if mirrored else 1.0)
    return np.asarray(u @ np.diag([1.0, 1.0, sign]) @ vt)
