"""Nominal tool positions moved onto measured points, to see whether the two belong together.

A target that is fixed to the flange at an unknown point t is measured at

    p_i = R (x_i + F_i t) + o

with the position x_i and rotation F_i of the flange. R and o by Kabsch (1976), t by least squares,
in turn. With det R = -1 the measuring frame is left-handed: an axis has the wrong sign, or two are
swapped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, forward
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import nominal_chain

_ROUNDS = 60  # of the two steps in turn; each shortens the way to the least squares solution


def nominal_frames(robot: Robot, q: Array) -> Frames:
    """Frames of the catalogue robot at joint angles q (N, J) [rad]; the last is the flange's."""
    return forward(nominal_chain(robot), q)


@dataclass(frozen=True, eq=False)
class RigidFit:
    """Nominal flange and target moved onto measured points."""

    rotation: Array  # (3, 3) R, from the robot's base to the measuring frame
    rms: float  # [m] root mean square distance that is left
    width: float  # [m] of the points across their longest direction; R is known if it is not 0


def rigid_fit(frames: Frames, points: Array, *, mirrored: bool = False) -> RigidFit:
    """The nominal robot on measured points (N, 3) [m].

    frames : of the robot at N poses. mirrored : the points are those of a left-handed frame.
    """
    position, turns = frames.tip.T, frames.rotation().transpose(2, 0, 1)  # (N, 3), (N, 3, 3)
    position, turns = position - position.mean(axis=0), turns - turns.mean(axis=0)
    points = points - points.mean(axis=0)
    tool, rms, rotation = np.zeros(3), np.inf, np.eye(3)
    for _ in range(_ROUNDS):
        rotation = kabsch(position + turns @ tool, points, mirrored=mirrored)
        wanted = points @ rotation - position
        tool = np.linalg.lstsq(turns.reshape(-1, 3), wanted.ravel(), rcond=1e-9)[0]
        residual = wanted - turns @ tool
        before, rms = rms, float(np.sqrt((residual * residual).sum(axis=1).mean()))
        if before - rms < 1e-4 * rms:
            break
    width = float(np.linalg.svd(points, compute_uv=False)[1] / np.sqrt(len(points)))
    return RigidFit(rotation, rms, width)


def kabsch(points: Array, target: Array, *, mirrored: bool = False) -> Array:
    """(3, 3) rotation R with R @ point nearest to its target; both (N, 3) [m].

    No shift is removed: subtract the means for that.

    mirrored : the best with determinant -1 instead of +1.
    """
    return nearest_rotation(target.T @ points, mirrored=mirrored)


def nearest_rotation(matrix: Array, *, mirrored: bool = False) -> Array:
    """(3, 3) rotation R with the largest trace of `R' matrix` (Kabsch 1976).

    matrix : (3, 3) of any scale, such as a sum of products of two sets of vectors. mirrored : the
    best with determinant -1 instead of +1.
    """
    u, _, vt = np.linalg.svd(matrix)
    sign = np.sign(np.linalg.det(u @ vt)) * (-1.0 if mirrored else 1.0)
    return np.asarray(u @ np.diag([1.0, 1.0, sign]) @ vt)
