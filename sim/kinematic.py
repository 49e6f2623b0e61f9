"""The kinematic plant: the true mechanism follows the path without forces (thesis sec. 3.1, steps 1-4).

The ball-bar takes the path's angles, the robot follows by exact inverse kinematics of its true geometry.
"""

from __future__ import annotations

import numpy as np

from cell.geometry import Geometry, bar_frames
from cell.inverse import refine
from sim.motion import Motion
from sim.path import ReferencePath


def run_kinematic(geometry: Geometry, path: ReferencePath) -> Motion:
    """Motion of a rigid, force-free mechanism. Raises UnreachableError near a singularity of the robot."""
    q = refine(geometry.robot, path.q, bar_frames(geometry, path.b).poses())
    rigid = np.zeros(path.t.size)
    return Motion(path.t, q, path.b, rigid, rigid, geometry)
