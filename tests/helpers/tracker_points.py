"""Points of a drawn robot's tool that a laser tracker measured with the robot at rest."""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.poses import PoseTable
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.sim.truth import Truth
from ballbar.truth.compare import true_tool
from tests.helpers.still_poses import group

POINTS, SIGMA = 12, 15e-6  # [m] of the tracker, along each axis
SHARE = 0.5  # of the ranges of the axes over which the poses are spread


def still_points(cell: Cell, truth: Truth, seed: int, count: int = POINTS) -> PoseTable:
    """Points that a tracker measured of the tool of a true robot, in the frame of its seat."""
    rng, robot = np.random.default_rng([seed, 34]), cell.robot
    middle, half = 0.5 * (robot.axis_upper + robot.axis_lower), 0.5 * SHARE
    axes = middle + half * (robot.axis_upper - robot.axis_lower) * rng.uniform(
        -1.0, 1.0, (count, robot.joints)
    )
    q = axes @ np.asarray(robot.controller_to_joint)
    turn = matrix_from_rotvec(np.array([[0.1], [-0.05], [2.0]]))[:, :, 0]
    seat: Array = np.array([2.5, -1.0, 0.3])
    points = (true_tool(cell, truth, truth.geometry, q) - seat) @ turn
    values, sigma = points + SIGMA * rng.standard_normal(points.shape), np.full(points.shape, SIGMA)
    measured = group("point", "tracker", q, values, sigma, "reflector", "tracker.csv")
    return PoseTable("tracker", robot, (measured,))
