"""Growth of the robot's long links while it warms up during a recording, in both plants.

Warming is slow: at every instant the machine is at rest with links of that instant's length. The
plant runs with the lengths of the start, and its motion is then corrected for the growth. What
holds the tool decides which coordinates that changes. A ball-bar keeps the tool's pose, to which
the longer arm is turned, joints and motors alike; before a rod or a wire the motors hold, and the
tool moves. The loads are those of the run: 50 um change the rod's force under a soft servo by a few
newtons, since the millimetres of thesis Table 3.1 make 80 N (docs/experiments.md).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cell.arrays import Array
from cell.chain import Frames
from cell.descriptions import Robot
from cell.geometry import robot_frames
from cell.inverse import refine
from sim.errors.plant_errors import ThermalGrowth
from sim.motion import Motion
from sim.plant.effects import PlantEffects
from sim.plant.measured_motion import bar_at

# Of the directions in which the links grow; each gains four digits.
_ROUNDS = 2


def with_growth(motion: Motion, robot: Robot, effects: PlantEffects, *, free: bool) -> Motion:
    """The motion of a robot whose links a2 and d4 grow, from a run in which they do not.

    free : whether nothing holds the tool's pose. The true geometry remains that of t = 0.
    """
    if effects.growth is None:
        return motion
    lengths = growth_of(effects.growth, motion.t)
    frames = robot_frames(motion.geometry, motion.q)
    if free:
        shift = _shift(frames, lengths)
        b, stretch = bar_at(motion.geometry, motion.q, motion.plate, shift)
        return replace(motion, b=b, rod_stretch=stretch, growth=shift)
    q, held = motion.q, frames.poses()
    for _ in range(_ROUNDS):
        shift = _shift(robot_frames(motion.geometry, q), lengths)
        target = held.copy()
        target[:, :3, 3] -= shift
        q = refine(motion.geometry.robot, q, target)
    turned = (q - motion.q) @ robot.joint_to_gear
    outputs = effects.gear_outputs(motion.shown @ robot.joint_to_gear) + turned
    shown = (outputs - effects.transmission_error(outputs)) @ robot.gear_to_joint
    return replace(motion, q=q, shown=shown, growth=shift)


def growth_of(growth: ThermalGrowth, t: Array) -> Array:
    """(2, N) [m] growth of a2 and d4 at times t (N,) [s], of which the last is the end."""
    share = t / t[-1]
    if growth.time_constant_s is not None:
        share = np.expm1(-t / growth.time_constant_s) / np.expm1(-t[-1] / growth.time_constant_s)
    return np.outer((growth.a2_m, growth.d4_m), share)


def _shift(frames: Frames, lengths: Array) -> Array:
    """(N, 3) [m] of the tool: a2 grows along the x axis of its row, d4 along the axis of joint 4.

    lengths : (2, N) [m].
    """
    return np.asarray((frames.x_link[1] * lengths[0] + frames.z[3] * lengths[1]).T)
