"""Loads of the mass model against MuJoCo and against statics that share nothing with it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ballbar.cell.bodies import carried_bodies
from ballbar.cell.chain import joint_screws
from ballbar.cell.closed_form import robot_branches
from ballbar.cell.dynamics import joint_torques
from ballbar.cell.geometry import bar_frames, nominal_geometry, robot_frames
from ballbar.cell.inverse import refine
from ballbar.cell.load import load_cell
from ballbar.ident.loads.gear_loads import (
    loads,
    mass_model,
    no_loads,
    on_ballbar,
    own_weight,
    rubbed,
)
from ballbar.sim.plant.effects import Plant, PlantEffects
from ballbar.sim.plant.mjcf import plant_model
from ballbar.sim.plant.statics import equilibrium, gravity_torque
from tests.helpers.known_loads import Motion, motion_at, tension_at
from tests.helpers.synthetic_recording import CELL, NOMINAL

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
    assert own_weight(mass_model(cell), geometry, q).gear == pytest.approx(
        expected, abs=1e-9 * np.abs(expected).max()
    )


def test_at_rest_the_servos_give_what_the_loads_ask_for() -> None:
    """A held pose of the closed mechanism by the statics oracle, with a rod that pushes.

    Its tension explains all six torques.
    """
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
    carried = loads(
        mass_model(cell), geometry, q=held.q[None], b=held.b[None], speed=still, acceleration=still
    )
    assert abs(held.rod_force) > 10.0
    assert carried.gears(np.array([held.rod_force]))[:, 0] == pytest.approx(
        servo, abs=2e-4 * np.abs(servo).max()
    )


def test_loads_are_a_known_part_and_a_part_per_newton(moving: Motion) -> None:
    force = tension_at(moving.t)
    carried, none = moving.carried, np.zeros_like(force)
    expected = carried.gear + force * carried.gear_per_newton
    assert np.array_equal(carried.gears(force), expected)
    assert np.array_equal(carried.gears(none), carried.gear)
    assert np.array_equal(
        carried.plate_moment(force), carried.plate + force * carried.plate_per_newton
    )


def test_the_plate_bends_under_what_comes_from_the_ball_bar(moving: Motion) -> None:
    """Moment about the hinge along the flange's y, of what comes through the flange (virtual work).

    Without the weight of the plate itself, which stands in the wrench at the flange.
    """
    cell, force = CELL, tension_at(moving.t)
    frames = robot_frames(NOMINAL, moving.q)
    weight = cell.plate.mass * np.stack([axis[-1].T for axis in (frames.x, frames.y, frames.z)])
    weight = weight @ cell.robot.gravity
    wrench = moving.wrench(force)
    wrench[:3] -= weight
    wrench[3:] -= np.cross(cell.plate.body.com, weight.T).T
    # a third of the plate's reach, which is ra6, from the sixth axis
    hinge = [cell.plate.length - 2.0 / 3.0 * NOMINAL["ra6"], 0.0, cell.plate.tool_offset]
    about_hinge = wrench[3:] - np.cross(hinge, wrench[:3].T).T
    still = np.zeros_like(moving.q)
    carried = loads(
        mass_model(cell), NOMINAL, q=moving.q, b=moving.b, speed=still, acceleration=still
    )
    assert carried.plate_moment(force) == pytest.approx(about_hinge[1], abs=1e-9)


def test_a_pulled_rod_pulls_the_tool_towards_the_base(moving: Motion) -> None:
    """Along the rod, without a moment about the tip, which is a universal joint."""
    bar = bar_frames(NOMINAL, moving.b)
    _, per_newton = on_ballbar(mass_model(CELL), bar, moving.b)
    rod = bar.tip - NOMINAL.origin[:, None]
    along = rod / np.linalg.norm(rod, axis=0)
    # What the tool exerts on the ball-bar's end: a pull outwards.
    assert per_newton[:3] == pytest.approx(along, abs=1e-9)
    assert np.abs(per_newton[3:]).max() < 1e-9


def test_the_power_against_the_friction_of_the_ball_bar_comes_from_the_gears() -> None:
    """Virtual work of every single joint of the ball-bar, the rod's length kept.

    At rest friction stays as the motion left it.
    """
    angle = np.r_[0.0, 5e-5, 1e-2, 1e-2, 1e-2 - 5e-5, 1e-2 - 3e-4]
    moving = motion_at(np.linspace(10.0, 12.0, angle.size))
    turned = angle[:, None] * np.r_[1.0, -1.0, 1.0, 0.0, 1.0]
    side = np.array([0.0, 0.5, 1.0, 1.0, 0.5, -1.0])[:, None] * np.sign(turned[-1])
    bar = joint_screws(bar_frames(NOMINAL, moving.b[:1] + turned)).transpose(2, 1, 0)  # (N, 6, 5)
    robot = joint_screws(robot_frames(NOMINAL, moving.q)).transpose(2, 1, 0)
    gears = np.linalg.solve(robot, bar).transpose(0, 2, 1) @ CELL.robot.joint_to_gear  # (N, 5, 6)
    loaded = rubbed(mass_model(CELL), NOMINAL, moving.q, moving.b[:1] + turned)
    assert np.einsum("nbg,gn->nb", gears, loaded) == pytest.approx(side, abs=1e-9)


def test_where_no_correction_asks_for_loads_there_are_none() -> None:
    nothing = no_loads(6, 4)
    assert not nothing.gears(np.ones(4)).any()
    assert not nothing.plate_moment(np.ones(4)).any()
    assert nothing.gear.shape == (6, 4)
