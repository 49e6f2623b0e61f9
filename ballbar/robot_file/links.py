"""The polyline of a robot's DH rows: along z by d, then along x by a, from base to flange."""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.chain import Frames, forward
from cell.descriptions import Robot
from cell.geometry import nominal_chain
from cell.robot_angles import controller_to_joints

_BEND = (0.12, -0.1, 0.08)  # share of the axis range, by axis: a pose that shows every row


def frames_at(robot: Robot, axes: Array) -> Frames:
    """Frames of the rows at axis angles (J,) [rad] of the controller; flange last."""
    chain = nominal_chain(robot)
    return forward(chain, controller_to_joints(robot, axes)[None])


def corners(robot: Robot, frames: Frames) -> Array:
    """(2 J + 1, 3) [m] corners of the polyline in the base frame."""
    points = [frames.origin[0, :, 0]]
    for i in range(robot.joints):
        points.append(frames.origin[i, :, 0] + robot.d[i] * frames.z[i, :, 0])
        points.append(frames.origin[i + 1, :, 0])
    return np.array(points)


def bent_pose(robot: Robot) -> Array:
    """(J,) [rad] axis angles within the limits that differ from zero on every axis."""
    span = np.minimum(robot.axis_upper - robot.axis_lower, 2.0 * np.pi)
    shares = np.array([_BEND[i % len(_BEND)] for i in range(robot.joints)])
    zero = np.clip(0.0, robot.axis_lower, robot.axis_upper)
    return np.asarray(np.clip(zero + shares * span, robot.axis_lower, robot.axis_upper))
