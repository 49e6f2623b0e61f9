"""The MuJoCo plant: servos drive the closed mechanism along a reference path, one rollout call a run.

The servo is proportional with damping and no integral action (SoftServo, thesis sec. 5.3). Its command leads by the
damping's share of the reference speed and carries the weight of the robot, so what is left as rod force comes from the
geometric errors. The run starts from rest as found by sim.statics.
"""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco import rollout
from scipy.interpolate import CubicSpline

from cell.chain import Array
from cell.descriptions import Cell
from cell.errors import InputError
from cell.geometry import Geometry
from sim.mjcf import PlantModel, plant_model
from sim.motion import Motion
from sim.path import ReferencePath
from sim.statics import gravity_torque, rest

CLOSURE_LIMIT = 0.5e-6  # [m, rad] a run above it is no measurement of the mechanism
_GRAVITY_STEP = 0.05  # [s] grid of the gravity feed-forward; the path has no motion above a few Hz


class PlantError(RuntimeError):
    """The simulation did not do what the mechanism would."""


def run_plant(cell: Cell, geometry: Geometry, path: ReferencePath, *, servo: str, timestep: float) -> Motion:
    """Motion of the true mechanism along a path.

    geometry : true kinematic parameters. servo : a gain set of the robot's description.

    Raises InputError for an unknown gain set, PlantError on divergence or when the loop opens by more than CLOSURE_LIMIT.
    """
    if servo not in cell.robot.servo:
        raise InputError(f"plant.servo = {servo!r}: robot {cell.robot.name} has no such gain set; it has {', '.join(cell.robot.servo)}")
    gains = cell.robot.servo[servo]
    t = np.arange(round(path.t[-1] / timestep) + 1) * timestep
    command = _command(cell, geometry, path, t, gains.kp, gains.kv)
    plant = plant_model(cell, geometry, gains, timestep=timestep)
    held = rest(cell, geometry, gains, command[0], path.q[0], path.b[0])
    positions = _rollout(plant, np.concatenate((held.q, held.b, [held.stretch])), command, timestep)
    stretch = positions[:, plant.rod]
    motion = Motion(t, positions[:, plant.robot], positions[:, plant.bar], stretch, cell.ballbar.axial_stiffness * stretch, geometry)
    _check_closure(motion)
    return motion


def _command(cell: Cell, geometry: Geometry, path: ReferencePath, t: Array, kp: Array, kv: Array) -> Array:
    """(K, 6) [rad] servo commands: reference, velocity lead, gravity compensation of the nominal weight."""
    reference = CubicSpline(path.t, path.q)
    coarse = np.append(np.arange(0.0, t[-1], _GRAVITY_STEP), t[-1])
    weight = CubicSpline(coarse, gravity_torque(cell, geometry, reference(coarse)))
    return np.asarray(reference(t) + kv / kp * reference(t, 1) + weight(t) / kp)


def _rollout(plant: PlantModel, start: Array, command: Array, timestep: float) -> Array:
    """(K, nq) joint positions; entry k answers command k (entry 0 is the start)."""
    model = plant.model
    data = mujoco.MjData(model)
    data.qpos[np.concatenate((plant.robot, plant.bar, [plant.rod]))] = start
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = np.zeros(mujoco.mj_stateSize(model, spec))
    mujoco.mj_getState(model, data, initial, spec)
    warnings: list[str] = []
    mujoco.set_mju_user_warning(warnings.append)
    try:
        state, _ = rollout.rollout(model, data, initial[None], command[None, 1:])
    finally:
        mujoco.set_mju_user_warning(None)
    states = np.concatenate((initial[None], state[0]))
    time, positions = states[:, 0], states[:, 1 : 1 + model.nq]
    bad = ~np.isfinite(states).all(axis=1) | (np.abs(time - np.arange(len(time)) * timestep) > 0.5 * timestep)
    if bad.any() or warnings:
        k = int(bad.argmax())
        said = f" MuJoCo says: {warnings[0]}" if warnings else ""
        raise PlantError(f"simulation diverged at t = {k * timestep:.3f} s.{said} A smaller timestep or a softer servo may help.")
    return np.asarray(positions)


def _check_closure(motion: Motion) -> None:
    position, angle = motion.closure()
    if position.max() > CLOSURE_LIMIT or angle.max() > CLOSURE_LIMIT:
        k = int(np.argmax(np.maximum(position, angle)))
        raise PlantError(
            f"loop closure opens to {position.max() * 1e6:.2f} um, {angle.max() * 1e6:.2f} urad at t = {motion.t[k]:.2f} s "
            f"(limit {CLOSURE_LIMIT * 1e6:g}); use a smaller timestep or a slower path"
        )
