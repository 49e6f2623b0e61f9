"""The MuJoCo plant: servos drive the closed mechanism along a reference path, a rollout call for every few seconds.

The servo is proportional with damping and no integral action (SoftServo, thesis sec. 5.3). Its command leads by the
damping's share of the reference speed and, if asked to, carries the weight of the robot, so what is left as rod force comes
from geometric errors and from what gives way. The run starts from rest as found by sim.plant.statics.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout
from scipy.interpolate import CubicSpline

from cell.arrays import Array
from cell.descriptions import Cell, Robot, ServoGains
from cell.errors import FailureError, InputError
from cell.geometry import Geometry
from sim.motion import CLOSURE_STRIDE, Motion, MotionCallback
from sim.path import ReferencePath, axis_range_fault
from sim.plant.effects import PlantEffects
from sim.plant.mjcf import PlantModel, plant_model
from sim.plant.statics import Rest, gravity_torque, rest

CLOSURE_LIMIT = 0.5e-6  # [m, rad] a run above it is no measurement of the mechanism
_GRAVITY_STEP = 0.05  # [s] grid of the gravity feed-forward; the path has no motion above a few Hz
_STRETCH = 2.0  # [s] simulated between two words to who watches
_PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS


class PlantError(FailureError):
    """The simulation did not do what the mechanism would."""


@dataclass(frozen=True, eq=False)
class PlantRun:
    """Everything one rollout needs."""

    plant: PlantModel
    start: Array  # (nstate,) full physics state
    command: Array  # (K, 6) [rad] of the gears; entry k is answered by state k
    timestep: float


def run_plant(
    cell: Cell,
    geometry: Geometry,
    effects: PlantEffects,
    path: ReferencePath,
    *,
    servo: str,
    timestep: float,
    gravity_compensation: bool = True,
    on_motion: MotionCallback | None = None,
) -> Motion:
    """Motion of the true mechanism along a path.

    geometry : true kinematic parameters. servo : a gain set of the robot's description. on_motion : told of the motion as it comes.

    Raises InputError for an unknown gain set; PlantError on divergence, when the loop opens by more than CLOSURE_LIMIT, when
    an axis leaves its range, or when robot or ball-bar flips into another configuration.
    """
    prepared = prepare(
        cell,
        geometry,
        effects,
        path,
        servo=servo,
        timestep=timestep,
        gravity_compensation=gravity_compensation,
    )

    def told(states: Array) -> None:
        plant = prepared.plant
        if on_motion is not None:
            on_motion(
                cell, geometry, states[:, 0], states[:, 1 + plant.joints], states[:, 1 + plant.bar]
            )

    states, sensors = roll_out(prepared, told)
    motion = as_motion(cell, geometry, effects, cell.robot.servo[servo], prepared, states, sensors)
    _check_closure(motion)
    check_course(cell, motion)
    return motion


def prepare(
    cell: Cell,
    geometry: Geometry,
    effects: PlantEffects,
    path: ReferencePath,
    *,
    servo: str,
    timestep: float,
    gravity_compensation: bool,
) -> PlantRun:
    """Model, start and commands of one run."""
    if servo not in cell.robot.servo:
        raise InputError(
            f"plant.servo = {servo!r}: robot {cell.robot.name} has no such gain set; it has {', '.join(cell.robot.servo)}"
        )
    gains = cell.robot.servo[servo]
    t = np.arange(round(path.t[-1] / timestep) + 1) * timestep
    command = _command(cell, geometry, path, t, gains, gravity_compensation=gravity_compensation)
    plant = plant_model(cell, geometry, effects, gains, timestep=timestep)
    held = rest(cell, geometry, effects, gains, command[0], path.q[0], path.b[0])
    return PlantRun(plant, state_at_rest(cell.robot, plant, held), command, timestep)


def _command(
    cell: Cell,
    geometry: Geometry,
    path: ReferencePath,
    t: Array,
    gains: ServoGains,
    *,
    gravity_compensation: bool,
) -> Array:
    """(K, 6) [rad] servo commands at the gears: reference, velocity lead and, if asked for, the robot's weight."""
    joint_to_gear = cell.robot.joint_to_gear
    reference = CubicSpline(path.t, path.q @ joint_to_gear)
    command = reference(t) + gains.kv / gains.kp * reference(t, 1)
    if gravity_compensation:
        coarse = np.append(np.arange(0.0, t[-1], _GRAVITY_STEP), t[-1])
        joints = reference(coarse) @ cell.robot.gear_to_joint
        weight = CubicSpline(
            coarse, gravity_torque(cell, geometry, joints) @ cell.robot.gear_to_joint.T
        )
        command += weight(t) / gains.kp
    return np.asarray(command)


def state_at_rest(robot: Robot, plant: PlantModel, held: Rest) -> Array:
    """(nstate,) full physics state of a mechanism at rest."""
    data = mujoco.MjData(plant.model)
    data.qpos[plant.joints], data.qpos[plant.bar], data.qpos[plant.rod] = (
        held.q,
        held.b,
        held.stretch,
    )
    if plant.rotors.size:
        data.qpos[plant.rotors] = held.motor @ robot.joint_to_gear
    data.qpos[plant.plate] = held.plate
    if plant.base.size:
        data.qpos[plant.base] = held.base
    state = np.zeros(mujoco.mj_stateSize(plant.model, _PHYSICS))
    mujoco.mj_getState(plant.model, data, state, _PHYSICS)
    return state


def roll_out(run: PlantRun, told: Callable[[Array], None] = lambda _: None) -> tuple[Array, Array]:
    """(K, nstate) full physics states, entry k answers command k (entry 0 is the start); (K, nsensor) readings in those states.

    told : of the states of each stretch. Each starts its solver where the one before ended, so the states are those of one call.

    Raises PlantError naming the time of divergence.
    """
    model, stretch = run.plant.model, max(1, round(_STRETCH / run.timestep))
    data, warm = mujoco.MjData(model), np.zeros(model.nv)
    warnings: list[str] = []
    states, sensors = (
        np.empty((len(run.command), run.start.size)),
        np.empty((len(run.command), model.nsensordata)),
    )
    states[0] = run.start
    mujoco.set_mju_user_warning(warnings.append)
    try:
        for first in range(0, len(states) - 1, stretch):
            rows = slice(first + 1, min(first + stretch + 1, len(states)))
            before = slice(
                rows.start - 1, rows.stop - 1
            )  # a step reads its sensors before it moves
            out = {"state": states[None, rows], "sensordata": sensors[None, before]}
            rollout.rollout(
                model,
                data,
                states[None, first],
                run.command[None, rows],
                initial_warmstart=warm[None],
                **out,
            )
            warm = data.qacc_warmstart.copy()
            told(states[first : rows.stop])
    finally:
        mujoco.set_mju_user_warning(None)
    sensors[-1] = sensors[-2]
    time = states[:, 0]
    bad = ~np.isfinite(states).all(axis=1) | (
        np.abs(time - np.arange(len(time)) * run.timestep) > 0.5 * run.timestep
    )
    if bad.any() or warnings:
        k = int(bad.argmax())
        said = f" MuJoCo says: {warnings[0]}" if warnings else ""
        raise PlantError(
            f"simulation diverged at t = {k * run.timestep:.3f} s.{said} A smaller timestep or a softer servo may help."
        )
    return states, sensors


def as_motion(
    cell: Cell,
    geometry: Geometry,
    effects: PlantEffects,
    gains: ServoGains,
    run: PlantRun,
    states: Array,
    sensors: Array,
) -> Motion:
    """What the states mean: joints, shown angles, rod force, servo torques and the flange's load."""
    plant, model = run.plant, run.plant.model
    positions, speeds = (
        states[:, 1 : 1 + model.nq],
        states[:, 1 + model.nq : 1 + model.nq + model.nv],
    )
    q = positions[:, plant.joints]
    rigid = not plant.rotors.size
    outputs, rates = (
        v[:, plant.joints] @ cell.robot.joint_to_gear if rigid else v[:, plant.rotors]
        for v in (positions, speeds)
    )
    shown = outputs - effects.transmission_error(outputs)
    stretch = positions[:, plant.rod]
    strain = stretch - np.clip(stretch, -effects.rod_backlash, effects.rod_backlash)
    return Motion(
        t=np.arange(len(states), dtype=np.float64) * run.timestep,
        q=q,
        shown=shown @ cell.robot.gear_to_joint,
        b=positions[:, plant.bar],
        rod_stretch=stretch,
        rod_force=effects.rod_stiffness * strain,
        geometry=geometry,
        torque=gains.kp * (run.command - shown) - gains.kv * rates,
        wrench=-sensors
        if effects.force_sensor
        else None,  # MuJoCo gives what the flange exerts on the plate
        plate=positions[:, plant.plate[0]] if plant.plate.size else np.zeros(1),
        base=positions[:, plant.base] if plant.base.size else np.zeros((1, 3)),
    )


def _check_closure(motion: Motion) -> None:
    position, angle = motion.closure()
    if position.max() > CLOSURE_LIMIT or angle.max() > CLOSURE_LIMIT:
        k = int(np.argmax(np.maximum(position, angle))) * CLOSURE_STRIDE
        raise PlantError(
            f"not simulated exactly enough: the loop opens to {position.max() * 1e6:.2f} um, {angle.max() * 1e6:.2f} urad at "
            f"t = {motion.t[k]:.2f} s (limit {CLOSURE_LIMIT * 1e6:g} um, urad). Halve plant.timestep_s, or lengthen path.duration_s"
        )


def check_course(cell: Cell, motion: Motion) -> None:
    """The robot stays within its axis ranges, and wrist, gimbal and cardan on their side of the singularity."""
    fault = axis_range_fault(cell.robot, motion.t, motion.q)
    if fault is not None:
        raise PlantError(fault[1])
    for name, angle in (
        ("robot joint q5", motion.q[:, 4]),
        ("ball-bar joint b2", motion.b[:, 1]),
        ("ball-bar joint b4", motion.b[:, 3]),
    ):
        side = np.sin(angle)
        flipped = np.flatnonzero(side * side[0] < 0.0)
        if flipped.size:
            k = int(flipped[0])
            raise PlantError(
                f"{name} passes its singularity at t = {motion.t[k]:.2f} s ({np.degrees(angle[k]):.1f} deg): the configuration flips"
            )
