"""Logged loads: motor torques and force logs are read as written, and bad ones refused."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.recording import Recording, read_force, read_recording
from ballbar.acquisition.report import report_lines
from ballbar.acquisition.sources import ImportLog
from ballbar.cell.errors import LogError
from ballbar.cell.load import load_robot
from ballbar.cell.logs import ForceLog, RobotLog
from ballbar.cell.recording import SourceFile
from ballbar.sim.logging.load_logs import drawn_loads, sensor_rows
from ballbar.sim.recording_files import write_recording
from tests.helpers.device_logs import (
    FORCE_T,
    ROBOT,
    ROBOT_T,
    force_lines,
    joint_trajectory,
    put,
    robot_lines,
    summaries,
    wrench_trajectory,
    write,
)
from tests.helpers.simulated_recordings import Recorded, record, settings

TAU = ["tau1", "tau2", "tau3", "tau4", "tau5", "tau6"]
PERFECT = {
    "torque": {"noise_N_m": 0.0, "wrist_noise_N_m": 0.0, "gain_sigma": 0.0},
    "force_sensor": {
        "noise_N": 0.0,
        "noise_N_m": 0.0,
        "bias_N": 0.0,
        "bias_N_m": 0.0,
        "gain_sigma": 0.0,
    },
}


def motor_torque_trajectory() -> np.ndarray:
    """(N, 6) [N m at the motor], different for each motor."""
    return np.random.default_rng(3).normal(0.0, 2.0, (ROBOT_T.size, 6)) + np.arange(6)


def torque_lines(names: list[str] = TAU) -> list[str]:
    """The robot log with a column of torques for each name."""
    lines = robot_lines()
    cells = (",".join(map(repr, row[: len(names)])) for row in motor_torque_trajectory().tolist())
    return [
        ",".join((lines[0], *names)),
        *(f"{line},{added}" for line, added in zip(lines[1:], cells, strict=True)),
    ]


def with_force(data: dict) -> None:
    data["sources"]["force"] = {"files": ["raw/force.csv"], "dialect": "force-torque"}


def write_force(
    folder: Path, lines: list[str] | None = None, *, change: Callable[[dict], object] = with_force
) -> Path:
    """A recording with a force sensor."""
    write(folder, change=change)
    (folder / "raw/force.csv").write_text("\n".join(lines or force_lines()) + "\n")
    return folder


def force_log(recording: Recording) -> ForceLog:
    assert recording.force_log is not None
    return recording.force_log


# --- what the simulator wrote


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """The short run with torques and force sensor."""
    return record(
        tmp_path_factory.mktemp("loads") / "recording", logs={"torque": {}, "force_sensor": {}}
    )


def test_a_simulated_force_log_is_read_as_it_was_written(loaded: Recorded) -> None:
    recording, simulation = read_recording(loaded.folder), loaded.simulation
    sensor, true = loaded.settings.logs.force_sensor, simulation.times.robot_true
    assert sensor is not None
    stamps, readings = sensor_rows(
        simulation.motion,
        float(true[0]),
        float(true[-1]),
        sensor=sensor,
        drawn=simulation.truth.logs.loads,
        seed=loaded.settings.seed,
    )
    # The file has 1e-6 s and 1e-5 N; 2 ms steps are whole microseconds, and 1e-12 s is float64 at
    # an up-time of a minute.
    np.testing.assert_allclose(force_log(recording).t, stamps - stamps[0], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(force_log(recording).wrench, readings, rtol=0.0, atol=0.51e-5)
    assert [
        (file.file, file.source, file.rows_read, file.rows_kept) for file in recording.report.files
    ][2:] == [("raw/force.csv", "force", stamps.size, stamps.size)]
    assert [entry for entry in recording.report.findings if entry.file == "raw/force.csv"] == []


def test_simulated_torques_and_forces_are_those_of_the_plant(
    loaded: Recorded, tmp_path: Path
) -> None:
    """Same run, loggers without noise, gain or bias: the loads read are those of the plant."""
    perfect = settings(logs=PERFECT)
    truth = loaded.simulation.truth
    quiet = truth.logs.model_copy(update={"loads": drawn_loads(perfect.logs, 6, perfect.seed)})
    write_recording(
        replace(loaded.simulation, truth=truth.model_copy(update={"logs": quiet})),
        perfect,
        tmp_path / "recording",
    )
    recording = read_recording(tmp_path / "recording")
    motion, times, rows = (
        loaded.simulation.motion,
        loaded.simulation.times,
        loaded.simulation.rows.robot,
    )
    assert motion.torque is not None
    assert motion.wrench is not None
    assert recording.robot_log.torque is not None
    at_gears = np.stack(
        [np.interp(times.robot_true[rows], motion.t, column) for column in motion.torque.T], axis=1
    )
    # The file has 1e-6 N m at the motor.
    rounding = 0.51e-6 / np.abs(np.diag(loaded.simulation.cell.robot.transmission))
    assert (np.abs(recording.robot_log.torque - at_gears) < rounding).all()
    assert np.abs(at_gears).max() > 100.0  # [N m] the weight of the arm
    begin = float(times.robot_true[0]) + 0.05  # offset_s of the sensor's log
    felt = np.stack(
        [np.interp(begin + force_log(recording).t, motion.t, column) for column in motion.wrench.T],
        axis=1,
    )
    np.testing.assert_allclose(force_log(recording).wrench, felt, rtol=0.0, atol=0.6e-5)


@pytest.mark.slow
def test_torques_behind_the_gears_are_the_same_ones(tmp_path: Path) -> None:
    """Logged at the motors and, by EGM, on the arm side along the controller's axis angles."""
    logs = [{"torque": {}, "robot": {"dialect": d}} for d in ("abb-motor", "abb-egm-torque")]
    motor, axis = (
        read_recording(record(tmp_path / str(k), logs=log).folder).robot_log.torque
        for k, log in enumerate(logs)
    )
    assert motor is not None
    assert axis is not None
    assert np.abs(motor).max() > 100.0  # [N m] the weight of the arm
    rounding = 0.51e-6 / np.abs(np.diag(ROBOT.transmission))
    assert (np.abs(axis - motor) < rounding).all()


def test_logs_without_loads_have_none(recorded: Recorded) -> None:
    recording = read_recording(recorded.folder)
    assert recording.robot_log.torque is None
    assert recording.force_log is None


# --- motor torques


@pytest.mark.parametrize("robot", ["irb2400", "nj220"])
def test_gears_pass_on_the_power_of_the_motors(tmp_path: Path, robot: str) -> None:
    """Torque times turn is the same at each motor and at its gear's output."""
    described = load_robot(robot)
    motors = np.linalg.solve(described.transmission.T, joint_trajectory(ROBOT_T).T).T
    torques = motor_torque_trajectory()
    rows = np.column_stack((100.0 + ROBOT_T, motors, torques)).tolist()
    lines = [",".join((robot_lines()[0], *TAU)), *(",".join(map(repr, row)) for row in rows)]
    log = read_recording(write(tmp_path, robot=lines, change=put("robot", value=robot))).robot_log
    assert log.torque is not None
    gears = log.q @ described.joint_to_gear
    at_motors, at_gears = (
        torques[1:] * np.diff(motors, axis=0),
        log.torque[1:] * np.diff(gears, axis=0),
    )
    # Differences of angles below 1e3 rad in float64, times a torque of 10 N m.
    np.testing.assert_allclose(at_gears, at_motors, rtol=0.0, atol=1e-11)


def test_torque_columns_stand_anywhere_and_bring_no_finding(tmp_path: Path) -> None:
    order = [7, 12, 0, 3, 2, 1, 11, 4, 5, 6, 10, 9, 8]
    shuffled = [";".join(line.split(",")[i] for i in order) for line in torque_lines()]
    recording = read_recording(write(tmp_path, robot=shuffled))
    np.testing.assert_allclose(
        recording.robot_log.torque,
        motor_torque_trajectory() / np.diag(ROBOT.transmission),
        rtol=1e-15,
    )
    np.testing.assert_allclose(recording.robot_log.q, joint_trajectory(ROBOT_T), atol=1e-13)
    assert summaries(recording) == []


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (
            TAU[:4],
            "raw/robot.csv:1: columns tau5, tau6 missing beside tau1, tau2, tau3, tau4; they are "
            "read all or none. Log tau5, tau6 too, or remove tau1, tau2, tau3, tau4.",
        ),
        (
            [*TAU[:2], "Tau3", *TAU[3:]],
            "column tau3 missing beside tau1, tau2, tau4, tau5, tau6; they are read all or none. "
            "Is 'Tau3' meant?",
        ),
    ],
)
def test_torques_are_logged_for_all_six_motors_or_for_none(
    tmp_path: Path, names: list[str], message: str
) -> None:
    with pytest.raises(LogError, match=re.escape(message)):
        read_recording(write(tmp_path, robot=torque_lines(names)))


def test_torques_under_other_names_are_not_read_and_the_report_asks(tmp_path: Path) -> None:
    recording = read_recording(write(tmp_path, robot=torque_lines([name.title() for name in TAU])))
    assert recording.robot_log.torque is None
    assert (
        "  raw/robot.csv: column not used: Tau1, Tau2, Tau3, Tau4, Tau5, Tau6. Is 'Tau1' meant "
        "for tau1? Then rename it. What is none of the signals needs nothing; name others as the "
        "dialect does." in (report_lines(recording.report))
    )


def test_torques_of_several_files_are_joined_and_must_be_in_all_of_them(tmp_path: Path) -> None:
    lines = torque_lines()
    write(
        tmp_path,
        robot=[lines[0], *lines[301:]],
        change=put("sources", "robot", "files", value=["raw/robot.csv", "raw/robotOld.csv"]),
    )
    (tmp_path / "raw/robotOld.csv").write_text("\n".join(lines[:301]) + "\n")
    log = read_recording(tmp_path).robot_log
    np.testing.assert_allclose(
        log.torque, motor_torque_trajectory() / np.diag(ROBOT.transmission), rtol=1e-15
    )
    (tmp_path / "raw/robotOld.csv").write_text("\n".join(robot_lines()[:301]) + "\n")
    with pytest.raises(
        LogError,
        match=(
            r"raw/robotOld.csv: columns tau1, .*tau6 missing, and other files .* or remove them "
            r"from all"
        ),
    ):
        read_recording(tmp_path)


# --- force sensor


def test_a_force_log_needs_no_encoders(tmp_path: Path) -> None:
    def sensorless(data: dict) -> None:
        with_force(data)
        data["encoders"] = {}
        del data["sources"]["ballbar"]

    recording = read_recording(write_force(tmp_path, change=sensorless))
    # Times: 17 s + t as float64 resolves 3.6e-15 s.
    np.testing.assert_allclose(force_log(recording).t, FORCE_T, atol=1e-14)
    np.testing.assert_array_equal(force_log(recording).wrench, wrench_trajectory())
    assert recording.ballbar_log is None
    assert summaries(recording) == []


def noisy_loads(rng: np.random.Generator, grain: float) -> list[list[str]]:
    """Cells of a force log of six loads with noise, in steps of `grain`."""
    t = 0.001 * np.arange(600)
    noise = rng.normal(0.0, 0.1, (t.size, 6))
    loads = 20.0 * np.sin(5.0 * t)[:, None] * np.arange(1, 7) + noise
    loads = np.rint(loads / grain) * grain
    return [
        [f"{s:.6f}", *(f"{load:.4f}" for load in row)]
        for s, row in zip(t.tolist(), loads.tolist(), strict=True)
    ]


def read_cells(folder: Path, cells: list[list[str]]) -> tuple[ForceLog, ImportLog]:
    lines = ["time,fx,fy,fz,tx,ty,tz", *(",".join(row) for row in cells)]
    (folder / "force.csv").write_text("\n".join([*lines, ""]))
    return read_force(folder, SourceFile(files=("force.csv",), dialect="force-torque"))


@pytest.mark.parametrize("grain", [1e-4, 0.25, 2.0])
def test_noise_and_grain_of_a_force_sensor_are_no_damage(grain: float, tmp_path: Path) -> None:
    for seed in range(5):
        log, imported = read_cells(tmp_path, noisy_loads(np.random.default_rng(seed), grain))
        assert log.t.size == 600
        assert not imported.findings


@pytest.mark.parametrize("size", [5.0, -30.0, 4000.0])
@pytest.mark.parametrize("row", [0, 3, 300, 599])
def test_a_force_far_outside_its_noise_is_left_out_and_reported(
    size: float, row: int, tmp_path: Path
) -> None:
    """A third of the changes of the campaign that were read in silence were beyond ten sigma."""
    cells = noisy_loads(np.random.default_rng(1), 1e-4)
    cells[row][3] = f"{float(cells[row][3]) + size:.4f}"
    log, imported = read_cells(tmp_path, cells)
    assert log.t.size == 599
    (finding,) = (one for one in imported.findings if one.kind == "implausible value")
    assert finding.lines == (row + 2,)
    assert "(fz)" in finding.sentence


# --- what identification takes


def test_load_series_are_checked_and_write_protected() -> None:
    t, six = np.arange(3.0), np.ones((3, 6))
    log, force = RobotLog(t, six.copy(), six.copy()), ForceLog(t, six.copy())
    assert log.torque is not None
    for series in (log.torque, force.wrench):
        with pytest.raises(ValueError, match="read-only"):
            series[0, 0] = 0.0
    with pytest.raises(
        ValueError, match=r"robot log, torque: times \(3,\) and values \(2, 6\) do not fit"
    ):
        RobotLog(t, six.copy(), np.ones((2, 6)))
    with pytest.raises(ValueError, match="robot log, torque: times or values are not finite"):
        RobotLog(t, six.copy(), np.full((3, 6), np.nan))
    with pytest.raises(ValueError, match=r"force log: times \(3,\) and values \(3, 3\) do not fit"):
        ForceLog(t, np.ones((3, 3)))
    with pytest.raises(ValueError, match="force log: times do not increase strictly"):
        ForceLog(np.array([0.0, 1.0, 1.0]), six.copy())
