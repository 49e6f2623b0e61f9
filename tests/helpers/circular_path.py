"""Joint angles of a circle that a nominal robot passes there and back."""

from __future__ import annotations

from functools import cache

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import nominal_chain, robot_geometry
from ballbar.cell.load import load_robot
from ballbar.cell.numerical_inverse import in_range
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.identified_kinematics import kinematics

CENTRE, RADIUS = np.array([-0.45, -0.2, 0.3]), 0.12  # [m] of the flange's circle, base frame
FEED = np.linspace(0.0, 2.0 * np.pi, 181)  # [rad] angles of one way


@cache
def circle_angles() -> Array:
    """(N, 6) [rad] of a nominal UR5 whose flange passes a circle of RADIUS there and back."""
    robot = load_robot("ur5")
    nominal = kinematics(IdentifiedRobot(robot, robot_geometry(robot)), nominal_chain(robot))
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (FEED.size, 1, 1))
    poses[:, :3, 3] = CENTRE
    poses[:, 0, 3] += RADIUS * np.cos(FEED)
    poses[:, 1, 3] += RADIUS * np.sin(FEED)
    start = nominal.inverse(poses[:1])
    q = in_range(robot, start.q[int(start.reached[:, 0].argmax())][:, None])[:, 0]
    angles = []
    for pose in poses:
        q = nominal.nearest(pose[None], q).q
        angles.append(q[0])
    there = np.array(angles)
    return np.concatenate((there, there[::-1]))
