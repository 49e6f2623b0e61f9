"""Every plant effect and every load log comes out of the device files as it was put into the scenario.

One effect is on at a time, noise is off, and the analysis (tests.log_analysis) knows statics and nothing of the plant. A truth
file gives clocks, encoder zeros and kinematic parameters; where something is drawn, it says what was drawn.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cell.chain import Array
from cell.descriptions import Cell, joints_to_motors, load_cell
from cell.errors import InputError
from cell.inverse import pose_mismatch
from sim.load_logs import ForceSensor, LoadLogs, TorqueLog, motor_torques, sensor_rows
from sim.motion import Motion
from sim.plant_effects import PlantErrors, plant_effects
from sim.simulate import Simulation, simulate, truth_path, write_recording
from sim.truth import PlantTruth, load_truth
from tests.conftest import SCENARIOS, record, settings
from tests.log_analysis import Logs, fit, harmonics, rate, read_logs, read_table, settled_direction, there_and_back

WITHIN = 0.01  # of what was asked for
CELLS: dict[str, dict[str, Any]] = {
    "irb2400": {"robot": "irb2400", "ballbar": "lund_600", "ballbar_position_m": [0.70, 0.0, 0.54]},
    "nj220": {"robot": "nj220", "ballbar": "lund_900", "ballbar_position_m": [1.50, 0.0, 0.70]},
}
PERFECT_LOGS = {
    "torque": {"noise_N_m": 0.0, "wrist_noise_N_m": 0.0, "gain_sigma": 0.0},
    "force_sensor": {"rate_hz": 100.0, "noise_N": 0.0, "noise_N_m": 0.0, "bias_N": 0.0, "bias_N_m": 0.0, "gain_sigma": 0.0},
}
SAGGING = {"gravity_compensation": False}  # a soft servo that does not carry the arm leans on the rod with up to 170 N
CENTRE = np.array([-23.2, -54.3, 20.8, -129.6, 138.0])  # [deg] scenarios/paths/irb2400_a.yaml
AMPLITUDE = np.array([75.9, -19.6, 31.0, -18.2, 87.4])  # [deg]


def run(folder: Path, *, robot: str = "irb2400", duration: float = 120.0, file: str = "", **changes: Any) -> Logs:
    """The files of a run without any error but those that `changes` switch on, every log perfect."""
    base: dict[str, Any] = {
        "cell": CELLS[robot],
        "path": {"kind": "lissajous", "file": file or f"paths/{robot}_a.yaml", "duration_s": duration, "dwell_s": 2.0, "stops": 0},
        "errors": {},
        "encoders": {"bits": 13},
        "clocks": {"offset_s": 0.137, "skew": 5e-5},
        "logs": PERFECT_LOGS,
    }
    return read_logs(record(folder / "recording", **(base | changes)).folder)


def path_there_and_back(folder: Path, cycles: list[int], *, size: float) -> str:
    """A path whose second half is its first in reverse: every angle starts at an extreme."""
    place = folder / "path.yaml"
    lists = {"centre_deg": CENTRE, "amplitude_deg": (size * AMPLITUDE).round(2), "cycles": np.array(cycles)}
    lines = [f"{name}: {values.tolist()}" for name, values in lists.items()]
    place.write_text("\n".join(["schema: ballbar-path/1", *lines, "phase_deg: [90, -90, 90, 90, -90]"]))
    return str(place)


def stated(folder: Path) -> PlantTruth:
    """What was drawn."""
    return load_truth(truth_path(folder / "recording")).plant


# --- the logs themselves


def test_at_rest_the_logged_torques_carry_the_arm_and_what_the_force_sensor_feels(tmp_path: Path) -> None:
    logs = run(tmp_path, duration=30.0, plant=SAGGING)
    still = logs.t < 1.5
    assert np.abs(logs.torque[still] - logs.load[still]).max() < 1e-3  # of 400 N m; the files have 1e-6 N m at the motor
    assert np.abs(logs.rod_force[still]).min() > 40.0


# --- gears


def assert_stiffness(logs: Logs, expected: Array) -> None:
    """Of every gear, from what lies between the ball-bar's pose and the motors, and the motor's torque."""
    deflection = logs.gears - logs.shown_gears
    speed, rotor = rate(logs.t, deflection), rate(logs.t, rate(logs.t, logs.shown_gears))
    for i in range(6):
        found = fit([-deflection[:, i], -speed[:, i], rotor[:, i]], logs.torque[:, i])[0]
        assert found == pytest.approx(expected[i], rel=WITHIN), f"gear {i + 1}"


@pytest.mark.parametrize("robot", list(CELLS))
def test_each_gear_yields_to_its_torque_by_the_asked_stiffness(robot: str, tmp_path: Path) -> None:
    logs = run(tmp_path, robot=robot, plant=SAGGING, errors={"joint_compliance": {"scale": 0.8}})
    assert_stiffness(logs, 0.8 * logs.cell.robot.gears.stiffness)


def test_a_robot_with_a_spread_of_stiffnesses_has_those_that_its_truth_states(tmp_path: Path) -> None:
    logs = run(tmp_path, plant=SAGGING, errors={"joint_compliance": {"spread": 0.3}})
    drawn = np.array(stated(tmp_path).gear_stiffness_N_m_per_rad)
    assert np.abs(np.log(drawn / logs.cell.robot.gears.stiffness)).min() > 0.02
    assert_stiffness(logs, drawn)


def test_stiffness_and_lost_motion_spread_as_asked_from_robot_to_robot(cell: Cell) -> None:
    asked = PlantErrors.model_validate({"joint_compliance": {"spread": 0.3}, "lost_motion": {"spread": 0.2}})
    drawn = [plant_effects(asked, cell, seed) for seed in range(8000)]  # 48 000 logarithms: their sigma is known to 0.3 %
    stiffness = np.log([e.gear_stiffness / cell.robot.gears.stiffness for e in drawn if e.gear_stiffness is not None])
    width = np.log([2.0 * e.gear_slack / cell.robot.gears.lost_motion for e in drawn])
    assert stiffness.std() == pytest.approx(0.3, rel=WITHIN)
    assert width.std() == pytest.approx(0.2, rel=WITHIN)
    assert abs(np.corrcoef(stiffness.ravel(), width.ravel())[0, 1]) < 0.02


def test_a_gear_with_play_jumps_by_the_asked_width_where_its_load_changes_sign(tmp_path: Path) -> None:
    errors = {"joint_compliance": {"scale": 0.3}, "lost_motion": {"scale": 0.9}}
    logs = run(tmp_path, plant=SAGGING, errors=errors)
    deflection, asked = logs.gears - logs.shown_gears, 0.9 * logs.cell.robot.gears.lost_motion
    speed, rotor = rate(logs.t, deflection), rate(logs.t, rate(logs.t, logs.shown_gears))
    for i in range(6):
        through = np.abs(deflection[:, i]) > 0.75 * asked[i]
        e, side = deflection[through, i], np.sign(deflection[through, i])
        stiffness, preload, *_ = fit([-e, side, -speed[through, i], rotor[through, i]], logs.torque[through, i])
        assert 2.0 * preload / stiffness == pytest.approx(asked[i], rel=WITHIN), f"gear {i + 1}"
        floating = np.abs(logs.torque[:, i]) < 0.2  # N m; the rest of the dead band is passed too fast to be seen at rest
        assert np.abs(deflection[floating, i]).max(initial=0.0) < 0.55 * asked[i]


def test_a_gear_with_hysteresis_lags_by_the_asked_width_between_loading_and_unloading(tmp_path: Path) -> None:
    errors = {"joint_compliance": {"scale": 0.3}, "lost_motion": {"kind": "hysteresis"}}
    logs = run(tmp_path, plant=SAGGING, errors=errors)
    deflection, asked = logs.gears - logs.shown_gears, logs.cell.robot.gears.lost_motion
    speed, rotor = rate(logs.t, deflection), rate(logs.t, rate(logs.t, logs.shown_gears))
    for i in range(6):
        way = settled_direction(deflection[:, i], 1.2 * asked[i])
        on = way != 0.0
        assert min((way > 0.0).mean(), (way < 0.0).mean()) > 0.05
        stiffness, half, *_ = fit([-deflection[on, i], -way[on], -speed[on, i], rotor[on, i]], logs.torque[on, i])
        assert 2.0 * half / stiffness == pytest.approx(asked[i], rel=WITHIN), f"gear {i + 1}"


def assert_ripples(logs: Logs, asked: list[list[tuple[float, float]]], folder: Path) -> None:
    """Amplitude of each (order, amplitude) of each gear as asked, phase as drawn."""
    drawn = {(r.axis, r.cycles_per_turn): r.phase_rad for r in stated(folder).transmission_error}
    for i, gear in enumerate(asked):
        error = logs.gears[:, i] - logs.shown_gears[:, i]
        orders = [order for order, _ in gear]
        if not orders:
            assert np.abs(error).max() < 1e-6
            continue
        for found, (order, amplitude) in zip(harmonics(logs.gears[:, i], error, orders), gear, strict=True):
            place = f"gear {i + 1}, {order:g} cycles a turn"
            assert abs(found) == pytest.approx(amplitude, rel=WITHIN), place
            assert abs(found - amplitude * np.exp(1j * drawn[i + 1, order])) < WITHIN * amplitude, place


@pytest.mark.parametrize("robot", list(CELLS))
def test_each_harmonic_of_the_gears_lies_between_motor_and_pose(robot: str, tmp_path: Path) -> None:
    logs = run(tmp_path, robot=robot, errors={"transmission_error": {"scale": 1.5}})
    asked = [[(order, 1.5 * amplitude) for order, amplitude in gear] for gear in logs.cell.robot.gears.harmonics]
    assert_ripples(logs, asked, tmp_path)


def test_a_cycloid_drive_ripples_as_a_sine_on_the_asked_axes_only(tmp_path: Path) -> None:
    ripple = {"waveform": "harmonic", "amplitude_rad": 8e-5, "lobes": 39.5, "axes": [1, 3]}
    logs = run(tmp_path, duration=60.0, errors={"cycloid_ripple": ripple})
    assert_ripples(logs, [[(39.5, 8e-5)], [], [(39.5, 8e-5)], [], [], []], tmp_path)


def test_a_cusped_ripple_is_the_rectified_sine_with_zero_mean(tmp_path: Path) -> None:
    logs = run(tmp_path, errors={"cycloid_ripple": {"amplitude_rad": 6e-5}})
    error = logs.gears - logs.shown_gears
    for i in range(3):
        found = harmonics(logs.gears[:, i], error[:, i], [40.0, 80.0, 120.0, 160.0])
        series = [2.0 * 6e-5 / (4 * k * k - 1) for k in range(1, 5)]  # of pi/2 |sin(x/2)| - 1, truncated
        assert np.abs(found) == pytest.approx(series, rel=WITHIN)
        x = 40.0 * logs.gears[:, i] + np.angle(found[0]) + 0.5 * np.pi
        away = np.abs(np.sin(0.5 * x)) > 0.5
        assert error[away, i] / 6e-5 == pytest.approx(0.5 * np.pi * np.abs(np.sin(0.5 * x[away])) - 1.0, abs=0.02)
        cusp = -np.interp(0.0, np.sort(np.abs(np.sin(0.5 * x))), error[np.argsort(np.abs(np.sin(0.5 * x))), i])
        assert cusp / 6e-5 == pytest.approx(1.0 - 0.111, abs=0.01)  # four terms reach 8/9 of the peak


@pytest.mark.parametrize("side", ["output", "input"])
def test_an_eccentric_gear_errs_once_a_turn_of_its_output_or_its_motor(side: str, tmp_path: Path) -> None:
    logs = run(tmp_path, duration=60.0, errors={"sinusoidal_gear_error": {"side": side, "amplitude_rad": 9e-5, "axes": [1, 2, 3, 4, 5, 6]}})
    turns = [129.6, 129.99, 129.6, 55.0, 55.2, 44.0] if side == "input" else [1.0] * 6  # thesis App. A
    assert_ripples(logs, [[(turn, 9e-5)] for turn in turns], tmp_path)


def test_parallel_rod_and_wrist_carry_the_ripple_of_a_motor_into_the_joints_behind(tmp_path: Path) -> None:
    ripple = {"waveform": "harmonic", "amplitude_rad": 2e-4, "axes": [2, 4]}
    logs = run(tmp_path, duration=60.0, errors={"cycloid_ripple": ripple})
    error = logs.joints - logs.shown
    for motor, shares in {2: [0.0, 1.0, -1.0, 0.0, 0.0, 0.0], 4: [0.0, 0.0, 0.0, 1.0, 55 / 759, 55 * 62 / 41745]}.items():
        phase = next(r.phase_rad for r in stated(tmp_path).transmission_error if r.axis == motor)
        for joint, share in enumerate(shares):  # thesis App. A: rows 2 and 4 of the motor-to-joint matrix
            behind = harmonics(logs.gears[:, motor - 1], error[:, joint], [40.0])[0] * np.exp(-1j * phase)
            assert abs(behind - 2e-4 * share) < WITHIN * 2e-4 * (abs(share) or 1.0), f"motor {motor} in joint {joint + 1}"


def friction_of(logs: Logs, end: float) -> tuple[Array, Array, Array]:
    """Speeds (K, 6) [rad/s] of the gears, (K, 6) [N m] their friction, and (K, 6) [N m/s] how fast the load changes.

    The stiff servo follows both ways to 0.1 mrad.
    """
    own, loads = logs.torque - logs.load, rate(logs.t, logs.load)
    out, friction = there_and_back(logs.t, own, end)
    _, speed = there_and_back(logs.t, rate(logs.t, logs.shown_gears), end)
    _, change = there_and_back(logs.t, loads, end)
    assert out.size > 1000
    return speed, friction, change


def test_gears_rub_with_the_asked_coulomb_and_viscous_friction(tmp_path: Path) -> None:
    """Torque may come late against load by some latency, which looks like viscous friction of dload/dangle; it is fitted too."""
    path = path_there_and_back(tmp_path, [5, 2, 3, 3, 4], size=0.94)
    logs = run(tmp_path, file=path, plant={"servo": "stiff"}, errors={"gear_friction": {"scale": 1.2}})
    speed, friction, change = friction_of(logs, 120.0)
    gears = logs.cell.robot.gears
    for i in range(6):
        slides = np.abs(speed[:, i]) > 0.03
        w = speed[slides, i]
        coulomb, viscous, late = fit([np.sign(w), w, change[slides, i]], friction[slides, i])
        assert coulomb == pytest.approx(1.2 * gears.coulomb[i], rel=WITHIN), f"gear {i + 1}"
        print(i, coulomb / (1.2 * gears.coulomb[i]) - 1, viscous / (1.2 * gears.viscous[i]) - 1, late)
        assert viscous == pytest.approx(1.2 * gears.viscous[i], rel=WITHIN), f"gear {i + 1}"


# --- ball-bar, plate and base


def rod_stretch(logs: Logs) -> Array:
    """(N,) [m] distance of the rigid robot's tool from the sphere's centre, less the rod's length."""
    reach = np.linalg.norm(logs.shown_robot.tip - logs.geometry.origin[:, None], axis=0)
    return np.asarray(reach - logs.geometry["bd3"])


def test_rod_and_joints_strain_by_5_micrometres_and_a_half_at_150_newtons(tmp_path: Path) -> None:
    logs = run(tmp_path, plant=SAGGING)
    assert logs.rod_force.min() < -150.0
    slope, constant = fit([logs.rod_force, np.ones(logs.t.size)], rod_stretch(logs))
    assert 1.0 / slope == pytest.approx(2.7e7, rel=WITHIN)
    assert 150.0 * slope == pytest.approx(5.556e-6, rel=WITHIN)  # thesis sec. 5.3: 5.5 um
    assert abs(constant) < 5e-8


@pytest.mark.parametrize("width", [None, 2e-5])
def test_the_rods_play_lies_between_push_and_pull(width: float | None, tmp_path: Path) -> None:
    errors = {"static": {"table": "thesis_3_1"}, "rod_backlash": {"width_m": width}}  # the static errors make it push and pull
    logs = run(tmp_path, errors=errors)
    stretch, force, asked = rod_stretch(logs), logs.rod_force, width or 5e-6
    loaded = np.abs(force) > 3.0
    assert min(force.max(), -force.min()) > 50.0
    slope, half = fit([force[loaded], np.sign(force[loaded])], stretch[loaded])
    assert 2.0 * half == pytest.approx(asked, rel=WITHIN)
    assert 1.0 / slope == pytest.approx(2.7e7, rel=WITHIN)
    slack = np.abs(stretch) < 0.4 * asked
    assert slack.any()
    assert np.abs(force[slack]).max() < 1.0  # no force but that of inertia


@pytest.mark.parametrize(("plate", "stiffness"), [("plate_250", 1.0e7), ("plate_250_thin", 1.67e6)])
def test_the_plate_bends_under_the_balls_force_by_10_or_60_micrometres_at_100_newtons(plate: str, stiffness: float, tmp_path: Path) -> None:
    logs = run(tmp_path, cell=CELLS["irb2400"] | {"plate": plate}, plant=SAGGING, errors={"plate_bending": {}})
    robot, load = logs.shown_robot, logs.on_tool
    bent = np.sum((logs.tip - robot.tip) * robot.z[-1], axis=0)
    tilted = np.sum(pose_mismatch(logs.bar.rotation(), logs.tip, robot)[3:] * robot.y[-1], axis=0)
    assert np.ptp(load[2]) > 80.0
    # cantilever of length L under a force F and a moment M at its tip: F / k + 3 M / (2 k L) across, 3 F / (2 k L) + 3 M / (k L^2) tilt
    lever = 1.5 / logs.cell.plate.length
    (across,) = fit([load[2] - lever * load[4]], bent)
    assert 1.0 / across == pytest.approx(stiffness, rel=WITHIN)
    (tilt,) = fit([lever * (load[4] * lever - load[2])], tilted)
    assert 1.0 / tilt == pytest.approx(stiffness, rel=WITHIN)


def test_a_plate_of_asked_stiffness_is_not_that_of_its_file(tmp_path: Path) -> None:
    logs = run(tmp_path, plant=SAGGING, errors={"plate_bending": {"tip_stiffness_N_per_m": 4e6}})
    robot, load = logs.shown_robot, logs.on_tool
    (across,) = fit([load[2] - 1.5 / 0.250 * load[4]], np.sum((logs.tip - robot.tip) * robot.z[-1], axis=0))
    assert 1.0 / across == pytest.approx(4e6, rel=WITHIN)


def test_the_balls_base_gives_way_alike_in_all_directions(tmp_path: Path) -> None:
    logs = run(tmp_path, plant=SAGGING, errors={"base_compliance": {"stiffness_N_per_m": 3e7}})
    shift = logs.shown_robot.tip - logs.tip
    weight = sum(link.mass for link in logs.cell.ballbar.links) * logs.cell.robot.gravity
    for axis in range(3):
        slope, constant = fit([logs.on_bar[axis], np.ones(logs.t.size)], shift[axis])
        assert 1.0 / slope == pytest.approx(3e7, rel=WITHIN)
        assert constant == pytest.approx(weight[axis] / 3e7, abs=2e-8)


def test_each_joint_of_the_ballbar_rubs_with_the_asked_torque(tmp_path: Path) -> None:
    path = path_there_and_back(tmp_path, [5, 2, 3, 3, 4], size=0.94)
    logs = run(tmp_path, file=path, errors={"bar_friction": {"torque_N_m": 0.08}})
    _, friction = there_and_back(logs.t, logs.bar_load, 120.0)
    _, speed = there_and_back(logs.t, rate(logs.t, logs.b), 120.0)
    for j in range(5):
        slides = np.abs(speed[:, j]) > 0.02
        coulomb, _ = fit([np.sign(speed[slides, j]), speed[slides, j]], friction[slides, j])
        assert coulomb == pytest.approx(0.08, rel=WITHIN), f"joint b{j + 1}"


# --- load logs


@pytest.fixture(scope="module")
def loaded() -> Simulation:
    """A short run whose forces any number of loggers may log."""
    return simulate(settings(path={**SLOW, "duration_s": 30.0}, errors={}, logs={"force_sensor": {}}), relative_to=SCENARIOS)


SLOW: dict[str, Any] = {"kind": "lissajous", "file": "paths/irb2400_a.yaml", "duration_s": 60.0, "dwell_s": 2.0, "stops": 0}
SILENT = {"noise_N": 0.0, "noise_N_m": 0.0, "bias_N": 0.0, "bias_N_m": 0.0, "gain_sigma": 0.0}
EXACT = PERFECT_LOGS["torque"]


def written(loaded: Simulation, folder: Path, **logs: Any) -> Path:
    """The raw files of the run with other loggers."""
    write_recording(loaded, settings(errors={}, logs=logs), folder)
    return folder / "raw"


def test_the_force_sensor_has_its_own_rate_and_begins_when_it_was_asked_to(loaded: Simulation, tmp_path: Path) -> None:
    early = read_table(written(loaded, tmp_path / "a", force_sensor=SILENT | {"rate_hz": 250.0, "offset_s": 0.1}) / "force.csv")
    late = read_table(written(loaded, tmp_path / "b", force_sensor=SILENT | {"rate_hz": 250.0, "offset_s": 0.3}) / "force.csv")
    assert np.diff(early[:, 0]) == pytest.approx(1.0 / 250.0, abs=1.1e-6)
    assert np.abs(early[50 : 50 + 5000, 1:] - late[:5000, 1:]).max() < 1.1e-5  # 0.2 s later, 50 rows
    assert early[0, 0] == late[0, 0]  # its clock starts with it
    at_row = CubicSplineOfForce(loaded)
    assert np.abs(early[:, 1:] - at_row(0.1 + np.arange(len(early)) / 250.0)).max() < 1.1e-5


def CubicSplineOfForce(loaded: Simulation) -> Callable[[Array], Array]:
    raise NotImplementedError
