"""Inverse kinematics of a point on the flange: its place is given, its orientation is free.

For an arm of any number of axes, by damped least squares within the axis limits. From starts all
over joint space the solutions have orientations all over the possible ones, which is what the poses
of a ball-bar or a socket need.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.chain import Chain, forward
from cell.descriptions import Robot
from cell.robot_angles import controller_to_joints, joints_to_axes

_ITERATIONS = 60
_CORRECTIONS = 12  # of an arm that differs a little from the chain; each gains two digits
_DAMPING = 0.02  # [m] of the least squares: a hundredth of a usual arm's reach
_LONGEST = 0.3  # [rad] of one step: beyond it the arm is no longer the linear one
Position = Callable[[Array], Array]  # from joint angles (N, J) [rad] to places (N, 3) [m]


def point_columns(chain: Chain, point: Array, q: Array) -> tuple[Array, Array]:
    """Place (N, 3) [m] of a point on the flange, and its derivative (N, 3, J) [m/rad].

    point : (3,) [m] in the flange's frame. q : (N, J) [rad].
    """
    frames = forward(chain, q)
    place = frames.tip.T + np.einsum("ijn,j->ni", frames.rotation(), point)
    arm = place.T[None] - frames.origin[:-1]  # (J, 3, N)
    return place, np.cross(frames.z[:-1], arm, axis=1).transpose(2, 1, 0)


def reach_points(
    robot: Robot,
    chain: Chain,
    *,
    point: Array,
    q: Array,
    wanted: Array,
    lower: Array,
    upper: Array,
    position: Position | None = None,
    tolerance: float = 1e-9,
) -> tuple[Array, NDArray[np.bool_]]:
    """Joint angles that bring a point on the flange to the wanted places.

    chain : DH rows of the arm. point : (3,) [m] in the flange's frame. q : (N, J) [rad] start.
    wanted : (N, 3) [m] in the base frame. lower, upper : (J,) [rad] limits of the axis angles.
    position : place of the point at joint angles, of an arm that differs a little from `chain`; by
        default that of `chain`. tolerance : [m]

    Returns joint angles (N, J) [rad] and which of them reach their place (N,).
    """
    axes = np.clip(joints_to_axes(robot, q), lower, upper)
    if position is not None:  # which takes longer, so that most of the way is the chain's
        nearly, _ = reach_points(
            robot, chain, point=point, q=q, wanted=wanted, lower=lower, upper=upper
        )
        axes = joints_to_axes(robot, nearly)
    reached = np.zeros(len(axes), dtype=bool)
    for _ in range(_ITERATIONS if position is None else _CORRECTIONS):
        (left,) = np.nonzero(~reached)
        if not left.size:
            break
        angles = controller_to_joints(robot, axes[left])
        place, columns = point_columns(chain, point, angles)
        error = wanted[left] - (place if position is None else position(angles))
        reached[left] = np.abs(error).max(axis=1) < tolerance
        columns = columns @ robot.controller_to_joint.T  # per radian of the axes
        step = _within(axes[left], columns, error, lower, upper)
        axes[left] = np.where(reached[left, None], axes[left], axes[left] + step)
        axes = np.clip(axes, lower, upper)
    return controller_to_joints(robot, axes), reached


def _within(axes: Array, columns: Array, error: Array, lower: Array, upper: Array) -> Array:
    """(N, J) [rad] steps; an axis at its limit cannot help, and the others take its part."""
    step = _damped(columns, error)
    stuck = ((axes <= lower) & (step < 0.0)) | ((axes >= upper) & (step > 0.0))
    step = np.where(stuck, 0.0, _damped(columns * ~stuck[:, None], error))
    return np.asarray(step / np.maximum(np.abs(step).max(axis=1, keepdims=True) / _LONGEST, 1.0))


def _damped(columns: Array, error: Array) -> Array:
    """(N, J) least-squares steps for errors (N, 3); less damped the smaller the error."""
    damping = _DAMPING * np.minimum(1.0, 10.0 * np.linalg.norm(error, axis=1))
    square = columns @ columns.transpose(0, 2, 1)
    square += (damping**2 + 1e-12)[:, None, None] * np.eye(3)
    pull = np.linalg.solve(square, error[..., None])[..., 0]
    return np.asarray(np.einsum("ncj,nc->nj", columns, pull))
