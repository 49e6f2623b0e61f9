"""A simulated robot that an instrument follows, from the scenario to a result that is verified."""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.recording import read_recording
from ballbar.cell.load import load_instrument
from ballbar.cell.rotation import matrix_from_rotvec, rotvec_from_matrix
from ballbar.cell.statistics import rms
from ballbar.recordings.read import poses_of
from ballbar.result.calibration import load
from ballbar.result.identify import identify
from ballbar.sim.recording_files import truth_path
from ballbar.sim.truth import Truth, load_truth
from ballbar.watch.show import line, panel
from ballbar.watch.watch import Watch
from tests.helpers.command_line import ballbar
from tests.helpers.followed_robot import FollowedRobot

SHORT = ("path.duration_s=40", "path.stops=0", "accept.tcp_max_mm=0.4")


@pytest.fixture(scope="module")
def mocap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of the shipped scenario, 40 s long."""
    out = tmp_path_factory.mktemp("mocap") / "run"
    changes = [word for change in SHORT for word in ("--set", change)]
    code, text, err = ballbar("run", "ur10e_mocap", *changes, "--out", str(out))
    assert code == 0, text + err
    return out


@pytest.mark.slow
def test_clock_latency_and_target_are_those_of_the_simulation(mocap: Path) -> None:
    file = load(mocap).file
    truth = load_truth(truth_path(mocap / "recording"))
    assert isinstance(truth, Truth)
    assert truth.logs.tracker is not None
    (group,) = file.groups
    assert group.clock is not None
    clock, stated = group.clock, truth.logs.tracker
    assert stated.offset_s == pytest.approx(0.45 - 0.012, abs=1e-6)
    lag = truth.logs.joint_lag_s[0]
    assert abs(clock.offset_s - stated.offset_s - lag) < 4.0 * clock.offset_sigma_s
    assert abs(clock.skew - stated.skew) < 4.0 * clock.skew_sigma
    assert clock.offset_sigma_s < 2e-4


@pytest.mark.slow
def test_rows_have_the_noise_that_the_instrument_states(mocap: Path) -> None:
    """The spread of neighbouring rows about their means is that of white noise."""
    log = read_recording(mocap / "recording").tracker_log
    assert log is not None
    second = log.points[:-2] - 2.0 * log.points[1:-1] + log.points[2:]
    still = np.linalg.norm(second, axis=1) < 8.0 * np.sqrt(6.0) * log.sigma[0, 0]
    expected = np.sqrt(6.0) * np.median(log.sigma[:, :3])
    assert second[still].std() == pytest.approx(expected, rel=0.1)
    turns = matrix_from_rotvec(log.values[:, 3:].T)
    between = rotvec_from_matrix(np.einsum("jin,jkn->ikn", turns[..., :-1], turns[..., 1:]))
    sigma = load_instrument("mocap_pose").sigma_rotation
    assert np.quantile(np.abs(between), 0.5) > 0.5 * sigma


@pytest.mark.slow
def test_the_result_is_verified_replayed_and_read(mocap: Path) -> None:
    code, out, _ = ballbar("verify", str(mocap), str(mocap / "recording"))
    assert (code, out.split(":")[0]) == (0, "Holds")
    assert (mocap / "run.rrd").stat().st_size > 1e5
    report = (mocap / "report.html").read_text()
    assert "Clock of the instrument that followed the robot" in report
    assert "followed poses" in report


@pytest.mark.slow
def test_a_robot_whose_axis_turned_since_is_not_verified(tmp_path: Path) -> None:
    """Its zero went by 0.4 mrad; the instrument stands elsewhere today, on another clock."""
    made = FollowedRobot(seed=8)
    made.write(tmp_path / "before", seconds=30.0)
    code, _, err = ballbar("identify", str(tmp_path / "before"), "--out", str(tmp_path / "out"))
    assert code == 0, err
    today = replace(made, offset=0.05, seat=(2.2, 1.3, 0.3))
    today.write(tmp_path / "unchanged", seconds=20.0, rate=100.0)
    code, out, _ = ballbar("verify", str(tmp_path / "out"), str(tmp_path / "unchanged"))
    assert code == 0, out
    changed = replace(today, turned=(2, 4e-4))
    changed.write(tmp_path / "changed", seconds=20.0, rate=100.0)
    code, out, _ = ballbar("verify", str(tmp_path / "out"), str(tmp_path / "changed"), "--json")
    assert code == 1
    cause = json.loads(out)["causes"][0]
    assert (cause["kind"], cause["axis"]) == ("axis", 3)
    assert cause["size"][0] == pytest.approx(4e-4, rel=0.1)


def test_settings_of_a_ballbar_are_refused(tmp_path: Path) -> None:
    folder = FollowedRobot(seed=5).write(tmp_path / "moving", seconds=15.0, rate=50.0)
    code, _, err = ballbar("identify", str(folder), "--model", "dh")
    assert code == 2
    assert "gives poses, and these settings are of a ball-bar's logs" in err


@pytest.mark.slow
def test_the_stored_result_is_compared_with_its_truth(mocap: Path) -> None:
    code, out, err = ballbar("compare", str(mocap), str(truth_path(mocap / "recording")), "--json")
    assert code == 0, err
    found = json.loads(out)
    model, nominal = (found[key]["mean_m"] for key in ("tcp_difference", "tcp_difference_nominal"))
    assert model < 0.3 * nominal
    assert abs(found["clock_offset_error_s"]) < 2e-4
    assert max(abs(p["z"]) for p in found["parameters"].values()) < 5.0


@pytest.mark.slow
def test_a_growing_recording_of_an_instrument_that_follows_is_watched(tmp_path: Path) -> None:
    """Half of the rows, half a row more, then all: what is stated at the end is identified."""
    made = FollowedRobot(seed=8).write(tmp_path / "made", seconds=30.0)
    growing = tmp_path / "growing"
    growing.mkdir()
    shutil.copy(made / "recording.yaml", growing)
    texts = {file: (made / file).read_text() for file in ("robot.csv", "tracker.csv")}
    for file, text in texts.items():
        (growing / file).write_text(text[: len(text) // 2])
    with get_context("spawn").Pool(1) as pool:
        watch = Watch(growing, accuracy=1e-3, pool=pool)
        state = watch.update(0.0)
        assert state.waiting == "being identified"
        for now in range(1, 60):
            if (state := watch.update(float(now) / 20)).estimate:
                break
            time.sleep(0.5)
        assert state.estimate is not None
        assert 13.0 < state.estimate.until < 15.5
        half = state.estimate.tcp_sigma
        for file, text in texts.items():
            (growing / file).write_text(text)
        state = watch.finish(4.0)
    poses = identify(made).data.identification
    assert state.estimate is not None
    assert state.estimate.tcp_sigma == pytest.approx(rms(poses.robot.tcp_sigma), rel=1e-9)
    assert state.estimate.tcp_sigma < half
    assert (state.estimate.status, state.enough, state.alarms) == ("good", True, ())
    assert state.estimate.clock is not None
    assert state.estimate.clock[0] == pytest.approx(0.217, abs=1e-4)
    assert "mm, without the scale of the instrument" in line(state.to_dict())
    assert panel(state.to_dict())


@pytest.mark.slow
def test_logs_of_two_runs_are_watched_and_called_implausible(tmp_path: Path) -> None:
    made = FollowedRobot(seed=8).write(tmp_path / "made", seconds=20.0, rate=50.0)
    other = FollowedRobot(seed=9).write(tmp_path / "other", seconds=20.0, rate=50.0)
    shutil.copy(other / "tracker.csv", made)
    state = Watch(made, accuracy=1e-3).finish(0.0)
    assert state.estimate is not None
    assert (state.estimate.status, state.enough) == ("implausible", False)


@pytest.mark.slow
def test_noise_of_rows_is_no_uncertainty_of_the_tool(tmp_path: Path) -> None:
    """Motion capture of 0.15 mm: the tool was stated ten times worse than it was known."""
    made = FollowedRobot(seed=2, noise_m=(1.5e-4, 0.0))
    made.write(tmp_path / "made", seconds=30.0, rate=50.0)
    result = identify(tmp_path / "made").data.identification
    assert result.poses is not None
    validation, robot = result.poses.cross_validation, result.poses.identified_robot()
    assert validation.white == pytest.approx(1.5e-4, rel=0.1)
    q = result.poses.table.q[::20]
    moved = robot.frames(q).tip.T - made.points(q)
    moved -= moved.mean(axis=0)  # the frames of both bases differ by a constant, and a small turn
    lever = made.points(q) - made.points(q).mean(axis=0)
    columns = np.stack([np.cross(axis, lever) for axis in np.eye(3)], axis=-1).reshape(-1, 3)
    turn = np.linalg.lstsq(columns, moved.ravel(), rcond=None)[0]
    error = rms(moved - (columns @ turn).reshape(-1, 3)) * np.sqrt(3.0)
    stated = rms(robot.sigma(q))
    assert stated < 0.5 * np.sqrt(3.0) * 1.5e-4
    assert 0.2 < error / stated < 2.0


def test_a_motor_that_stepped_is_taken_out_of_the_log_and_said(tmp_path: Path) -> None:
    """The rows behind it count as before; without a word the user would go on with that motor."""
    folder = FollowedRobot(seed=8).write(tmp_path / "made", seconds=15.0, rate=50.0)
    rows = np.loadtxt(folder / "robot.csv", delimiter=",", skiprows=1)
    rows[rows[:, 0] >= 8.0, 5] += 3e-3
    head = (folder / "robot.csv").read_text().partition("\n")[0]
    np.savetxt(folder / "robot.csv", rows, fmt="%.9f", delimiter=",", header=head, comments="")
    found = [f for f in poses_of(folder).report.findings if f.kind == "step in the log"]
    assert [f.sentence for f in found] == [
        "joint 5 stepped by +3 mrad between two rows at t = 8.00 s; taken out."
    ]
