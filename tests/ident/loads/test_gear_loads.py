"""Loads of the mass model against MuJoCo and against statics that share nothing with it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from cell.bodies import carried_bodies
from cell.dynamics import joint_torques
from cell.geometry import bar_frames, nominal_geometry, robot_frames
from cell.inverse import refine, robot_branches
from cell.load import load_cell
from ident.loads.gear_loads import loads, mass_model, own_weight
from sim.plant.description import Plant
from sim.plant.effects import PlantEffects
from sim.plant.mjcf import plant_model
from sim.plant.statics import equilibrium, gravity_torque

CELLS = {"irb2400": ("lund_600", [0.70, 0.0, 0.54]), "nj220": ("lund_900", [1.50, 0.0, 0.70])}


@pytest.mark.parametrize("robot", list(CELLS))
def test_inverse_dynamics_are_mujocos(robot: str) -> None:
    """The open chain: robot and plate without ball-bar, torque of its own motion."""
    cell = load_cell(robot, CELLS[robot][0], "plate_250")
    geometry = nominal_geometry(cell, np.array(CELLS[robot][1]))
    perfect = Plant(cell, geometry, PlantEffects(), cell.robot.servo["soft"])
    plant = plant_model(perfect, timestep=1e-3)
    plant.model.opt.disableflags |= (
        mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    )
    data = mujoco.MjData(plant.model)
    rng = np.random.default_rng(0)
    q, speed, acceleration = rng.uniform(-0.5, 0.5, (3, 20, 6))
    frames = robot_frames(geometry, q)
    found = joint_torques(
        frames,
        carried_bodies(cell),
        q,
        gravity=cell.robot.gravity,
        speed=speed,
        acceleration=acceleration,
    )
    rotors = cell.robot.joint_to_gear @ np.diag(cell.robot.armature) @ cell.robot.joint_to_gear.T
    for k in range(len(q)):
        data.qpos[plant.joints], data.qvel[plant.joints], data.qacc[plant.joints] = (
            q[k],
            speed[k],
            acceleration[k],
        )
        mujoco.mj_inverse(plant.model, data)
        expected = data.qfrc_inverse[plant.joints] - rotors @ acceleration[k]
        assert found[:, k] == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("robot", list(CELLS))
def test_own_weight_is_that_of_the_statics_oracle(robot: str) -> None:
    cell = load_cell(robot, CELLS[robot][0], "plate_250")
    geometry = nominal_geometry(cell, np.array(CELLS[robot][1]))
    q = np.random.default_rng(1).uniform(-0.5, 0.5, (30, 6))
    expected = cell.robot.gear_to_joint @ gravity_torque(cell, geometry, q).T
    assert own_weight(mass_model(cell), geometry, q) == pytest.approx(
        expected, abs=1e-9 * np.abs(expected).max()
    )


def test_at_rest_the_servos_give_what_the_loads_ask_for() -> None:
    """A held pose of the closed mechanism by the statics oracle, with a rod that pushes: its tension explains all six torques."""
    cell = load_cell("irb2400", "lund_600", "plate_250")
    geometry = nominal_geometry(cell, np.array([0.70, 0.0, 0.54]))
    b = np.radians([[-23.2, -54.3, 20.8, -129.6, 138.0]])
    poses = bar_frames(geometry, b).poses()
    q = refine(geometry.robot, robot_branches(geometry.robot, poses)[0], poses)
    gains = cell.robot.servo["soft"]
    plant = Plant(cell, geometry, PlantEffects(rod_stiffness=2.7e7), gains)
    held = equilibrium(plant, q[0] @ cell.robot.joint_to_gear, q[0], b[0])
    servo = gains.kp * (q[0] @ cell.robot.joint_to_gear - held.motor @ cell.robot.joint_to_gear)
    still = np.zeros((1, 6))
    carried = loads(mass_model(cell), geometry, held.q[None], held.b[None], still, still)
    assert abs(held.rod_force) > 10.0
    assert carried.gears(np.array([held.rod_force]))[:, 0] == pytest.approx(
        servo, abs=2e-4 * np.abs(servo).max()
    )
