"""Motor, axis and joint angles of a robot, and the linear maps between them.

Motor angles turn the gears. Axis angles are those that the controller shows, logs and limits. Joint
angles q belong to the DH model. With a parallel rod, axis 3 is the angle of the forearm against the
horizontal, whereas q3 is its angle against the upper arm. Source of the matrices: thesis App. A.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot

MAIN_AXES = 3  # they carry the arm; the axes behind them turn the wrist
_BLOCK = 4096  # rows multiplied at a time: below it OpenBLAS computes in the calling thread


def by_axis(joints: int, *, main: float, wrist: float) -> Array:
    """(J,) one value for each of the main axes 1 to 3, and another for each axis behind them."""
    return np.where(np.arange(joints) < MAIN_AXES, main, wrist)


def motors_to_joints(robot: Robot, motors: ArrayLike) -> Array:
    """Joint angles (N, J) [rad] of motor angles (N, J) [rad].

    One sample (J,) gives (J,). The map is linear, so it also holds for speeds [rad/s].
    """
    return _times(_rows(robot, motors), robot.transmission)


def joints_to_motors(robot: Robot, joints: ArrayLike) -> Array:
    """Motor angles (N, J) [rad] of joint angles (N, J) [rad]; inverse of `motors_to_joints`."""
    return _times(
        _rows(robot, joints), np.asarray(np.linalg.inv(robot.transmission), dtype=np.float64)
    )


def controller_to_joints(robot: Robot, axes: ArrayLike) -> Array:
    """Joint angles (N, J) [rad] of the controller's axis angles (N, J) [rad]; (J,) gives (J,)."""
    return _times(_rows(robot, axes), robot.controller_to_joint) + robot.controller_offset


def joints_to_axes(robot: Robot, joints: ArrayLike) -> Array:
    """Controller's axis angles (N, J) [rad] of joint angles (N, J) [rad].

    Inverse of `controller_to_joints`; the axis limits apply to its result. Speeds have no offset:
    use `speeds @ robot.joint_to_axis` for them.
    """
    axes = _times(_rows(robot, joints), robot.joint_to_axis)
    axes -= robot.controller_offset @ robot.joint_to_axis
    return axes


def gear_to_axis_torques(robot: Robot, torques: ArrayLike) -> Array:
    """Torques (N, J) [N m] at the gears' outputs, positive along the controller's axis angles.

    torques : (N, J) [N m] positive along the gears' angles. Its own inverse: only signs differ, for
    the couplings between the axes come after the gears.
    """
    axis_by_motor = np.diag(robot.transmission @ robot.joint_to_axis)
    signs = np.sign(axis_by_motor) * np.sign(np.diag(robot.transmission))
    return np.asarray(_rows(robot, torques) * signs)


def _rows(robot: Robot, angles: ArrayLike) -> Array:
    rows = np.asarray(angles, dtype=np.float64)
    if rows.ndim == 0 or rows.shape[-1] != robot.joints:
        j = robot.joints
        raise ValueError(f"angles have shape {rows.shape}, expected (N, {j}) or ({j},)")
    return rows


def _times(rows: Array, matrix: Array) -> Array:
    """rows @ matrix by blocks of rows, since BLAS threads of larger products mostly wait."""
    if rows.ndim == 1 or len(rows) <= _BLOCK:
        return np.asarray(rows @ matrix)
    out = np.empty_like(rows)  # keeps the memory layout of the rows
    for begin in range(0, len(rows), _BLOCK):
        np.matmul(rows[begin : begin + _BLOCK], matrix, out=out[begin : begin + _BLOCK])
    return out
