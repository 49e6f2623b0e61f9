"""A tracker beside a ball-bar: what it sees, what it does not, and when it joins the fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from ballbar.acquisition.recording import Recording, read_recording
from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.geometry import Geometry
from ballbar.cell.logs import TrackerLog
from ballbar.ident.identify import identify_together
from ballbar.ident.options import DEFAULTS
from ballbar.ident.recording_fit import Logs, fit_recording
from ballbar.ident.result import Identification
from ballbar.ident.tracker import LEAST, NOT_COMPARED, PointErrors, TrackerCheck, check_tracker
from ballbar.ident.verdict import SUSPECT, Status
from ballbar.sim.logging.load_logs import TRACKER_EPOCH, tracker_rows
from ballbar.truth.compare import identification_against_truth
from tests.helpers.simulated_recordings import Recorded, record

NOISE = 9.0e-5


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    folder = tmp_path_factory.mktemp("tracked") / "recording"
    tracker = {"offset_s": 3.7, "skew": 4e-5}
    return record(folder, plant={"kind": "kinematic"}, logs={"tracker": tracker})


@pytest.fixture(scope="module")
def recording(tracked: Recorded) -> Recording:
    return read_recording(tracked.folder)


def identified(tracked: Recorded, recording: Recording, log: TrackerLog | None) -> Identification:
    logs = Logs(recording.robot_log, recording.ballbar_log, tracker=log)
    return identify_together(tracked.simulation.cell, [logs])


def log_of(recording: Recording) -> TrackerLog:
    assert recording.tracker_log is not None
    return recording.tracker_log


def log_with(t: Array, points: Array, accuracy: float) -> TrackerLog:
    return TrackerLog(t, points, np.full(points.shape, accuracy))


def check_of(result: Identification) -> TrackerCheck:
    (estimate,) = result.recordings
    assert estimate.tracker is not None
    return estimate.tracker


@pytest.fixture(scope="module")
def result(tracked: Recorded, recording: Recording) -> Identification:
    return identified(tracked, recording, log_of(recording))


def test_the_identified_robot_is_within_the_noise_and_the_nominal_one_is_not(
    result: Identification,
) -> None:
    check = check_of(result)
    assert check.noise == pytest.approx(np.sqrt(3.0) * NOISE, rel=0.03)
    assert check.identified.rms == pytest.approx(check.noise, rel=0.03)
    assert check.identified.largest < 5.0 * np.sqrt(3.0) * NOISE
    assert check.nominal.rms > 5.0 * check.noise
    assert (check.identified.unknowns, check.degrees) == (11, 3 * check.t.size - 11)
    assert check.acceptable
    assert result.verdict.status is Status.GOOD


@pytest.mark.long
@pytest.mark.slow
def test_elastic_gears_and_a_bending_plate_are_in_the_prediction(tmp_path: Path) -> None:
    """A tracker of 1 um sees them; the plate bends by 35 um, of which 6 would be left."""
    cell = {
        "robot": "irb2400",
        "ballbar": "lund_600",
        "plate": "plate_250_thin",
        "ballbar_position_m": [0.70, 0.0, 0.54],
    }
    elastic = {"joint_compliance": {"spread": 0.3}, "rod_strain": {}, "plate_bending": {}}
    done = record(
        tmp_path / "recording",
        cell=cell,
        errors={"static": {"table": "thesis_3_1"}, "joint_noise": {"sigma_rad": 2e-6}, **elastic},
        encoders={"fitted": [1, 2, 4, 5], "noise_sigma_rad": 2e-6},
        logs={"tracker": {"noise_m": 1e-6}},
    )
    read = read_recording(done.folder)
    result = identified(done, read, log_of(read))
    assert result.model == "complete"
    check = check_of(result)
    assert check.identified.rms < 5e-6
    assert check.nominal.rms > 5e-4


def test_the_clock_of_the_tracker_is_recovered(result: Identification) -> None:
    """90 um at 0.1 m/s over 685 points: 0.02 ms at the middle, about 1 ppm."""
    clock = check_of(result).identified.clock
    assert clock.offset == pytest.approx(3.7, abs=1.5e-4)
    assert clock.skew == pytest.approx(4e-5, abs=4e-6)


def test_points_that_agree_are_in_the_fit_and_tell_the_scale(
    tracked: Recorded, recording: Recording, result: Identification
) -> None:
    without = identified(tracked, recording, None)
    assert without.recordings[0].tracker is None
    assert without.poses is None
    assert result.poses is not None
    clock, sigma = result.poses.clocks["tracker"]
    assert abs(clock.offset - 3.7) < 4.0 * sigma[0]
    assert abs(clock.skew - 4e-5) < 4.0 * sigma[1]
    assert result.robot.tcp_sigma.mean() < 0.5 * without.robot.tcp_sigma.mean()
    truth = tracked.simulation.truth
    error = identification_against_truth(result, truth).tcp.mean
    assert error < 2.0 * result.robot.tcp_sigma.mean()


def test_points_that_contradict_take_no_part_in_the_fit(
    tracked: Recorded, recording: Recording
) -> None:
    without = identified(tracked, recording, None)
    wrong = identified(tracked, recording, log_of_another_robot(tracked, rtheta3=1e-3))
    assert not check_of(wrong).acceptable
    assert wrong.poses is None
    np.testing.assert_array_equal(without.robot.geometry.values, wrong.robot.geometry.values)
    np.testing.assert_array_equal(without.robot.covariance.values, wrong.robot.covariance.values)


@pytest.mark.long
@pytest.mark.slow
def test_the_force_in_the_rod_is_in_the_points_that_are_fitted(tmp_path: Path) -> None:
    """Elastic gears yield by a tenth of a millimetre; a tracker of 20 um must not see it left."""
    errors = {"static": {"table": "thesis_3_1"}, "joint_compliance": {}}
    done = record(tmp_path / "recording", errors=errors, logs={"tracker": {"noise_m": 2e-5}})
    read = read_recording(done.folder)
    result = identified(done, read, log_of(read))
    assert result.poses is not None
    assert result.poses.unexplained < 1e-5


def log_of_another_robot(tracked: Recorded, **off: float) -> TrackerLog:
    """Points of a tracker that follows a robot whose parameters are off by so much [m, rad]."""
    true = tracked.simulation.motion.geometry
    geometry = true.replaced({name: true[name] + value for name, value in off.items()})
    return log_with(*rows_of(tracked, geometry=geometry), NOISE)


def rows_of(tracked: Recorded, *, geometry: Geometry, noise: float = NOISE) -> tuple[Array, Array]:
    """Times (N,) [s] and points (N, 3) [m] that the tracker would log of a robot."""
    done, times = tracked.simulation, tracked.simulation.times.robot_true
    tracker, drawn = tracked.settings.logs.tracker, done.truth.logs.tracker
    assert tracker is not None
    assert drawn is not None
    stamps, points = tracker_rows(
        replace(done.motion, geometry=geometry),
        (float(times[0]), float(times[-1])),
        tracker=tracker.model_copy(update={"noise_m": noise}),
        drawn=drawn,
        seed=1,
    )
    return stamps - TRACKER_EPOCH, points


def test_a_robot_whose_axis_zero_is_off_by_a_milliradian_is_contradicted(
    tracked: Recorded, recording: Recording
) -> None:
    wrong = identified(tracked, recording, log_of_another_robot(tracked, rtheta3=1e-3))
    check = check_of(wrong)
    assert check.identified.rms**2 > 1.5 * SUSPECT * check.expected**2
    assert wrong.verdict.status is Status.SUSPECT
    assert wrong.verdict.sentence.startswith(
        "Usable, with care: the tracker contradicts the identified robot: its points are 0."
    )


@pytest.mark.long
def test_how_much_of_a_milliradian_frame_and_led_leave(
    tracked: Recorded, recording: Recording
) -> None:
    """Numbers of docs/how_to/identify_and_validate.md: 0 of axes 1 and 6, 0.08 to 0.23 mm."""
    logs = Logs(recording.robot_log, recording.ballbar_log)
    (point,) = fit_recording(tracked.simulation.cell, logs, DEFAULTS).fit.linear.evaluations
    left = []
    for axis in range(1, 7):
        log = log_of_another_robot(tracked, **{f"rtheta{axis}": 1e-3})
        check = check_tracker(log, point, point, tcp_sigma=0.0)
        assert check is not None
        left.append(1e3 * np.sqrt(max(0.0, check.identified.rms**2 - check.noise**2)))
    np.testing.assert_allclose(left, [0.0, 0.08, 0.23, 0.14, 0.17, 0.0], atol=0.03)


def test_gaps_of_a_hidden_led_cost_points_and_nothing_else(
    tracked: Recorded, recording: Recording
) -> None:
    log, rng = log_of(recording), np.random.default_rng(1)
    seen = np.ones(log.t.size, dtype=bool)
    for start in rng.uniform(0.0, 59.0, 12):
        seen &= (log.t < start) | (log.t > start + 1.5)
    check = check_of(identified(tracked, recording, log_with(log.t[seen], log.points[seen], NOISE)))
    assert check.t.size == pytest.approx(685 * seen.mean(), rel=0.1)
    assert check.noise == pytest.approx(np.sqrt(3.0) * NOISE, rel=0.05)
    assert check.identified.rms == pytest.approx(check.noise, rel=0.05)


def test_slow_errors_within_the_stated_accuracy_are_no_contradiction(
    tracked: Recorded, recording: Recording
) -> None:
    """They look like motion: the log shows a noise of 20 um, and the points are 90 um off."""
    log, rng = log_of(recording), np.random.default_rng(2)
    truth = rows_of(tracked, geometry=tracked.simulation.motion.geometry, noise=0.0)[1]
    slow = lfilter([np.sqrt(1.0 - 0.98**2)], [1.0, -0.98], rng.standard_normal(log.points.shape), 0)
    points = truth + 8.5e-5 * slow + 2e-5 * rng.standard_normal(log.points.shape)
    slowly = identified(tracked, recording, log_with(log.t, points, NOISE))
    check = check_of(slowly)
    assert check.noise < 0.5 * check.identified.rms
    assert check.acceptable
    tighter = identified(tracked, recording, log_with(log.t, points, 2e-5))
    assert not check_of(tighter).acceptable  # stated to be as good as its noise looks


def test_another_motion_and_a_left_handed_frame_are_contradictions(
    tracked: Recorded, recording: Recording
) -> None:
    log = log_of(recording)
    for points in (log.points[::-1], log.points * [1, 1, -1]):
        other = identified(tracked, recording, log_with(log.t, points, NOISE))
        assert not check_of(other).acceptable
        assert other.verdict.status is Status.SUSPECT


def test_a_log_that_is_too_short_validates_nothing_and_says_so(
    tracked: Recorded, recording: Recording
) -> None:
    log = log_of(recording)
    short = identified(
        tracked, recording, log_with(log.t[: 10 * LEAST], log.points[: 10 * LEAST], NOISE)
    )
    assert short.recordings[0].tracker is None
    assert NOT_COMPARED in short.verdict.warnings
    assert short.verdict.status is Status.GOOD


def test_a_check_is_said_in_millimetres_and_judged_by_all_that_explains_it() -> None:
    """Distances of 30 and 40 um; noise of 20 um, an accuracy of 10 um an axis, 20 um stated."""
    errors = PointErrors(np.array([[3e-5, 0, 0], [0, 4e-5, 0]]), Clock(0.0, 0.0), 4)
    nominal = PointErrors(1e-3 * np.eye(3)[:2], Clock(0.0, 0.0), 4)
    check = TrackerCheck(
        np.zeros(2), errors, nominal, noise=2e-5, accuracy=1e-5, tcp_sigma=2e-5,
        followed=None,  # type: ignore[arg-type]
    )  # fmt: skip
    assert (errors.rms, errors.largest) == pytest.approx((np.sqrt(12.5e-10), 4e-5))
    assert check.degrees == 2
    assert check.expected == pytest.approx(np.sqrt(8e-10))
    assert replace(check, accuracy=2e-5).expected == pytest.approx(np.sqrt(16e-10))
    assert check.sentence.startswith(
        "Tracker: its 2 points are 0.035 mm rms (largest 0.040) from the identified robot's and "
        "1.000 mm rms (largest 1.000) from the nominal robot's; its noise makes 0.020 mm. "
    )
    assert "(4 unknowns, 2 degrees of freedom)" in check.sentence
    assert "are 0.04 mm rms off, and noise, accuracy and the stated TCP uncertainty" in check.care
    assert "explain 0.03 mm." in check.care
    assert replace(check, noise=3e-5).acceptable
    assert not replace(check, noise=1e-6, accuracy=1e-6, tcp_sigma=1e-6).acceptable
