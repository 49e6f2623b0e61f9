"""Loads along the minute: what motors and a sensor at the flange show at a known tension."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import cross, joint_screws
from ballbar.cell.geometry import robot_frames
from ballbar.ident.loads.gear_loads import Loads, loads, mass_model, own_weight
from tests.helpers.synthetic_recording import CELL, NOMINAL, exact_log, minute

FRICTION = 1.2, 0.8  # of the catalogue's Coulomb and viscous friction


def tension_at(t: Array) -> Array:
    """(N,) [N] the rod's force that is planted, at t (N,) [s]."""
    return 60.0 * np.sin(0.5 * t) + 20.0


@dataclass(frozen=True, eq=False)
class Motion:
    """The minute at N instants: pose, loads, and how the gears move."""

    t: Array  # (N,) [s]
    q: Array  # (N, 6) [rad]
    b: Array  # (N, 5) [rad]
    carried: Loads
    speed: Array  # (6, N) [rad/s] of the gears
    acceleration: Array  # (6, N) [rad/s^2]

    def torque(self, force: Array, gain: float = 0.0) -> Array:
        """(6, N) [N m] of the motors at the gears' outputs, friction and armature included.

        gain : share by which the true torque is less than the one that is shown.
        """
        gears = CELL.robot.gears
        friction = FRICTION[0] * gears.coulomb[:, None] * np.tanh(self.speed / 1e-4)
        friction = friction + FRICTION[1] * gears.viscous[:, None] * self.speed
        inertia = CELL.robot.armature[:, None] * self.acceleration
        return (self.carried.gears(force) + inertia + friction) / (1.0 - gain)

    def wrench(self, force: Array) -> Array:
        """(6, N) [N, N m] that plate and ball-bar exert on the flange, flange frame.

        From the gears' loads at rest alone: what the arm without plate does not explain, comes
        through the flange (virtual work).
        """
        plate = replace(CELL.plate.body, mass=0.0)
        bare = replace(CELL, plate=replace(CELL.plate, body=plate))
        still = np.zeros_like(self.q)
        held = loads(
            mass_model(CELL), NOMINAL, q=self.q, b=self.b, speed=still, acceleration=still
        ).gears(force)
        through = own_weight(mass_model(bare), NOMINAL, self.q).gear - held  # at the gears
        at_joints = CELL.robot.joint_to_gear @ through
        frames = robot_frames(NOMINAL, self.q)
        axes = np.stack((frames.x[-1], frames.y[-1], frames.z[-1]))
        arm = CELL.plate.length * frames.x[-1] + CELL.plate.tool_offset * frames.z[-1]
        motions = joint_screws(frames)
        for motion in motions:  # of the flange's origin instead of the tool's
            motion[:3] -= cross(motion[3:], arm)
        columns = np.concatenate(
            [np.einsum("ikn,jkn->jin", axes, part) for part in (motions[:, :3], motions[:, 3:])],
            axis=1,
        )
        return np.linalg.solve(columns.transpose(2, 0, 1), at_joints.T[:, :, None])[:, :, 0].T


def motion_at(t: Array) -> Motion:
    path = minute(0.01)
    robot, bar = exact_log(path.t, path.q), exact_log(path.t, path.b)
    q, b, speed = (np.asarray(f(t)) for f in (robot.spline, bar.spline, robot.speed))
    acceleration = np.asarray(robot.spline(t, 2))
    carried = loads(mass_model(CELL), NOMINAL, q=q, b=b, speed=speed, acceleration=acceleration)
    to_gear = CELL.robot.joint_to_gear
    return Motion(t, q, b, carried, (speed @ to_gear).T, (acceleration @ to_gear).T)
