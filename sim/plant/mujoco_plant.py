"""MuJoCo plant: servos drive the closed mechanism along a reference path.

The servo is proportional with damping and no integral action (SoftServo, thesis sec. 5.3). Its
command leads by the damping's share of the reference speed and, if chosen, carries the weight of
the robot. What remains as force in the rod then comes from geometric errors and from compliance.
The run starts from the equilibrium that ballbar.sim.plant.statics finds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout
from scipy.interpolate import CubicSpline

from ballbar.cell.arrays import Array
from ballbar.cell.closed_form import has_closed_form
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import FailureError
from ballbar.cell.geometry import nominal_chain
from ballbar.sim.motion import CLOSURE_STRIDE, Motion, MotionCallback
from ballbar.sim.path import ReferencePath, axis_range_fault
from ballbar.sim.plant.effects import Plant
from ballbar.sim.plant.mjcf import PlantModel, plant_model
from ballbar.sim.plant.statics import Equilibrium, equilibrium, gravity_torque

CLOSURE_LIMIT = 0.5e-6  # [m, rad] twice what 60 s with all effects reach (notes/plant sec. 2)
_GRAVITY_STEP = 0.05  # [s] grid of the gravity feed-forward; no path moves at more than a few Hz
_STRETCH = 2.0  # [s] simulated between two calls of a motion callback
PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS


class PlantError(FailureError):
    """The simulation did not do what the mechanism would."""


@dataclass(frozen=True, eq=False)
class PlantRun:
    """Everything that one rollout needs."""

    plant: Plant
    compiled: PlantModel
    start: Array  # (nstate,) full physics state
    command: Array  # (K, J) [rad] of the gears; state k answers entry k
    timestep: float  # [s]


def run_plant(
    plant: Plant,
    path: ReferencePath,
    *,
    timestep: float,
    gravity_compensation: bool = True,
    on_motion: MotionCallback | None = None,
) -> Motion:
    """Motion of the true mechanism along a path.

    timestep : [s]. on_motion : called with each stretch of the motion once it is simulated.

    Raises PlantError on divergence, when the loop opens by more than CLOSURE_LIMIT, when an axis
    leaves its range, or when robot or ball-bar flips into another configuration.
    """
    run = prepare(plant, path, timestep=timestep, gravity_compensation=gravity_compensation)

    def on_states(states: Array) -> None:
        if on_motion is not None:
            q, b = (states[:, 1 + index] for index in (run.compiled.joints, run.compiled.bar))
            on_motion(plant.cell, plant.geometry, states[:, 0], q, b)

    motion = as_motion(run, *roll_out(run, on_states))
    _check_closure(motion)
    check_motion(plant.cell, motion)
    return motion


def prepare(
    plant: Plant, path: ReferencePath, *, timestep: float, gravity_compensation: bool
) -> PlantRun:
    """Model, start and commands of one run; arguments as of `run_plant`."""
    t = np.arange(round(path.t[-1] / timestep) + 1) * timestep
    command = servo_command(plant, path, t, gravity_compensation=gravity_compensation)
    model = plant_model(plant, timestep=timestep)
    held = equilibrium(plant, command[0], path.q[0], path.b[0])
    return PlantRun(plant, model, equilibrium_state(plant, model, held), command, timestep)


def servo_command(
    plant: Plant, path: ReferencePath, t: Array, *, gravity_compensation: bool
) -> Array:
    """(K, J) [rad] servo commands at the gears at times t (K,) [s]."""
    robot, gains = plant.cell.robot, plant.gains
    reference = CubicSpline(path.t, path.q @ robot.joint_to_gear)
    command = reference(t) + gains.kv / gains.kp * reference(t, 1)
    if gravity_compensation:
        coarse = np.append(np.arange(0.0, t[-1], _GRAVITY_STEP), t[-1])
        q = reference(coarse) @ robot.gear_to_joint
        torque = gravity_torque(plant.cell, plant.geometry, q) @ robot.gear_to_joint.T
        command += CubicSpline(coarse, torque)(t) / gains.kp
    return np.asarray(command)


def equilibrium_state(plant: Plant, compiled: PlantModel, held: Equilibrium) -> Array:
    """(nstate,) full physics state of a mechanism at rest in an equilibrium."""
    data = mujoco.MjData(compiled.model)
    data.qpos[compiled.joints], data.qpos[compiled.bar] = held.q, held.b
    data.qpos[compiled.rod] = held.stretch
    if compiled.rotors.size:
        data.qpos[compiled.rotors] = held.motor @ plant.cell.robot.joint_to_gear
    data.qpos[compiled.plate] = held.plate
    if compiled.base.size:
        data.qpos[compiled.base] = held.base
    return full_state(compiled.model, data)


def full_state(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """(nstate,) full physics state of a model."""
    state = np.zeros(mujoco.mj_stateSize(model, PHYSICS))
    mujoco.mj_getState(model, data, state, PHYSICS)
    return state


def roll_out(
    run: PlantRun, on_states: Callable[[Array], None] = lambda _: None
) -> tuple[Array, Array]:
    """Simulate a run.

    on_states : called with the states of each stretch. A stretch starts its solver where the one
        before ended, so the states are those of a single call.

    Returns (K, nstate) full physics states, of which entry 0 is the start, and (K, nsensor)
    readings in those states. Raises PlantError naming the time of divergence.
    """
    model, stretch = run.compiled.model, max(1, round(_STRETCH / run.timestep))
    data, warm = mujoco.MjData(model), np.zeros(model.nv)
    warnings: list[str] = []
    states = np.empty((len(run.command), run.start.size))
    sensors = np.empty((len(run.command), model.nsensordata))
    states[0] = run.start
    mujoco.set_mju_user_warning(warnings.append)
    try:
        for first in range(0, len(states) - 1, stretch):
            rows = slice(first + 1, min(first + stretch + 1, len(states)))
            before = slice(rows.start - 1, rows.stop - 1)  # a step reads sensors before it moves
            rollout.rollout(
                model,
                data,
                states[None, first],
                run.command[None, rows],
                initial_warmstart=warm[None],
                state=states[None, rows],
                sensordata=sensors[None, before],
            )
            warm = data.qacc_warmstart.copy()
            on_states(states[first : rows.stop])
    finally:
        mujoco.set_mju_user_warning(None)
    sensors[-1] = sensors[-2]
    _check_divergence(states, run.timestep, warnings)
    return states, sensors


def _check_divergence(states: Array, timestep: float, warnings: list[str]) -> None:
    late = np.abs(states[:, 0] - np.arange(len(states)) * timestep) > 0.5 * timestep
    bad = ~np.isfinite(states).all(axis=1) | late
    if bad.any() or warnings:
        said = f" MuJoCo says: {warnings[0]}" if warnings else ""
        raise PlantError(
            f"simulation diverged at t = {int(bad.argmax()) * timestep:.3f} s.{said} "
            "A smaller timestep or a softer servo may help."
        )


def as_motion(run: PlantRun, states: Array, sensors: Array) -> Motion:
    """The motion that states (K, nstate) and sensor readings (K, nsensor) of a run describe."""
    effects, compiled = run.plant.effects, run.compiled
    positions = states[:, 1 : 1 + compiled.model.nq]
    shown, torque = servo_motion(run, states)
    stretch = positions[:, compiled.rod[0]]
    strain = stretch - np.clip(stretch, -effects.rod_backlash, effects.rod_backlash)
    return Motion(
        t=np.arange(len(states), dtype=np.float64) * run.timestep,
        q=positions[:, compiled.joints],
        shown=shown,
        b=positions[:, compiled.bar],
        rod_stretch=stretch,
        rod_force=effects.rod_stiffness * strain,
        geometry=run.plant.geometry,
        torque=torque,
        # MuJoCo gives what the flange exerts on the plate.
        wrench=-sensors if effects.force_sensor else None,
        plate=bending(compiled, states),
        base=positions[:, compiled.base] if compiled.base.size else np.zeros((1, 3)),
    )


def bending(compiled: PlantModel, states: Array) -> Array:
    """(K,) or (1,) [rad] bending of the offset plate in states (K, nstate)."""
    return states[:, 1 + compiled.plate[0]] if compiled.plate.size else np.zeros(1)


def servo_motion(run: PlantRun, states: Array) -> tuple[Array, Array]:
    """Joint angles that the motors show (K, J) [rad], and torques (K, J) [N m] of the servos.

    states : (K, nstate) of the run, one for each command.
    """
    effects, gains, robot = run.plant.effects, run.plant.gains, run.plant.cell.robot
    compiled, nq, nv = run.compiled, run.compiled.model.nq, run.compiled.model.nv
    # A speed has the place of its coordinate: hinges and slides come before a rod's ball joint.
    outputs, rates = (
        v[:, compiled.rotors]
        if compiled.rotors.size
        else v[:, compiled.joints] @ robot.joint_to_gear
        for v in (states[:, 1 : 1 + nq], states[:, 1 + nq : 1 + nq + nv])
    )
    shown = outputs - effects.transmission_error(outputs)
    command = run.command[:, : shown.shape[1]]  # what follows pulls at a wire
    return shown @ robot.gear_to_joint, gains.kp * (command - shown) - gains.kv * rates


def _check_closure(motion: Motion) -> None:
    position, angle = motion.closure()
    if position.max() > CLOSURE_LIMIT or angle.max() > CLOSURE_LIMIT:
        k = int(np.argmax(np.maximum(position, angle))) * CLOSURE_STRIDE
        raise PlantError(
            f"not simulated exactly enough: the loop opens to {position.max() * 1e6:.2f} um, "
            f"{angle.max() * 1e6:.2f} urad at t = {motion.t[k]:.2f} s "
            f"(limit {CLOSURE_LIMIT * 1e6:g} um, urad). "
            "Halve plant.timestep_s, or lengthen path.duration_s"
        )


def check_motion(cell: Cell, motion: Motion) -> None:
    """Raise PlantError where an axis leaves its range or a joint passes its singularity.

    Singular are b2 and b4 of the ball-bar, and axis 5 of a robot with a spherical wrist, at
    multiples of half a turn.
    """
    fault = axis_range_fault(cell.robot, motion.t, motion.q)
    if fault is not None:
        raise PlantError(fault[1])
    singular = [("ball-bar joint b2", motion.b[:, 1]), ("ball-bar joint b4", motion.b[:, 3])]
    if has_closed_form(nominal_chain(cell.robot)):
        singular.insert(0, ("robot joint q5", motion.q[:, 4]))
    for name, angle in singular:
        side = np.sin(angle)
        flipped = np.flatnonzero(side * side[0] < 0.0)
        if flipped.size:
            k = int(flipped[0])
            raise PlantError(
                f"{name} passes its singularity at t = {motion.t[k]:.2f} s "
                f"({np.degrees(angle[k]):.1f} deg): the configuration flips. "
                "Move the ball-bar (cell.ballbar_position_m) or shrink the path"
            )
