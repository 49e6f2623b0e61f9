"""The motion of the mechanism over true time: output of all plants, input of all encoders.

The mechanism is deflected: a bent plate, a stretched rod, a shifted base.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, cross
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, bar_frames, robot_frames
from ballbar.cell.rotation import matrix_from_rotvec, rotvec_from_matrix

# Called with each stretch of the motion once it is simulated: cell, true parameters, times (K,)
# [s], robot angles (K, 6) and ball-bar angles (K, 5) [rad], or with the extension [m] of a rod that
# telescopes (K, 6). A stretch begins where the one before ended.
MotionCallback = Callable[[Cell, Geometry, Array, Array, Array], None]

CLOSURE_STRIDE = 10  # the loop-closure error changes over tenths of seconds, steps last 1 ms


@dataclass(frozen=True, eq=False)
class Motion:
    """One run on a uniform grid of true time; before and after it the mechanism does not move."""

    t: Array  # (K,) [s]
    q: Array  # (K, J) [rad] robot joint angles
    shown: Array  # (K, J) [rad] joint angles that the motors show, without effects of the gears
    b: Array  # (K, 5) [rad] ball-bar joint angles, without encoder offsets and errors
    rod_stretch: Array  # (K,) [m] beyond the true bd3; of a wire too
    rod_force: Array  # (K,) [N] tension positive
    geometry: Geometry  # true parameters; btheta holds the mechanical errors only
    # (K, J) [N m] of the servos at the gears' outputs, in the step that ends at t
    torque: Array | None = None
    # (K, 6) [N, N m] that plate and ball-bar exert on the flange, in its frame, where measured
    wrench: Array | None = None
    # (K,) or (1,) [rad] bending of the offset plate
    plate: Array = field(default_factory=lambda: np.zeros(1))
    # (K, 3) or (1, 3) [m] shift of the ball-bar's base
    base: Array = field(default_factory=lambda: np.zeros((1, 3)))
    # (K, 3) or (1, 3) [m] by which the robot's links, grown since t = 0, carry the tool further
    growth: Array = field(default_factory=lambda: np.zeros((1, 3)))

    def shown_at(self, times: Array) -> Array:
        """(N, J) [rad] joint angles that the motors show at true times (N,) [s]."""
        return self._at(times, self.shown)

    def bar_at(self, times: Array) -> Array:
        """(N, 5) [rad] ball-bar angles at true times (N,) [s]."""
        return self._at(times, self.b)

    def stretch_at(self, times: Array) -> Array:
        """(N,) [m] elongation of the rod at true times (N,) [s]."""
        return self._at(times, self.rod_stretch)

    def tool_at(self, times: Array) -> tuple[Array, Array]:
        """Rotation (3, 3, N) and position (3, N) [m] of the tool at true times (N,) [s].

        In the base frame, with the bending of the plate and the growth of the links.
        """
        joints = self.q.shape[1]
        plate = np.broadcast_to(self.plate, self.t.size)
        growth = np.broadcast_to(self.growth, (self.t.size, 3))
        all_of_them = self._at(times, np.column_stack((self.q, plate, growth)))
        q, bending, shift = np.split(all_of_them, (joints, joints + 1), axis=1)
        frames = robot_frames(self.geometry, q)
        rotation, tool, _ = bent_plate(self.geometry, frames, bending[:, 0])
        return rotation, tool + shift.T

    def _at(self, times: Array, values: Array) -> Array:
        inside = np.clip(times, self.t[0], self.t[-1])
        return np.asarray(CubicSpline(self.t, values)(inside))

    def closure(self) -> tuple[Array, Array]:
        """Loop-closure errors (K / CLOSURE_STRIDE,) [m] and [rad], from the angles by DH alone.

        Elongation of the rod, bending of the plate, shift of the base and growth of the links are
        included. The result does not depend on the plant that made the motion.
        """
        q, b, stretch, plate, base, growth = (
            values[::CLOSURE_STRIDE]
            for values in (self.q, self.b, self.rod_stretch, self.plate, self.base, self.growth)
        )
        ends = deflect(self.geometry, q, b, stretch=stretch, plate=plate, base=base)
        tool = ends.tool + growth.T
        position = np.linalg.norm(ends.bar.tip - tool, axis=0)
        turned = np.einsum("ikn,jkn->ijn", ends.bar.rotation(), ends.tool_rotation)
        return position, np.linalg.norm(rotvec_from_matrix(turned), axis=0)


@dataclass(frozen=True, eq=False)
class Deflected:
    """Both ends of the loop at N samples."""

    robot: Frames  # of the rigid robot up to the undeflected tool
    bar: Frames  # with the rod stretched and the base shifted
    tool_rotation: Array  # (3, 3, N)
    tool: Array  # (3, N) [m]
    hinge: Array  # (3, N) [m] where the plate bends


def deflect(
    geometry: Geometry,
    q: Array,
    b: Array,
    *,
    stretch: Array | float = 0.0,
    plate: Array,
    base: Array | None = None,
) -> Deflected:
    """Both ends of the loop of a deflected mechanism.

    q, b : (N, J), (N, 5) [rad] joint angles. stretch : (N,) [m] elongation of the rod. plate : (N,)
        or (1,) [rad] bending angle about the plate's y. base : (N, 3) or (1, 3) [m] shift of the
        base.
    """
    robot, rigid = robot_frames(geometry, q), bar_frames(geometry, b)
    origin = rigid.origin + (0.0 if base is None else base.T)
    origin[3:] += stretch * rigid.z[2]
    bar = replace(rigid, origin=origin)
    rotation, tool, hinge = bent_plate(geometry, robot, plate)
    return Deflected(robot, bar, rotation, tool, hinge)


def bent_plate(geometry: Geometry, robot: Frames, plate: Array) -> tuple[Array, Array, Array]:
    """Rotation (3, 3, N) and position (3, N) [m] of the tool, and the hinge (3, N) [m].

    robot : its frames up to the undeflected tool. plate : (N,) [rad] bending angle about its y.
    """
    hinge = robot.tip - (2.0 / 3.0 * geometry[geometry.table.plate]) * robot.x[-1]
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
