"""The plant: it starts in equilibrium, keeps the loop closed, and reports when it does not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from ballbar.cell.chain import joint_screws, screw
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, bar_frames, nominal_geometry, robot_frames
from ballbar.cell.load import load_cell
from ballbar.planning.verify import plant_errors
from ballbar.sim.errors.plant_errors import PlantErrors
from ballbar.sim.errors.static_errors import set_without_strain, true_geometry
from ballbar.sim.motion import CLOSURE_STRIDE
from ballbar.sim.path import Lissajous, ReferencePath, phase_over_time, reference_path
from ballbar.sim.path_files import load_lissajous
from ballbar.sim.plant import mujoco_plant as plant_module
from ballbar.sim.plant.effects import Plant, PlantEffects, plant_effects
from ballbar.sim.plant.mjcf import plant_model
from ballbar.sim.plant.mujoco_plant import PlantError, check_motion, prepare, roll_out, run_plant
from ballbar.sim.plant.statics import equilibrium, gravity_torque
from ballbar.sim.simulate import simulate
from tests.helpers.drawn_robots import scenario_of
from tests.helpers.plant_oracle import CELLS, EFFECTS, held_against_oracle
from tests.helpers.simulated_recordings import SCENARIOS, Recorded, perturbed


@pytest.fixture(scope="module")
def shape() -> Lissajous:
    return load_lissajous(SCENARIOS / "paths" / "irb2400_a.yaml")


def test_the_loop_stays_closed_within_half_a_micrometre_along_the_run(recorded: Recorded) -> None:
    position, angle = recorded.simulation.motion.closure()
    assert position.max() < 0.5e-6
    assert angle.max() < 0.5e-6
    assert position.max() == recorded.simulation.truth.closure.position_m


def test_rod_forces_of_the_soft_servo_are_of_the_order_measured_in_the_thesis(
    recorded: Recorded,
) -> None:
    force = recorded.simulation.motion.rod_force
    assert 50.0 < np.abs(force).max() < 200.0  # 150 N (notes/plant, experiment)


def test_the_run_starts_at_rest(recorded: Recorded) -> None:
    motion = recorded.simulation.motion
    assert np.abs(motion.q[500] - motion.q[0]).max() < 1e-8  # half a second into the first dwell
    assert abs(motion.rod_force[500] - motion.rod_force[0]) < 1e-2


@pytest.mark.long
def test_a_mechanism_whose_steps_jump_from_flank_to_flank_has_an_equilibrium() -> None:
    """Drawn robot 8: from the path's first pose they end with the loop open by 5 mm."""
    run = simulate(scenario_of("irb2400", "a", 8, 120.0), relative_to=SCENARIOS)
    assert run.truth.closure.position_m < 0.5e-6


def test_a_mechanism_whose_rod_is_within_its_backlash_has_an_equilibrium() -> None:
    """Regression: full Newton steps alternate between the ends of a dead band.

    Steps that were halved now and then stopped on the way.

    The first target of a path of the NJ 220, where the rod without strain carries next to nothing.
    """
    cell = load_cell("nj220", "lund_900", "plate_250")
    nominal = nominal_geometry(cell, np.array([1.475, 0.005, 0.771]))
    centre, amplitude, phase = (
        [-66.16, -74.8, -4.8, -115.48, 158.02],
        [51.43, 32.58, 46.77, 0.42, 102.3],
        [166.1, 356.4, 266.6, 346.6, 215.7],
    )
    shape = Lissajous(
        np.radians(centre),
        np.radians(amplitude),
        np.array([3.0, 4.0, 1.0, 1.0, 3.0]),
        np.radians(phase),
    )
    path = reference_path(cell.robot, nominal, shape, duration=120.0, dwell=4.0, stops=2, step=0.1)
    for seed in range(4):
        errors = plant_errors(table=seed == 0)
        true = set_without_strain(true_geometry(nominal, errors, cell, seed=seed), path.q[:1])
        effects = plant_effects(errors, cell, seed)
        plant = Plant(cell, true, effects, cell.robot.servo["soft"])
        run = prepare(plant, path, timestep=1e-3, gravity_compensation=True)
        held = equilibrium(plant, run.command[0], path.q[0], path.b[0])
        assert held.in_backlash
        assert abs(held.stretch) < 1.02 * effects.rod_backlash
        assert abs(held.rod_force) < 2.0


@cache
def machine(robot: str) -> tuple[Cell, Geometry, Geometry, ReferencePath]:
    """A cell, its nominal and a true geometry, and the path of its scenario."""
    bar, position, path = CELLS[robot]
    cell = load_cell(robot, bar, "plate_250")
    nominal = nominal_geometry(cell, np.array(position))
    shape = load_lissajous(SCENARIOS / "paths" / f"{path}.yaml")
    reference = reference_path(
        cell.robot, nominal, shape, duration=120.0, dwell=4.0, stops=2, step=0.01
    )
    return cell, nominal, perturbed(nominal, np.random.default_rng(4)), reference


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "effect"),
    [
        pytest.param(
            robot, effect, marks=() if "everything" in effect or k == 0 else pytest.mark.long
        )
        for k, robot in enumerate(CELLS)
        for effect in EFFECTS
    ],
)
def test_a_held_pose_settles_where_the_statics_oracle_says(robot: str, effect: str) -> None:
    """Four poses, 0.1 urad, 0.1 um, 0.02 N; benchmarks/plant_oracle.py compares twenty.

    The oracle shares no code with MuJoCo.
    """
    cell, _, true, path = machine(robot)
    effects = plant_effects(PlantErrors.model_validate(EFFECTS[effect]), cell, seed=1)
    for k in (1000, 4000, 7000, 10500):
        plant = Plant(cell, true, effects, cell.robot.servo["soft"])
        deviation = held_against_oracle(plant, path, k)
        assert deviation.link_angle < 1e-7
        assert deviation.end_point < 1e-7
        assert deviation.rod_force < 0.02


def test_gravity_torque_is_the_derivative_of_the_potential_energy_in_mujoco(
    cell: Cell, nominal: Geometry
) -> None:
    q = np.random.default_rng(6).uniform(-0.7, 0.7, (4, 6))
    perfect = Plant(cell, nominal, PlantEffects(), cell.robot.servo["soft"])
    plant = plant_model(perfect, timestep=1e-3)
    data = mujoco.MjData(plant.model)
    for row, torque in zip(q, gravity_torque(cell, nominal, q), strict=True):
        data.qpos[plant.joints] = row
        data.qvel[:] = 0.0
        mujoco.mj_forward(plant.model, data)
        assert data.qfrc_bias[plant.joints] == pytest.approx(torque, abs=1e-9)


def test_the_phase_starts_and_ends_at_rest_and_rests_at_every_stop() -> None:
    t = np.linspace(-1.0, 121.0, 12201)
    s = phase_over_time(t, duration=120.0, dwell=4.0, stops=2)
    speed = np.gradient(s, t)
    assert s[0] == 0.0
    assert s[-1] == pytest.approx(1.0, abs=1e-12)
    assert (speed >= -1e-12).all()
    # no step in speed: ramps of 2 s to about 0.01 per second
    assert np.abs(np.diff(speed)).max() < 2e-4
    for level in (1 / 3, 2 / 3):
        assert np.isclose(s, level, atol=1e-12).sum() >= 395
    with pytest.raises(
        InputError, match=r"path\.duration_s = .* are left for each piece .* Take more than"
    ):
        phase_over_time(t, duration=20.0, dwell=4.0, stops=2)


def test_a_path_out_of_reach_names_the_time(cell: Cell, shape: Lissajous) -> None:
    far = nominal_geometry(cell, np.array([1.2, 0.0, 0.54]))
    with pytest.raises(InputError, match=r"out of reach at t = \d+\.\d\d s"):
        reference_path(cell.robot, far, shape, duration=60.0, dwell=2.0, stops=1, step=0.01)


def test_a_path_beyond_an_axis_range_names_axis_time_and_value(
    cell: Cell, nominal: Geometry, shape: Lissajous
) -> None:
    narrow = replace(cell.robot, axis_upper=cell.robot.axis_upper * np.array([0.05, 1, 1, 1, 1, 1]))
    with pytest.raises(
        InputError, match=r"axis 1 at t = \d+\.\d\d s: \d+\.\d deg outside -180..9 deg"
    ):
        reference_path(narrow, nominal, shape, duration=60.0, dwell=2.0, stops=1, step=0.01)


def test_a_path_too_fast_for_an_axis_names_axis_time_and_speed(
    cell: Cell, nominal: Geometry, shape: Lissajous
) -> None:
    with pytest.raises(InputError, match=r"axis \d at t = \d+\.\d\d s turns at \d+ deg/s, limit"):
        reference_path(cell.robot, nominal, shape, duration=12.0, dwell=1.0, stops=0, step=0.01)


def test_a_run_whose_loop_opens_too_far_fails(
    cell: Cell, nominal: Geometry, shape: Lissajous, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plant_module, "CLOSURE_LIMIT", 1e-9)
    path = reference_path(cell.robot, nominal, shape, duration=20.0, dwell=2.0, stops=0, step=0.01)
    with pytest.raises(PlantError, match=r"the loop opens to .* Halve plant\.timestep_s"):
        run_plant(
            Plant(cell, nominal, PlantEffects(), cell.robot.servo["soft"]), path, timestep=1e-3
        )


def test_a_diverging_simulation_ends_with_its_time_and_no_silent_reset(
    cell: Cell, nominal: Geometry, shape: Lissajous
) -> None:
    path = reference_path(cell.robot, nominal, shape, duration=20.0, dwell=2.0, stops=0, step=0.01)
    plant = Plant(cell, nominal, PlantEffects(), cell.robot.servo["soft"])
    prepared = prepare(plant, path, timestep=1e-3, gravity_compensation=True)
    prepared.compiled.model.dof_damping[:] = -1e5  # feeds energy in
    with pytest.raises(PlantError, match=r"diverged at t = \d+\.\d+ s"):
        roll_out(prepared)


@pytest.mark.slow
def test_stretches_are_reported_as_they_come_and_join_to_the_motion_of_one_call(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cell, nominal, true, _ = machine("irb2400")
    shape = load_lissajous(SCENARIOS / "paths" / "irb2400_a.yaml")
    fifty = reference_path(cell.robot, nominal, shape, duration=50.0, dwell=2.0, stops=0, step=0.01)
    path = ReferencePath(**{name: part[:1001] for name, part in vars(fifty).items()})  # 10 s
    effects = plant_effects(PlantErrors.model_validate(EFFECTS["everything"]), cell, seed=1)
    stretches: list[tuple[np.ndarray, ...]] = []
    plant = Plant(cell, true, effects, cell.robot.servo["soft"])
    motion = run_plant(
        plant, path, timestep=1e-3, on_motion=lambda _cell, _geometry, *rows: stretches.append(rows)
    )
    assert len(stretches) == 5
    for stretch, following in pairwise(stretches):
        assert stretch[0][-1] == following[0][0]
    for k, whole in enumerate((motion.t, motion.q, motion.b)):
        joined = np.concatenate([stretches[0][k], *(rows[k][1:] for rows in stretches[1:])])
        np.testing.assert_allclose(joined, whole, rtol=0.0, atol=1e-9 if k == 0 else 0.0)
    monkeypatch.setattr(plant_module, "_STRETCH", 1e9)
    np.testing.assert_array_equal(run_plant(plant, path, timestep=1e-3).q, motion.q)


@pytest.mark.slow
def test_everything_on_keeps_the_loop_closed() -> None:
    cell, nominal, true, _ = machine("irb2400")
    errors = EFFECTS["everything"] | {"gear_friction": {}, "bar_friction": {}}
    effects = plant_effects(PlantErrors.model_validate(errors), cell, seed=1)
    shape = load_lissajous(SCENARIOS / "paths" / "irb2400_a.yaml")
    short = reference_path(cell.robot, nominal, shape, duration=60.0, dwell=2.0, stops=0, step=0.01)
    plant = Plant(cell, true, effects, cell.robot.servo["soft"])
    position, angle = run_plant(plant, short, timestep=1e-3).closure()
    assert position.max() < 0.3e-6
    assert angle.max() < 0.3e-6


def potential(cell: Cell, geometry: Geometry, b: np.ndarray, stretch: float) -> float:
    """Energy of the ball-bar's masses [J], with centres of mass in the frames before each row."""
    zero = bar_frames(nominal_geometry(cell, np.zeros(3)), np.zeros((1, 5)))
    frames = bar_frames(geometry.replaced({"bd3": geometry["bd3"] + stretch}), b[None])
    energy = 0.0
    for i, link in enumerate(cell.ballbar.links):
        at_zero = zero.rotation(i)[:, :, 0].T @ (link.com - zero.origin[i, :, 0])
        turn = np.array(
            [[np.cos(b[i]), -np.sin(b[i]), 0], [np.sin(b[i]), np.cos(b[i]), 0], [0, 0, 1]]
        )
        lifted = stretch * frames.z[2, :, 0] if i == 2 else 0.0
        com = frames.origin[i, :, 0] + frames.rotation(i)[:, :, 0] @ turn @ at_zero + lifted
        energy -= link.mass * float(cell.robot.gravity @ com)
    return energy


def test_the_force_sensor_shows_what_plate_and_ball_bar_weigh_and_pull() -> None:
    """Virtual work gives the ball-bar's pull on the tool: rod force and weight of its links."""
    cell, nominal, true, _ = machine("irb2400")
    shape = load_lissajous(SCENARIOS / "paths" / "irb2400_a.yaml")
    short = reference_path(cell.robot, nominal, shape, duration=60.0, dwell=4.0, stops=0, step=0.01)
    plant = Plant(cell, true, PlantEffects(force_sensor=True), cell.robot.servo["soft"])
    motion = run_plant(plant, short, timestep=1e-3)
    b, rod = motion.b[100], motion.rod_force[100]  # a tenth of a second into the first dwell
    h = 1e-5  # central differences of an energy of joules: 1e-10 / 2e-5
    load = np.array(
        [
            potential(cell, true, b + h * e, 0.0) - potential(cell, true, b - h * e, 0.0)
            for e in np.eye(5)
        ]
    ) / (2 * h)
    along = (potential(cell, true, b, h) - potential(cell, true, b, -h)) / (2 * h) + rod
    bar = bar_frames(true, b[None])
    columns = np.concatenate((joint_screws(bar), screw(bar, "d", 2)[None]))[:, :, 0]
    # wrench of the ball-bar on the tool
    on_tool = np.linalg.solve(columns, -np.append(load, along))
    frames = robot_frames(true, motion.q[100:101])
    expected = on_tool[:3] + cell.plate.mass * cell.robot.gravity
    assert motion.wrench is not None
    cos, sin = np.cos(motion.q[100, 5]), np.sin(motion.q[100, 5])
    # the tool's errors lie behind it
    flange = frames.rotation(5)[:, :, 0] @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    assert flange @ motion.wrench[100, :3] == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize(("joint", "name"), [(1, "ball-bar joint b2"), (3, "ball-bar joint b4")])
def test_a_flip_of_the_ball_bar_is_named_with_joint_and_time(
    recorded: Recorded, joint: int, name: str
) -> None:
    motion = recorded.simulation.motion
    b = motion.b.copy()
    b[30000:, joint] *= -1.0
    with pytest.raises(PlantError, match=rf"{name} passes its singularity at t = 30\.00 s"):
        check_motion(recorded.simulation.cell, replace(motion, b=b))
    check_motion(recorded.simulation.cell, motion)


def test_a_robot_pushed_beyond_an_axis_range_ends_with_axis_time_and_value(
    recorded: Recorded,
) -> None:
    robot = recorded.simulation.cell.robot
    tight = replace(robot, axis_upper=robot.axis_upper * np.array([1, 0.2, 1, 1, 1, 1]))
    with pytest.raises(
        PlantError, match=r"axis 2 at t = \d+\.\d\d s: \d+\.\d deg outside -100\.\.22 deg"
    ):
        check_motion(replace(recorded.simulation.cell, robot=tight), recorded.simulation.motion)


def test_closure_counts_a_wrong_angle(recorded: Recorded) -> None:
    motion = recorded.simulation.motion
    q = motion.q.copy()
    q[3 * CLOSURE_STRIDE, 1] += 1e-5
    position, angle = replace(motion, q=q).closure()
    assert position[3] > 5e-6
    assert angle[3] == pytest.approx(1e-5, rel=0.02)
    assert position[2] < 1e-6


def test_the_true_mechanism_of_a_run_has_the_errors_of_table_3_1(recorded: Recorded) -> None:
    nominal = nominal_geometry(
        recorded.simulation.cell, np.array(recorded.settings.cell.ballbar_position_m)
    )
    true = recorded.simulation.motion.geometry
    assert (true["ra3"] - nominal["ra3"]) * 1e3 == pytest.approx(-1.52)
    assert (true["oy"] - nominal["oy"]) * 1e3 == pytest.approx(0.80)
    assert true["ra6"] == nominal["ra6"]  # the plate is the known length
