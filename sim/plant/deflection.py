"""Kinematics of the deflected mechanism: bent plate, stretched rod, shifted base."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cell.arrays import Array
from cell.chain import Frames, cross
from cell.geometry import Geometry, bar_frames, robot_frames
from cell.rotation import matrix_from_rotvec


@dataclass(frozen=True, eq=False)
class Deflected:
    """Both ends of the loop at N samples."""

    robot: Frames  # of the rigid robot up to the undeflected tool
    bar: Frames  # with the rod stretched and the base shifted
    tool_rotation: Array  # (3, 3, N)
    tool: Array  # (3, N) [m]
    hinge: Array  # (3, N) [m] where the plate bends


def deflect(
    geometry: Geometry, q: Array, b: Array, *, stretch: Array, plate: Array, base: Array
) -> Deflected:
    """Both ends of the loop of a deflected mechanism.

    q, b : (N, 6), (N, 5) [rad] joint angles. stretch : (N,) [m] elongation of the rod.
    plate : (N,) [rad] bending angle about the plate's y. base : (N, 3) [m] shift of the base.
    """
    robot, rigid = robot_frames(geometry, q), bar_frames(geometry, b)
    origin = rigid.origin + base.T
    origin[3:] += stretch * rigid.z[2]
    bar = replace(rigid, origin=origin)
    rotation, tool, hinge = bent_plate(geometry, robot, plate)
    return Deflected(robot, bar, rotation, tool, hinge)


def bent_plate(geometry: Geometry, robot: Frames, plate: Array) -> tuple[Array, Array, Array]:
    """Rotation (3, 3, N) and position (3, N) [m] of the tool, and the hinge (3, N) [m].

    robot : its frames up to the undeflected tool. plate : (N,) [rad] bending angle about its y.
    """
    hinge = robot.tip - (2.0 / 3.0 * geometry["ra6"]) * robot.x[-1]
    if not plate.any():
        return robot.rotation(), robot.tip, hinge
    bend = matrix_from_rotvec(plate * robot.y[-1])
    tool = hinge + np.einsum("ijn,jn->in", bend, robot.tip - hinge)
    return np.einsum("ijn,jkn->ikn", bend, robot.rotation()), tool, hinge


def turning(axes: Array, points: Array, end: Array) -> Array:
    """(K, 6, N) motion [m/rad, -] of a point `end` for unit turns about K axes.

    axes : (K, 3, N) unit vectors. points : (K, 3, N) [m] on the axes. end : (3, N) [m].
    """
    turns = zip(axes, points, strict=True)
    return np.stack([np.concatenate((cross(axis, end - point), axis)) for axis, point in turns])
