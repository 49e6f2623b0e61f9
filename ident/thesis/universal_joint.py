"""Angles b4, b5 of the universal joint against those of the robot's pose (thesis eq. 2.3).

The gimbal, turned by b1 and b2 as measured, holds the rod's axis w. In the robot's tool frame it is
v = R^T w, and the angles of an ideal universal joint between the two are `-v_x + i v_y =
-sin(b4hat) exp(i b5hat)`, `v_z = cos(b4hat)` (cell.inverse). On which side of zero b4 is, is taken
from its measured value. The thesis speaks of four-quadrant arctangents and a matrix inverse; that
it is the inverse of the gimbal's measured transform is concluded from Table 3.2: only then C_Ptheta
separates bd2 from balpha2, but not ra6 from ba5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.chain import Frames, cross
from cell.geometry import Parameter
from ident.estimator.closure import Closure

GIMBAL_ROWS = 2  # b1 and b2 turn the rod; b3 turns about it
JOINT_ROWS = (3, 4)  # from 0: b4 and b5


@dataclass(frozen=True, eq=False)
class UniversalJointAngles:
    """Measured minus predicted angles of N samples, and what their derivatives need."""

    closure: Closure
    error: Array  # (2, N) [rad] b4 - b4hat, b5 - b5hat, up to whole turns
    axis: Array  # (3, N) w, the rod's axis in the robot's base
    in_tool: Array  # (3, N) v, the same in the robot's tool frame
    side: Array  # (N,) sign of sin(b4)


def universal_joint_angles(closure: Closure) -> UniversalJointAngles:
    """Measured angles b4, b5 minus those of the robot's pose."""
    b4, b5 = (_joint_angle(closure.bar, row) for row in JOINT_ROWS)
    side = np.where(np.sin(b4) < 0.0, -1.0, 1.0)
    axis = closure.bar.z[GIMBAL_ROWS]
    x, y, z = in_tool = _in_last_frame(closure.robot, axis)
    b4hat, b5hat = side * np.arctan2(np.hypot(x, y), z), np.arctan2(-side * y, side * x)
    return UniversalJointAngles(closure, np.stack((b4 - b4hat, b5 - b5hat)), axis, in_tool, side)


def universal_joint_columns(
    angles: UniversalJointAngles, parameter: Parameter, motion: Array
) -> Array:
    """(2, N) change of the error per unit of a parameter.

    motion : (6, N) of the ball-bar's tool frame against the robot's, that of
    cell.geometry.parameter_screw with its sign.
    """
    columns = np.zeros((2, motion.shape[1]))
    if parameter.side == "bar" and parameter.row >= GIMBAL_ROWS:
        if parameter.kind == "theta" and parameter.row in JOINT_ROWS:
            columns[JOINT_ROWS.index(parameter.row)] = 1.0
        return columns
    (x, y, z), (dx, dy, dz) = (
        angles.in_tool,
        _in_last_frame(angles.closure.robot, cross(motion[3:], angles.axis)),
    )
    across = np.hypot(x, y)
    columns[0] = -angles.side * (z * (x * dx + y * dy) / across - across * dz)
    columns[1] = (x * dy - y * dx) / across**2
    return columns


def _joint_angle(frames: Frames, row: int) -> Array:
    """(N,) [rad] by which a joint is turned, zero included."""
    before, after, axis = frames.x[row], frames.x_link[row], frames.z[row]
    return np.asarray(
        np.arctan2((cross(before, after) * axis).sum(axis=0), (before * after).sum(axis=0))
    )


def _in_last_frame(frames: Frames, vector: Array) -> Array:
    """(3, N) components of a vector (3, N) of the base in the last frame."""
    return np.stack(
        [(axis * vector).sum(axis=0) for axis in (frames.x[-1], frames.y[-1], frames.z[-1])]
    )
