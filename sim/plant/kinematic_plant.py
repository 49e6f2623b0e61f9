"""Kinematic plant: the true mechanism follows the path without forces (thesis sec. 3.1, steps 1-4).

The ball-bar takes the path's angles and the robot follows by exact inverse kinematics of its true
geometry. Gears have their harmonic errors; nothing is elastic. An instrument of lengths holds no
angle: it is a massless ball-bar whose rod telescopes, so its angles follow from the tool's pose,
and its rod is as long as tool and seat are apart.

Links that grow while the robot warms up (`with_growth`, both plants): at every instant the machine
is at rest with links of that instant's length. The plant runs with the lengths of the start, and
its motion is then corrected for the growth. A ball-bar keeps the tool's pose, to which the longer
arm is turned, joints and motors together; before a rod or a wire the motors hold, and the tool
moves. The loads are those of the run: 50 um change the rod's force under a soft servo by a few
newtons, since the millimetres of thesis Table 3.1 make 80 N (docs/thesis_figures.md).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, bar_frames, robot_frames
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.inverse import bar_angles, refine
from ballbar.sim.errors.plant_errors import ThermalGrowth
from ballbar.sim.motion import Motion, bent_plate
from ballbar.sim.path import BRANCH, ReferencePath
from ballbar.sim.plant.effects import PlantEffects
from ballbar.sim.settings import SimulationSettings

WITH_FORCES = (
    "joint_compliance", "gear_backlash", "gear_friction", "rod_strain", "rod_backlash",
    "bar_friction", "plate_bending", "base_compliance", "masses", "payload",
)  # fmt: skip
_GROWTH_ROUNDS = 2  # over the directions in which the links grow; each gains four digits


def refuse_forces(settings: SimulationSettings) -> None:
    """Raise InputError when a path, an error source or a log requires forces."""
    stated = ["path.kind = push_pull"] * (settings.needed_path.kind == "push_pull")
    stated += [f"errors.{name}" for name in WITH_FORCES if getattr(settings.errors, name)]
    loads = ("torque", "force_sensor")
    stated += [f"logs.{name}" for name in loads if getattr(settings.logs, name)]
    if stated:
        raise InputError(
            f"{stated[0]}: needs forces, and plant.kind = kinematic has none. "
            "Use plant.kind = mujoco, or leave it out."
        )


def run_kinematic(
    robot: Robot, geometry: Geometry, effects: PlantEffects, path: ReferencePath
) -> Motion:
    """Motion of a rigid mechanism without forces.

    Raises UnreachableError near a singularity of the robot.
    """
    q = refine(geometry.robot, path.q, bar_frames(geometry, path.b).poses())
    gears = q @ robot.joint_to_gear
    shown = (gears - effects.transmission_error(gears)) @ robot.gear_to_joint
    rigid = np.zeros(path.t.size)
    return Motion(
        t=path.t, q=q, shown=shown, b=path.b, rod_stretch=rigid, rod_force=rigid, geometry=geometry
    )


def run_free(
    robot: Robot, geometry: Geometry, effects: PlantEffects, path: ReferencePath
) -> Motion:
    """Motion of a rigid robot whose motors follow a path; nothing holds its tool."""
    q = effects.gear_outputs(path.q @ robot.joint_to_gear) @ robot.gear_to_joint
    b, stretch = bar_at(geometry, q, np.zeros(1))
    return Motion(
        t=path.t,
        q=q,
        shown=path.q,
        b=b,
        rod_stretch=stretch,
        rod_force=np.zeros(path.t.size),
        geometry=geometry,
    )


def bar_at(
    geometry: Geometry, q: Array, plate: Array, shift: Array | float = 0.0
) -> tuple[Array, Array]:
    """Angles (K, 5) [rad] of the bar, and elongation (K,) [m] of its rod beyond bd3.

    q : (K, J) [rad] joint angles. plate : (K,) or (1,) [rad] bending of the offset plate.
    shift : (K, 3) [m] of the tool, or 0.
    """
    rotation, tip, _ = bent_plate(geometry, robot_frames(geometry, q), plate)
    poses, tool = np.zeros((len(q), 4, 4)), tip.T + shift
    poses[:, :3, :3], poses[:, :3, 3] = rotation.transpose(2, 0, 1), tool
    b = np.unwrap(bar_angles(poses, geometry.origin, flipped=BRANCH), axis=0)
    distance = np.linalg.norm(tool - geometry.origin, axis=1)
    return b, np.asarray(distance - geometry["bd3"])


def check_stroke(instrument: Instrument, motion: Motion) -> None:
    """Raises InputError where the length that is read leaves the instrument's range."""
    read = instrument.nominal + motion.rod_stretch
    outside = np.maximum(instrument.lower - read, read - instrument.upper)
    k = int(outside.argmax())
    if outside[k] > 0.0:
        raise InputError(
            f"path: {instrument.name} leaves its range at t = {motion.t[k]:.2f} s: "
            f"{read[k] * 1e3:.3f} mm, outside {instrument.lower * 1e3:g}.."
            f"{instrument.upper * 1e3:g} mm. Shorten `rod` in the path file, take smaller errors "
            "of the robot, or an instrument of a longer stroke."
        )


def with_growth(motion: Motion, robot: Robot, effects: PlantEffects, *, free: bool) -> Motion:
    """The motion of a robot whose links a2 and d4 grow, from a run in which they do not.

    free : whether nothing holds the tool's pose. The true geometry remains that of t = 0.
    """
    if effects.growth is None:
        return motion
    lengths = _growth(effects.growth, motion.t)
    frames = robot_frames(motion.geometry, motion.q)
    if free:
        shift = _shift(frames, lengths)
        b, stretch = bar_at(motion.geometry, motion.q, motion.plate, shift)
        return replace(motion, b=b, rod_stretch=stretch, growth=shift)
    q, held = motion.q, frames.poses()
    for _ in range(_GROWTH_ROUNDS):
        shift = _shift(robot_frames(motion.geometry, q), lengths)
        target = held.copy()
        target[:, :3, 3] -= shift
        q = refine(motion.geometry.robot, q, target)
    turned = (q - motion.q) @ robot.joint_to_gear
    outputs = effects.gear_outputs(motion.shown @ robot.joint_to_gear) + turned
    shown = (outputs - effects.transmission_error(outputs)) @ robot.gear_to_joint
    return replace(motion, q=q, shown=shown, growth=shift)


def _growth(growth: ThermalGrowth, t: Array) -> Array:
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
