"""Every plant effect and load log is in the device files as the scenario states.

One effect is on at a time, noise is off, and the analysis (tests.helpers.log_analysis) knows
statics and nothing of the plant. A truth file gives clocks, encoder offsets and kinematic
parameters; where something is drawn, it says what was drawn.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import curve_fit

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, robot_frames
from ballbar.cell.inverse import pose_error
from ballbar.cell.load import load_robot
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.sim.errors.plant_errors import PlantErrors
from ballbar.sim.logging.load_logs import drawn_loads
from ballbar.sim.plant.effects import plant_effects
from ballbar.sim.plant.held import hold_machine
from ballbar.sim.plant.kinematic_plant import WITH_FORCES
from ballbar.sim.recording_files import truth_path, write_recording
from ballbar.sim.settings import SimulationSettings
from ballbar.sim.simulate import Simulation, simulate
from ballbar.sim.true_robot import true_machine
from ballbar.sim.truth import PlantTruth, load_truth
from ballbar.truth.compare import true_tool
from tests.helpers.log_analysis import (
    Logs,
    fit,
    force_near_singularity,
    harmonics,
    rate,
    read_logs,
    read_table,
    settled_direction,
    there_and_back,
)
from tests.helpers.simulated_recordings import (
    SCENARIOS,
    lissajous,
    record,
    settings,
    singular_passage,
    wire_settings,
)

pytestmark = pytest.mark.long  # a simulated run for each effect

WITHIN = 0.01  # of what was asked for
CELLS: dict[str, dict[str, Any]] = {
    "irb2400": {"robot": "irb2400", "ballbar": "lund_600", "ballbar_position_m": [0.70, 0.0, 0.54]},
    "nj220": {"robot": "nj220", "ballbar": "lund_900", "ballbar_position_m": [1.50, 0.0, 0.70]},
}
PERFECT_LOGS = {
    "torque": {"noise_N_m": 0.0, "wrist_noise_N_m": 0.0, "gain_sigma": 0.0},
    "force_sensor": {
        "rate_hz": 100.0,
        "noise_N": 0.0,
        "noise_N_m": 0.0,
        "bias_N": 0.0,
        "bias_N_m": 0.0,
        "gain_sigma": 0.0,
    },
}
# a soft servo that does not carry the arm leans on the rod with up to 170 N
SAGGING = {"gravity_compensation": False}
CENTRE = np.array([-23.2, -54.3, 20.8, -129.6, 138.0])  # [deg] scenarios/paths/irb2400_a.yaml
AMPLITUDE = np.array([75.9, -19.6, 31.0, -18.2, 87.4])  # [deg]


def run(
    folder: Path, *, robot: str = "irb2400", duration: float = 60.0, file: str = "", **changes: Any
) -> Logs:
    """The files of a run with perfect logs and the errors of `changes` only."""
    base: dict[str, Any] = {
        "cell": CELLS[robot],
        "path": lissajous(file or f"paths/{robot}_a.yaml", duration),
        "errors": {},
        "encoders": {"bits": 13},
        "clocks": {"offset_s": 0.137, "skew": 5e-5},
        "logs": PERFECT_LOGS | {"robot": {"dialect": "canonical-robot"}},  # has torques
    }
    return read_logs(record(folder / "recording", **(base | changes)).folder)


def path_there_and_back(folder: Path, cycles: list[int], *, size: float) -> str:
    """A path whose second half is its first in reverse: every angle starts at an extreme."""
    place = folder / "path.yaml"
    lists = {
        "centre_deg": CENTRE,
        "amplitude_deg": (size * AMPLITUDE).round(2),
        "cycles": np.array(cycles),
    }
    lines = [f"{name}: {values.tolist()}" for name, values in lists.items()]
    place.write_text(
        "\n".join(["schema: ballbar-path/1", *lines, "phase_deg: [90, -90, 90, 90, -90]"])
    )
    return str(place)


def stated(folder: Path) -> PlantTruth:
    """The plant that was drawn."""
    return load_truth(truth_path(folder / "recording")).plant


# --- the logs themselves


def test_at_rest_the_logged_torques_carry_the_arm_and_what_the_force_sensor_feels(
    tmp_path: Path,
) -> None:
    logs = run(tmp_path, plant=SAGGING)
    still = logs.t < 1.5
    # of 400 N m; the files have 1e-6 N m at the motor
    assert np.abs(logs.torque[still] - logs.load[still]).max() < 1e-3
    assert np.abs(logs.rod_force[still]).min() > 40.0


# --- gears


def springs(logs: Logs) -> tuple[Array, Array, Array]:
    """(N, 6) [rad] deflection between the ball-bar's pose and the motors, at the gears.

    Also its rate and the acceleration of the motors.
    """
    deflection = logs.gears - logs.shown_gears
    return deflection, rate(logs.t, deflection), rate(logs.t, rate(logs.t, logs.shown_gears))


def assert_stiffness(logs: Logs, expected: Array) -> None:
    """Motor and gear: torque of the motor is that of spring, damper and rotor."""
    deflection, speed, rotor = springs(logs)
    for i in range(6):
        found = fit([-deflection[:, i], -speed[:, i], rotor[:, i]], logs.torque[:, i])[0]
        assert found == pytest.approx(expected[i], rel=WITHIN), f"gear {i + 1}"


@pytest.mark.parametrize("robot", list(CELLS))
def test_each_gear_yields_to_its_torque_by_the_drawn_stiffness(robot: str, tmp_path: Path) -> None:
    compliance = {"scale": 0.8, "spread": 0.3}
    logs = run(tmp_path, robot=robot, plant=SAGGING, errors={"joint_compliance": compliance})
    drawn = np.array(stated(tmp_path).gear_stiffness_N_m_per_rad)
    assert np.std(drawn / logs.cell.robot.gears.stiffness) > 0.1
    assert_stiffness(logs, drawn)


def test_a_gear_with_play_jumps_by_the_asked_width_where_its_load_changes_sign(
    tmp_path: Path,
) -> None:
    errors = {"joint_compliance": {"scale": 0.3}, "gear_backlash": {"scale": 0.9}}
    logs = run(tmp_path, plant=SAGGING, errors=errors)
    (deflection, speed, rotor), asked = springs(logs), 0.9 * logs.cell.robot.gears.lost_motion
    for i in range(6):  # gears 3 and 5 are never unloaded: their line misses zero by half the width
        through = np.abs(deflection[:, i]) > 0.75 * asked[i]
        e, side = deflection[through, i], np.sign(deflection[through, i])
        stiffness, preload, *_ = fit(
            [-e, side, -speed[through, i], rotor[through, i]], logs.torque[through, i]
        )
        assert 2.0 * preload / stiffness == pytest.approx(asked[i], rel=WITHIN), f"gear {i + 1}"


def test_a_gear_with_hysteresis_lags_by_the_asked_width_between_loading_and_unloading(
    tmp_path: Path,
) -> None:
    errors = {"joint_compliance": {"scale": 0.3}, "gear_backlash": {"kind": "hysteresis"}}
    logs = run(tmp_path, plant=SAGGING, errors=errors)
    (deflection, speed, rotor), asked = springs(logs), logs.cell.robot.gears.lost_motion
    for i in range(6):
        way = settled_direction(deflection[:, i], 1.2 * asked[i])
        on = way != 0.0
        assert min((way > 0.0).mean(), (way < 0.0).mean()) > 0.05
        stiffness, half, *_ = fit(
            [-deflection[on, i], -way[on], -speed[on, i], rotor[on, i]], logs.torque[on, i]
        )
        assert 2.0 * half / stiffness == pytest.approx(asked[i], rel=WITHIN), f"gear {i + 1}"


def assert_ripples(logs: Logs, asked: list[list[tuple[float, float]]], folder: Path) -> None:
    """Amplitude of each (order, amplitude) of each gear as asked, phase as drawn."""
    drawn = {
        (r.axis, round(r.cycles_per_turn, 6)): r.phase_rad
        for r in stated(folder).transmission_error
    }
    for i, gear in enumerate(asked):
        error = logs.gears[:, i] - logs.shown_gears[:, i]
        orders = [order for order, _ in gear]
        if not orders:
            assert np.abs(error).max() < 1e-6
            continue
        for found, (order, amplitude) in zip(
            harmonics(logs.gears[:, i], error, orders), gear, strict=True
        ):
            place = f"gear {i + 1}, {order:g} cycles a turn"
            assert abs(found) == pytest.approx(amplitude, rel=WITHIN), place
            assert (
                abs(found - amplitude * np.exp(1j * drawn[i + 1, round(order, 6)]))
                < WITHIN * amplitude
            ), place


@pytest.mark.parametrize("robot", list(CELLS))
def test_each_harmonic_of_the_gears_lies_between_motor_and_pose(robot: str, tmp_path: Path) -> None:
    logs = run(tmp_path, robot=robot, duration=90.0, errors={"transmission_error": {"scale": 2.0}})
    asked = [
        [(order, 2.0 * amplitude) for order, amplitude in gear]
        for gear in logs.cell.robot.gears.harmonics
    ]
    assert_ripples(logs, asked, tmp_path)


def test_each_gear_has_a_ripple_of_an_order_that_its_file_does_not_list(tmp_path: Path) -> None:
    logs = run(tmp_path, duration=90.0, errors={"unlisted_ripple": {"amplitude_rad": 6e-5}})
    orders = {r.axis: r.cycles_per_turn for r in stated(tmp_path).transmission_error}
    assert_ripples(logs, [[(orders[i + 1], 6e-5)] for i in range(6)], tmp_path)


def test_unlisted_orders_are_those_between_the_listed_ones_from_robot_to_robot(cell: Cell) -> None:
    errors = PlantErrors.model_validate({"unlisted_ripple": {}})
    drawn = [r for seed in range(300) for r in plant_effects(errors, cell, seed).ripples]
    listed = [{order for order, _ in gear} for gear in cell.robot.gears.harmonics]
    assert [r.amplitude for r in drawn] == pytest.approx([4e-6] * len(drawn))
    assert all(r.order not in listed[r.gear] for r in drawn)
    assert {r.order for r in drawn} == set(range(3, 39))
    assert abs(np.mean([np.exp(1j * r.phase) for r in drawn])) < 3.0 / np.sqrt(len(drawn))


def test_the_kinematic_plant_has_unlisted_ripples_too(tmp_path: Path) -> None:
    still, rippled = (
        simulate(settings(plant={"kind": "kinematic"}, errors=errors), relative_to=SCENARIOS).motion
        for errors in ({}, {"unlisted_ripple": {}})
    )
    change = np.abs(rippled.shown - still.shown)
    np.testing.assert_array_equal(rippled.q, still.q)
    assert (change.max(axis=0) > 3.9e-6).all()  # wrist joints carry the ripple of several motors
    assert change.max() < 1.3e-5


# --- masses


def test_the_motors_carry_the_drawn_masses_of_the_links(tmp_path: Path) -> None:
    logs = run(tmp_path, plant=SAGGING, errors={"masses": {}})
    still = logs.t < 1.5
    masses = stated(tmp_path).masses
    assert masses is not None
    known = replace(logs, cell=masses.on(logs.cell))
    assert np.abs(known.torque[still] - known.load[still]).max() < 1e-3  # as above
    assert np.abs(logs.torque[still] - logs.load[still]).max() > 1.0


def test_a_body_has_the_mass_and_centre_that_the_truth_states_for_it(tmp_path: Path) -> None:
    logs = run(tmp_path, errors={"masses": {}})
    plant = stated(tmp_path)
    assert plant.masses is not None
    true, nominal = plant.masses.on(logs.cell), logs.cell
    pairs = {
        "plate": (true.plate.body, nominal.plate.body),
        **{f"link{i}": (true.robot.links[i], nominal.robot.links[i]) for i in range(1, 7)},
        **{f"bar{i + 1}": (true.ballbar.links[i], nominal.ballbar.links[i]) for i in range(5)},
    }
    assert set(plant.bodies) == set(pairs)
    for name, (body, file) in pairs.items():
        assert body.mass == plant.bodies[name].mass_kg
        assert tuple(body.com) == plant.bodies[name].com_m
        assert 0.0 < abs(body.mass / file.mass - 1.0) < 0.1
        assert 0.0 < np.abs(body.com - file.com).max() < 0.015
        np.testing.assert_allclose(body.inertia * file.mass, file.inertia * body.mass)
    assert true.robot.links[0] is nominal.robot.links[0]


def test_the_true_tool_sags_under_the_true_masses() -> None:
    """The reference of all TCP errors; held free in MuJoCo."""
    errors = {"joint_compliance": {}, "masses": {"spread": 0.1, "centre_sigma_m": 0.02}}
    chosen = settings(errors=errors)
    truth = simulate(chosen, relative_to=SCENARIOS).truth
    robot, q = true_machine(chosen, relative_to=SCENARIOS), accuracy_grid(load_robot("irb2400"))[:4]
    actual = hold_machine(robot, q).tool[:, :3, 3]
    files = truth.model_copy(update={"plant": truth.plant.model_copy(update={"bodies": {}})})
    with_truth, with_files = (true_tool(robot.cell, t, robot.true, q) for t in (truth, files))
    assert np.abs(with_truth - actual).max() < 1e-6
    assert np.abs(with_files - actual).max() > 1e-5


def test_a_cycloid_drive_ripples_as_a_sine_on_the_asked_axes_only(tmp_path: Path) -> None:
    ripple = {"waveform": "harmonic", "amplitude_rad": 8e-5, "lobes": 39.5, "axes": [1, 3]}
    logs = run(tmp_path, errors={"cycloid_ripple": ripple})
    assert_ripples(logs, [[(39.5, 8e-5)], [], [(39.5, 8e-5)], [], [], []], tmp_path)


def test_a_cusped_ripple_is_the_rectified_sine_with_zero_mean(tmp_path: Path) -> None:
    logs = run(tmp_path, errors={"cycloid_ripple": {"amplitude_rad": 6e-5}})
    error = logs.gears - logs.shown_gears
    for i in range(3):
        found = harmonics(logs.gears[:, i], error[:, i], [40.0, 80.0, 120.0, 160.0])
        # of pi/2 |sin(x/2)| - 1, truncated
        series = [2.0 * 6e-5 / (4 * k * k - 1) for k in range(1, 5)]
        assert np.abs(found) == pytest.approx(series, rel=WITHIN)
        x = 40.0 * logs.gears[:, i] + np.angle(found[0]) + 0.5 * np.pi
        wave = 6e-5 * (0.5 * np.pi * np.abs(np.sin(0.5 * x)) - 1.0)
        near = np.abs(np.angle(np.exp(1j * x))) < np.radians(12.0)
        assert np.abs(error[~near, i] - wave[~near]).max() < 0.045 * 6e-5
        # four terms reach 8/9 of the peak; counts of the encoders
        assert (error[near, i] - wave[near]).max() == pytest.approx(6e-5 / 9.0, rel=0.03)


@pytest.mark.parametrize("side", ["output", "input"])
def test_an_eccentric_gear_errs_once_a_turn_of_its_output_or_its_motor(
    side: str, tmp_path: Path
) -> None:
    error = {"side": side, "amplitude_rad": 9e-5, "axes": [1, 2, 3, 4, 5, 6]}
    logs = run(tmp_path, errors={"sinusoidal_gear_error": error})
    # thesis App. A
    turns = [129.6, 129.99, 129.6, 55.0, 55.2, 44.0] if side == "input" else [1.0] * 6
    assert_ripples(logs, [[(turn, 9e-5)] for turn in turns], tmp_path)


def test_parallel_rod_and_wrist_carry_the_ripple_of_a_motor_into_the_joints_behind(
    tmp_path: Path,
) -> None:
    ripple = {"waveform": "harmonic", "amplitude_rad": 2e-4, "axes": [2, 4]}
    logs = run(tmp_path, errors={"cycloid_ripple": ripple})
    waves = [wave(40.0 * logs.gears[:, motor]) for motor in (1, 3) for wave in (np.sin, np.cos)]
    in_joints = np.array([fit(waves, error) for error in (logs.joints - logs.shown).T])
    phases = {r.axis: r.phase_rad for r in stated(tmp_path).transmission_error}
    carried = {
        2: [0.0, 1.0, -1.0, 0.0, 0.0, 0.0],
        4: [0.0, 0.0, 0.0, 1.0, 55 / 759, 55 * 62 / 41745],
    }
    # thesis App. A: rows 2 and 4 of the motor-to-joint matrix
    for k, (motor, shares) in enumerate(carried.items()):
        wave = in_joints[:, 2 * k] + 1j * in_joints[:, 2 * k + 1]
        found = wave * np.exp(-1j * phases[motor]) / 2e-4
        for joint, share in enumerate(shares):
            place = f"motor {motor} in joint {joint + 1}"
            assert abs(found[joint] - share) < WITHIN * (abs(share) or 1.0), place


def test_gears_rub_with_the_asked_coulomb_and_viscous_friction(tmp_path: Path) -> None:
    """Both ways over the same poses. Torque that comes late against the load, and a way back that
    is not quite the way out in reverse, both look like viscous friction: the load's rate and the
    accelerations are fitted with it.
    """
    path = path_there_and_back(tmp_path, [5, 2, 3, 3, 4], size=0.94)
    logs = run(
        tmp_path,
        duration=100.0,
        file=path,
        plant={"servo": "stiff"},
        errors={"gear_friction": {"scale": 1.2}},
    )
    velocity, gears = rate(logs.t, logs.shown_gears), logs.cell.robot.gears
    series = (logs.torque - logs.load, velocity, rate(logs.t, logs.load), rate(logs.t, velocity))
    friction, speed, load_rate, acceleration = (
        there_and_back(logs.t, values, 100.0) for values in series
    )
    for i in range(6):
        slides = np.abs(speed[:, i]) > 0.2 * np.abs(speed[:, i]).max()
        w = speed[slides, i]
        coulomb, viscous, latency, *_ = fit(
            [np.sign(w), w, -load_rate[slides, i], *acceleration[slides].T], friction[slides, i]
        )
        assert coulomb == pytest.approx(1.2 * gears.coulomb[i], rel=WITHIN), f"gear {i + 1}"
        assert viscous == pytest.approx(1.2 * gears.viscous[i], rel=WITHIN), f"gear {i + 1}"
        # [s] a step of the plant, whose servo answers the load of the step before
        assert abs(latency) < 1.2e-3


def test_slow_gears_rub_more_by_the_asked_break_away_friction_and_stribeck_speed(
    tmp_path: Path,
) -> None:
    """Axes 1 to 3; the lighter ones behind them stick and slip at such speeds."""
    path = path_there_and_back(tmp_path, [1, 1, 2, 1, 1], size=0.15)
    logs = run(
        tmp_path, file=path, plant={"servo": "stiff"}, errors={"gear_friction": {"stribeck": True}}
    )
    gears = logs.cell.robot.gears
    friction, speed = (
        there_and_back(logs.t, values, 60.0)
        for values in (logs.torque - logs.load, rate(logs.t, logs.shown_gears))
    )
    for i in range(3):
        w = np.abs(speed[:, i])
        slides = (w > 1e-3) & (np.abs(np.gradient(w)) < 1e-4)
        more = np.abs(friction[slides, i]) - gears.coulomb[i] - gears.viscous[i] * w[slides]
        (excess, speed_scale), _ = curve_fit(break_away, w[slides], more, p0=[5.0, 0.01])
        assert gears.coulomb[i] + excess == pytest.approx(gears.static[i], rel=WITHIN), (
            f"gear {i + 1}"
        )
        assert abs(speed_scale) == pytest.approx(gears.stribeck[i], rel=WITHIN), f"gear {i + 1}"


def break_away(w: Array, excess: float, stribeck: float) -> Array:
    """(N,) [N m] friction above Coulomb's at speeds (N,) [rad/s]."""
    return np.asarray(excess * np.exp(-((w / stribeck) ** 2)))


# --- ball-bar, plate and base


def rod_stretch(logs: Logs) -> Array:
    """(N,) [m] distance of the rigid robot's tool from the sphere."""
    reach = np.linalg.norm(logs.shown_robot.tip - logs.geometry.origin[:, None], axis=0)
    return np.asarray(reach - logs.geometry["bd3"])


def test_rod_and_both_joints_strain_by_8_micrometres_at_150_newtons(tmp_path: Path) -> None:
    logs = run(tmp_path, plant=SAGGING, errors={"rod_strain": {}})
    assert logs.rod_force.min() < -150.0
    slope, constant = fit([logs.rod_force, np.ones(logs.t.size)], rod_stretch(logs))
    assert 150.0 * slope == pytest.approx(8.3e-6, rel=WITHIN)  # thesis sec. 5.3
    assert abs(constant) < 5e-8


@pytest.mark.parametrize("gimbal", [None, 2e-5])
def test_the_joints_play_lies_between_push_and_pull(gimbal: float | None, tmp_path: Path) -> None:
    play = {"rod_strain": {}, "rod_backlash": {"gimbal_m": gimbal}}
    errors = {"static": {"table": "thesis_3_1"}} | play  # the static errors make it push and pull
    logs = run(tmp_path, duration=90.0, errors=errors)
    stretch, force, asked = rod_stretch(logs), logs.rod_force, (gimbal or 2.5e-6) + 2.5e-6
    loaded = np.abs(force) > 3.0
    assert min(force.max(), -force.min()) > 50.0
    slope, half = fit([force[loaded], np.sign(force[loaded])], stretch[loaded])
    assert 2.0 * half == pytest.approx(asked, rel=WITHIN)
    assert 150.0 * slope == pytest.approx(8.3e-6, rel=WITHIN)
    inside = np.abs(stretch) < 0.4 * asked
    assert inside.any()
    assert np.abs(force[inside]).max() < 2.0  # no force but that of inertia


def test_near_a_singularity_of_the_ballbar_the_force_oscillates_but_is_no_larger() -> None:
    """Thesis sec. 5.3, Fig. 5.7, which says that it is larger too (docs/thesis_figures.md)."""
    bands = [(0.0, 1.0), (1.0, 3.0), (3.0, 10.0), (10.0, 90.0)]
    force, oscillation = np.transpose(
        force_near_singularity(singular_passage(friction=True), bands)
    )
    assert (np.diff(oscillation) < 0.0).all()
    assert oscillation[0] > 10.0 * oscillation[-1]
    assert np.ptp(force) < 0.05 * force.max()


@pytest.mark.parametrize(("plate", "stiffness"), [("plate_250", 1.0e7), ("plate_250_thin", 1.67e6)])
def test_the_plate_bends_under_the_balls_force_by_10_or_60_micrometres_at_100_newtons(
    plate: str, stiffness: float, tmp_path: Path
) -> None:
    logs = run(
        tmp_path,
        cell=CELLS["irb2400"] | {"plate": plate},
        plant=SAGGING,
        errors={"plate_bending": {}},
    )
    robot, load = logs.shown_robot, logs.on_tool
    bent = np.sum((logs.tip - robot.tip) * robot.z[-1], axis=0)
    tilted = np.sum(pose_error(logs.bar.rotation(), logs.tip, robot)[3:] * robot.y[-1], axis=0)
    assert np.ptp(load[2]) > 80.0
    # A cantilever of length L under a force F and a moment M at its tip deflects by F / k + 3 M /
    # (2 k L) and tilts by 3 F / (2 k L), and so does the plant's hinge; the tilt of M alone is the
    # hinge's, 9 M / (4 k L^2), of a moment below 0.3 N m.
    lever = 1.5 / logs.cell.plate.length
    (across,) = fit([load[2] - lever * load[4]], bent)
    assert 1.0 / across == pytest.approx(stiffness, rel=WITHIN)
    (tilt,) = fit([lever * (load[4] * lever - load[2])], tilted)
    assert 1.0 / tilt == pytest.approx(stiffness, rel=WITHIN)


def test_the_base_of_the_ball_bar_is_equally_compliant_in_all_directions(tmp_path: Path) -> None:
    logs = run(
        tmp_path,
        duration=120.0,
        plant=SAGGING,
        errors={"base_compliance": {"stiffness_N_per_m": 3e7}},
    )
    shift = logs.shown_robot.tip - logs.tip
    weight = sum(link.mass for link in logs.cell.ballbar.links) * logs.cell.robot.gravity
    for axis in range(3):
        slope, constant = fit([logs.on_bar[axis], np.ones(logs.t.size)], shift[axis])
        assert 1.0 / slope == pytest.approx(3e7, rel=WITHIN)
        assert constant == pytest.approx(weight[axis] / 3e7, abs=2e-8)


# --- load logs


SILENT = PERFECT_LOGS["force_sensor"]
EXACT = PERFECT_LOGS["torque"]


@pytest.fixture(scope="module")
def loaded() -> Simulation:
    """A run whose forces any number of loggers may log."""
    return simulate(quiet(logs={"force_sensor": {}}), relative_to=SCENARIOS)


def quiet(**changes: Any) -> SimulationSettings:
    return settings(
        **({"errors": {}, "clocks": {"offset_s": 0.137, "skew": 5e-5}, "seed": 2} | changes)
    )


def written(loaded: Simulation, folder: Path, **logs: Any) -> Path:
    """The raw files of the run with other loggers."""
    asked = quiet(logs=logs)
    truth = loaded.truth
    log_truth = truth.logs.model_copy(update={"loads": drawn_loads(asked.logs, 6, asked.seed)})
    write_recording(
        replace(loaded, truth=truth.model_copy(update={"logs": log_truth})), asked, folder
    )
    return folder / "raw"


def force_log(loaded: Simulation, folder: Path, **changes: float) -> Array:
    return read_table(written(loaded, folder, force_sensor=SILENT | changes) / "force.csv")


def gear_torques(loaded: Simulation, folder: Path, **changes: float) -> Array:
    """(N, 6) [N m] logged torques, at the gears' outputs."""
    motor = read_table(written(loaded, folder, torque=EXACT | changes) / "robot.csv")[:, 7:]
    return motor / np.diag(loaded.cell.robot.transmission)


GROWTH = {"ra2": 6e-5, "rd4": -4e-5}  # [m] at the end
GROWN = {"thermal_growth": {"a2_m": GROWTH["ra2"], "d4_m": GROWTH["rd4"]}}


def at_the_end(geometry: Geometry) -> Geometry:
    return geometry.replaced({name: geometry[name] + size for name, size in GROWTH.items()})


def test_grown_links_turn_the_joints_and_leave_loads_and_ballbar_as_they_were(
    loaded: Simulation,
) -> None:
    before = loaded.motion
    grown = simulate(quiet(logs={"force_sensor": {}}, errors=GROWN), relative_to=SCENARIOS).motion
    assert np.array_equal(grown.rod_force, before.rod_force)
    assert np.array_equal(grown.b, before.b)
    assert np.allclose(grown.q - grown.shown, before.q - before.shown, rtol=0.0, atol=1e-12)
    assert np.abs(grown.q[0] - before.q[0]).max() < 1e-12
    held = robot_frames(before.geometry, before.q[-1:])
    turned = robot_frames(at_the_end(before.geometry), grown.q[-1:])
    assert np.abs(pose_error(held.rotation(), held.tip, turned)).max() < 1e-12
    assert np.abs(grown.q[-1] - before.q[-1]).max() > 2e-5
    assert max(error.max() for error in grown.closure()) < 5e-7


def test_a_wire_measures_the_growth_of_links_whose_tool_nothing_holds() -> None:
    errors: tuple[dict[str, Any], ...] = ({}, GROWN)
    before, grown = (
        simulate(wire_settings(errors=each), relative_to=SCENARIOS).motion for each in errors
    )
    assert np.array_equal(before.shown, grown.shown)
    longer = at_the_end(before.geometry)
    tool = robot_frames(longer, before.q[-1:]).tip[:, 0]
    length = np.linalg.norm(tool - longer.origin) - longer["bd3"]
    assert grown.rod_stretch[-1] == pytest.approx(length, abs=1e-12)
    assert abs(grown.rod_stretch[-1] - before.rod_stretch[-1]) > 1e-5


def test_gain_and_bias_are_one_number_a_channel_and_as_large_as_asked(
    loaded: Simulation, tmp_path: Path
) -> None:
    felt, torque = force_log(loaded, tmp_path / "f0")[:, 1:], gear_torques(loaded, tmp_path / "t0")
    found = []
    for size in (1.0, 2.0):
        asked = {"gain_sigma": 0.01 * size, "bias_N": 2.0 * size, "bias_N_m": 0.2 * size}
        read = force_log(loaded, tmp_path / f"f{size}", **asked)[:, 1:]
        shown = gear_torques(loaded, tmp_path / f"t{size}", gain_sigma=0.02 * size)
        channels = [*zip(felt.T, read.T, strict=True), *zip(torque.T, shown.T, strict=True)]
        found.append(np.array([line(*channel) for channel in channels]))
    (gain, bias), (twice_gain, twice_bias) = found[0].T, found[1].T
    force, motor = (load_truth(truth_path(tmp_path / name)).logs.loads for name in ("f1.0", "t1.0"))
    assert gain + 1.0 == pytest.approx([*force.force_gain, *motor.torque_gain], abs=1e-5)
    assert bias[:6] == pytest.approx(force.force_bias, abs=1e-3)
    assert twice_gain == pytest.approx(2.0 * gain, rel=WITHIN)
    assert twice_bias[:6] == pytest.approx(2.0 * bias[:6], rel=WITHIN)
    assert np.abs(gain).min() > 1e-4
    assert np.abs(bias[6:]).max() < 1e-3  # [N m] torques have none but the rounding of their file


def line(clean: Array, read: Array) -> tuple[float, float]:
    """Gain error and bias; nothing else lies between the two."""
    gain, bias = fit([clean, np.ones(clean.size)], read)
    assert np.abs(read - gain * clean - bias).max() < 1e-4 + 1e-5 * np.abs(read).max()
    return gain - 1.0, bias


# --- one source leaves all others alone


EFFECTS: dict[str, dict[str, Any]] = {
    "joint_compliance": {"spread": 0.3},
    "transmission_error": {},
    "cycloid_ripple": {},
    "sinusoidal_gear_error": {},
    "gear_friction": {},
    "rod_strain": {},
    "rod_backlash": {},
    "bar_friction": {},
    "plate_bending": {},
    "base_compliance": {},
    "unlisted_ripple": {},
    "masses": {},
    "payload": {},
    "motor_offsets": {},
    "joint_lag": {},
    "thermal_growth": {},
    "signal_noise": {},
}
# play needs the spring
PLAY = {"joint_compliance": {"spread": 0.3}, "gear_backlash": {"spread": 0.3}}
LOGS: dict[str, dict[str, Any]] = {"torque": {}, "force_sensor": {}}
OWN_STREAMS = {
    "joint_compliance": {"joint_compliance"},
    "gear_backlash": {"lost_motion"},
    "transmission_error": {"transmission_error"},
    "cycloid_ripple": {"cycloid_ripple"},
    "sinusoidal_gear_error": {"sinusoidal_gear_error"},
    "unlisted_ripple": {"unlisted_ripple"},
    "masses": {"masses"},
    "payload": {"payload"},
    "motor_offsets": {"motor_offsets"},
    "joint_lag": {"joint_lag"},
    "signal_noise": {f"signal_noise_b{j}" for j in range(1, 6)},
    "torque": {"torque_gain", "torque_noise"},
    "force_sensor": {"force_sensor_mounting", "force_sensor_noise"},
}
NOISY: dict[str, Any] = {
    "static": {"sigma_m": 1e-3, "sigma_rad": 1e-3},
    "joint_noise": {"sigma_rad": 1e-5},
    "resolver_error": {},
    "encoder_eccentricity": {},
    "subdivisional_error": {},
}


class NotedGenerator:
    """A generator that keeps a copy of what it gives."""

    def __init__(self, rng: np.random.Generator, given: list[Any]) -> None:
        self._rng, self._given = rng, given

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def draw(*args: Any, **kwargs: Any) -> Any:
            values = getattr(self._rng, name)(*args, **kwargs)
            self._given.append(np.array(values))
            return values

        return draw


Draws = dict[int, list[Any]]  # all that was drawn, by the number of its stream


def draws(folder: Path, errors: dict[str, Any], logs: dict[str, Any]) -> Draws:
    """Draws of a short noisy run with these sources; each stream is opened once."""
    drawn: Draws = {}
    genuine, path = np.random.default_rng, path_there_and_back(folder, [1, 1, 1, 1, 1], size=0.05)

    def noted(key: list[int]) -> Any:
        seed, source = key
        assert seed == 7
        assert source not in drawn
        drawn[source] = []
        return NotedGenerator(genuine(key), drawn[source])

    chosen: dict[str, Any] = {
        "path": lissajous(path, 8.0, dwell_s=1.0),
        "errors": NOISY | errors,
        "logs": logs,
        "clocks": {"offset_s": 0.137, "overrun_probability": 0.05, "jitter": {}, "wander": {}},
        "encoders": {"noise_sigma_rad": 1e-5},
        "seed": 7,
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np.random, "default_rng", noted)
        record(folder / "recording", **chosen)
    return drawn


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> tuple[Draws, Path]:
    folder = tmp_path_factory.mktemp("plain")
    return draws(folder, {}, {}), folder / "recording"


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> Draws:
    return draws(tmp_path_factory.mktemp("everything"), EFFECTS | PLAY, LOGS)


def assert_same(some: Draws, others: Draws, sources: set[int]) -> None:
    for source in sources:
        for one, other in zip(some[source], others[source], strict=True):
            assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("source", [*EFFECTS, "gear_backlash", *LOGS])
def test_a_plant_effect_or_load_log_draws_from_its_own_stream_only(
    source: str, plain: tuple[Draws, Path], everything: Draws, tmp_path: Path
) -> None:
    errors = (
        PLAY if source == "gear_backlash" else {k: v for k, v in EFFECTS.items() if k == source}
    )
    alone = draws(tmp_path, errors, {source: LOGS[source]} if source in LOGS else {})
    before, after = set(plain[0]), set(alone)
    own = {
        zlib.crc32(name.encode())
        for effect in (source, *errors)
        for name in OWN_STREAMS.get(effect, set())
    }
    assert after - before == own
    assert len(before) > 10
    assert_same(alone, plain[0], before)
    assert_same(alone, everything, after)


@pytest.mark.parametrize("log", list(LOGS))
def test_a_load_log_changes_nothing_in_the_other_files_and_columns(
    log: str, plain: tuple[Draws, Path], tmp_path: Path
) -> None:
    draws(tmp_path, {}, {log: LOGS[log]})
    raw, raw_plain = tmp_path / "recording" / "raw", plain[1] / "raw"
    assert (raw / "ballbar.csv").read_bytes() == (raw_plain / "ballbar.csv").read_bytes()
    rows, rows_plain = (
        (folder / "robot.csv").read_text().splitlines() for folder in (raw, raw_plain)
    )
    assert [",".join(row.split(",")[:7]) for row in rows] == rows_plain


# --- what cannot be simulated


@pytest.mark.parametrize(
    ("section", "name"),
    [*(("errors", name) for name in WITH_FORCES if name != "gear_backlash")]
    + [("logs", name) for name in LOGS],
)
def test_the_kinematic_plant_refuses_what_needs_forces(section: str, name: str) -> None:
    chosen = settings(plant={"kind": "kinematic"}, **{section: {name: {}}})
    words = rf"{section}.{name}: needs forces, and plant.kind = kinematic has none. Use plant.kind"
    with pytest.raises(InputError, match=words):
        simulate(chosen, relative_to=SCENARIOS)


@pytest.mark.parametrize("kind", ["kinematic", "mujoco"])
def test_play_in_rigid_gears_is_refused(kind: str) -> None:
    with pytest.raises(InputError, match=r"errors.gear_backlash: needs joint_compliance beside it"):
        simulate(
            settings(plant={"kind": kind}, errors={"gear_backlash": {}}), relative_to=SCENARIOS
        )
