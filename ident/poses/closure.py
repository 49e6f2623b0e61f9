"""Loop closure of still poses: the instrument's chain against the robot's, at a target.

The target on the flange is reached through the robot, R(q), and through the instrument from its
seat. As for the ball-bar (ident.estimator.closure) the residual is what the instrument measures
minus what the robot predicts, six signed numbers in base coordinates, and what joints without
sensor can move is eliminated afterwards by `ident.estimator.whitening`. Joints without sensor take
the value that closes the loop as far as it can be closed: a universal joint aims the rod at the
target, a ball joint has the target's orientation. Neither meets a singularity, as three revolute
rows in their place would.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.chain import Frames, cross
from cell.poses import Measured
from cell.rotation import inverse_left_jacobian, matrix_from_rotvec, rotvec_from_matrix


@dataclass(frozen=True, eq=False)
class Placement:
    """A frame that is fixed to another one: a seat to the robot's base, a target to the flange."""

    rotation: Array  # (3, 3)
    origin: Array  # (3,) [m]


@dataclass(frozen=True, eq=False)
class PoseClosure:
    """The loop-closure error of N still poses of one seat and one target."""

    target: Frames  # the robot's, its last frame that of the target
    error: Array  # (6, N) [m, m, m, rad, rad, rad] base frame
    measured: Array  # (3, N) [m] the target as the instrument has it, base frame
    free: Array  # (m, 6, N) change of the error per unit of each joint without sensor


def target_frames(flange: Frames, target: Placement) -> Frames:
    """The robot's frames with that of a target on the flange as the last one."""
    rotation = np.einsum("ikn,kj->ijn", flange.rotation(), target.rotation)
    origin = flange.tip + np.einsum("ikn,k->in", flange.rotation(), target.origin)
    columns = (rotation[:, 0], rotation[:, 1], rotation[:, 2], origin)
    parts = (flange.x, flange.y, flange.z, flange.origin)
    x, y, z, o = (np.concatenate((p, c[None])) for p, c in zip(parts, columns, strict=True))
    return Frames(x, y, z, o, flange.x_link)


def close_pose_loop(
    measured: Measured, values: Array, seat: Placement, target: Frames
) -> PoseClosure:
    """Loop closure of N poses.

    values : (N, M) [m, rad] in the seat's frame, as in cell.poses.PoseGroup. target : frames of the
    robot, `target_frames`.
    """
    n = target.tip.shape[1]
    error, turn = np.zeros((6, n)), np.repeat(np.eye(3)[:, :, None], n, axis=2)
    ball = np.concatenate((np.zeros((3, 3, n)), turn), axis=1)  # (3, 6, N)
    seat_origin = seat.origin[:, None]
    if measured == "length":
        rod = target.tip - seat_origin
        along = rod / np.maximum(np.linalg.norm(rod, axis=0), np.finfo(float).tiny)
        place = seat_origin + values[:, 0] * along
        across = _across(along)
        aim = np.stack([np.concatenate((cross(axis, rod), axis)) for axis in across])
        free = np.concatenate((aim, ball))
    elif measured == "socket":
        place, free = np.repeat(seat_origin, n, axis=1), ball
    else:
        place, free = seat.rotation @ values[:, :3].T + seat_origin, ball
    if measured == "pose":
        free = np.zeros((0, 6, n))
        rotation = np.einsum("ij,jkn->ikn", seat.rotation, matrix_from_rotvec(values[:, 3:].T))
        relative = np.einsum("ikn,jkn->ijn", rotation, target.rotation())
        error[3:] = rotvec_from_matrix(relative)
    error[:3] = place - target.tip
    return PoseClosure(target, error, place, free)


def error_of_target_motion(closure: PoseClosure, motion: Array) -> Array:
    """(..., 6, N) change of the error for a motion of the robot's target frame; in place."""
    motion[..., 3:, :] = inverse_left_jacobian(-closure.error[3:], motion[..., 3:, :])
    return np.negative(motion, out=motion)


def seat_columns(closure: PoseClosure, seat: Placement, *, turns: bool) -> Array:
    """(3 or 6, 6, N) change of the error per shift [m] and turn [rad] of the seat, base axes."""
    n = closure.error.shape[1]
    out = np.zeros((6 if turns else 3, 6, n))
    out[[0, 1, 2], [0, 1, 2]] = 1.0
    if turns:
        arm = closure.measured - seat.origin[:, None]
        for k in range(3):
            axis = np.eye(3)[k][:, None] * np.ones(n)
            out[3 + k, :3] = cross(axis, arm)
            out[3 + k, 3:] = inverse_left_jacobian(closure.error[3:], axis)
    return out


def target_columns(closure: PoseClosure, *, turns: bool) -> Array:
    """(3 or 6, 6, N) change of the error per shift [m] and turn [rad] of the target.

    A shift is along the flange's axes, a turn about those of the target.
    """
    frames, n = closure.target, closure.error.shape[1]
    motion = np.zeros((6 if turns else 3, 6, n))
    motion[:3, :3] = frames.rotation(-2).transpose(1, 0, 2)
    if turns:
        motion[3:, 3:] = frames.rotation(-1).transpose(1, 0, 2)
    return error_of_target_motion(closure, motion)


def _across(along: Array) -> Array:
    """(2, 3, N) unit vectors perpendicular to unit vectors (3, N) and to each other."""
    least = np.eye(3)[np.abs(along).argmin(axis=0)].T
    first = cross(along, least)
    first /= np.linalg.norm(first, axis=0)
    return np.stack((first, cross(along, first)))
