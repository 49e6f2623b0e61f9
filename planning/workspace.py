"""Poses over which the TCP error of a plan counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cell.arrays import Array
from cell.descriptions import Robot
from cell.errors import InputError
from ident.robot.accuracy import accuracy_grid
from planning.request import Workspace

ROUNDING = 1e-9  # [deg] of an end of a range that is given in degrees and kept in radians


def workspace_grid(robot: Robot, workspace: Workspace | None) -> Array:
    """(G, J) [rad] DH joint angles over a workspace, by default over the robot's accuracy box.

    Raises InputError for a workspace of another number of axes, or beyond the range of one.
    """
    if workspace is None:
        return accuracy_grid(robot)
    box = np.array((workspace.lower_deg, workspace.upper_deg))
    if box.shape[1] != robot.joints:
        raise InputError(
            f"workspace.lower_deg: {box.shape[1]} values, but {robot.name} has {robot.joints} "
            "axes. Give one for each axis."
        )
    first, last = np.degrees((robot.axis_lower, robot.axis_upper))
    beyond = (box[0] < first - ROUNDING) | (box[1] > last + ROUNDING)
    if beyond.any():
        k = int(beyond.argmax())
        raise InputError(
            f"workspace: axis {k + 1} from {box[0, k]:g} to {box[1, k]:g} deg, but {robot.name} "
            f"moves it from {first[k]:.4g} to {last[k]:.4g} deg. Keep to that."
        )
    lower, upper = np.radians(box)
    return accuracy_grid(replace(robot, accuracy_lower=lower, accuracy_upper=upper))
