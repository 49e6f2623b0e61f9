"""One recording fitted by kinematics alone, from its logs on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry
from ballbar.cell.logs import BallBarLog, ForceLog, RobotLog
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.options import FitOptions, ForceSource, Listener
from ballbar.ident.recording_fit import (
    ROD_SIGMA_START,
    Logs,
    RecordingFit,
    fit_recording,
    identifiable_parameters,
    nominal_robot_fit,
    smoothed,
)
from ballbar.ident.start import automatic
from ballbar.sim.errors.static_errors import THESIS_3_1
from tests.helpers.minute_logs import LATE, NOISE, minute_logs
from tests.helpers.six_axes import INDEX, NAMES
from tests.helpers.synthetic_recording import CELL, NOMINAL

OPTIONS = FitOptions(samples=300)
TRUE = NOMINAL.replaced({name: NOMINAL[name] + e * 1e-3 for name, e in THESIS_3_1.items()})


@pytest.fixture(scope="module")
def fitted() -> RecordingFit:
    return fit_recording(CELL, minute_logs(true=TRUE), OPTIONS)


def test_machine_and_clock_are_found_within_their_stated_noise(fitted: RecordingFit) -> None:
    layout = fitted.fit.model.unknowns
    true = [TRUE[name] for name in layout.names[:-2]] + [LATE.offset, LATE.skew]
    off = fitted.fit.x - true
    normalised = off @ np.linalg.solve(fitted.fit.covariance, off)
    # chi-square of 30 unknowns, three deviations; the logs' noise is known to a few percent
    assert abs(normalised - layout.count) < 3.0 * np.sqrt(2.0 * layout.count) + 0.1 * layout.count
    assert fitted.fit.chi2_per_dof == pytest.approx(1.0, abs=0.15)
    assert fitted.clock.offset == pytest.approx(LATE.offset, abs=2e-5)
    assert fitted.geometry["ra2"] == pytest.approx(TRUE["ra2"], abs=1e-4)


def test_what_the_recording_cannot_tell_stays_at_the_catalogue(fitted: RecordingFit) -> None:
    """rd1, rd3 and rtheta1 are zero in thesis Table 3.1, so nothing has to make up for them."""
    left = np.setdiff1d(np.arange(len(NAMES)), fitted.subset.parameters)
    assert np.array_equal(fitted.geometry.values[left], fitted.nominal.values[left])
    assert {"rd1", "rd3", "rtheta1", "ra6"} <= {NAMES[i] for i in left}
    assert [d.name for d in fitted.subset.dropped] == ["rd1", "rd3", "rtheta1"]


def test_samples_are_as_many_as_requested_and_their_noise_that_of_the_logs(
    fitted: RecordingFit,
) -> None:
    samples = fitted.samples
    assert 290 <= samples.times.size <= 300
    # rows 10 ms apart, knots 80 ms: an eighth of the noise variance is left
    assert samples.joint_noise == pytest.approx(np.full(6, NOISE * np.sqrt(1.0 / 8.0)), rel=0.05)
    assert fitted.samples.held is None  # noise moves with the clock, but that of a sensed length
    assert fitted.fit.excess.rod < ROD_SIGMA_START  # a rod that does not deviate
    assert fitted.iterations >= fitted.fit.iterations + fitted.start.chosen.fit.iterations


def test_the_nominal_robot_is_placed_as_well_as_possible(fitted: RecordingFit) -> None:
    """Only encoder offsets, base position and clock move: what a user without calibration sees."""
    nominal = nominal_robot_fit(fitted, fitted.samples)
    assert nominal.converged
    own = {"btheta1", "btheta2", "btheta4", "btheta5", "ox", "oy", "oz"}
    assert set(nominal.model.unknowns.names) == own | {"offset", "skew"}
    others = [i for i, name in enumerate(NAMES) if name not in own]
    assert np.array_equal(nominal.geometry().values[others], fitted.nominal.values[others])
    rms = [
        np.sqrt((f.linear.evaluations[0].closure.error[:3] ** 2).mean())
        for f in (nominal, fitted.fit)
    ]
    assert rms[0] > 1e-4
    assert rms[1] < 5e-5


@pytest.mark.parametrize("encoders", [(), (1, 2)])
def test_a_ball_bar_with_few_encoders_or_none_is_fitted_alike(encoders: tuple[int, ...]) -> None:
    found = fit_recording(CELL, minute_logs(true=TRUE, encoders=encoders), OPTIONS)
    assert found.fit.converged
    assert found.samples.has_clock == bool(encoders)
    assert found.fit.chi2_per_dof == pytest.approx(1.0, abs=0.3)


def test_a_known_reading_of_the_logs_leads_to_the_same_fit_without_a_search(
    fitted: RecordingFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(automatic, "_hypotheses", lambda *_: pytest.fail("searched"))
    known = replace(fitted.start.chosen.hypothesis, clock=fitted.clock)
    again = fit_recording(CELL, minute_logs(true=TRUE), OPTIONS, known=known)
    sigma = np.sqrt(np.diag(fitted.fit.covariance))
    assert np.abs((again.fit.x - fitted.fit.x) / sigma).max() < 0.02
    assert again.start.tried == 1


def test_stages_are_told() -> None:
    stages: list[str] = []
    fit_recording(CELL, minute_logs(), OPTIONS, Listener(stages.append))
    assert stages == [
        "smoothing both logs",
        "aligning the logs and finding the ball-bar",
        "fitting",
    ]


def test_requested_parameters_are_judged_and_no_others(fitted: RecordingFit) -> None:
    requested = np.array([INDEX[name] for name in ("oz", "rd1", "ra2")])
    found = identifiable_parameters(
        fitted.samples,
        fitted.geometry,
        fitted.clock,
        ExcessNoise(rod=1e-6),
        fitted.nominal,
        requested,
    )
    assert [NAMES[i] for i in found.parameters] == ["oz", "ra2"]
    assert [(d.name, d.on) for d in found.dropped] == [("rd1", ("oz",))]


def test_smoothing_takes_both_logs_or_the_robots_alone() -> None:
    robot, ballbar, encoders = smoothed(minute_logs())
    assert encoders == (1, 2, 4, 5)
    assert ballbar is not None
    assert robot.noise == pytest.approx(np.full(6, NOISE), rel=0.05)
    assert ballbar.noise == pytest.approx(np.full(4, NOISE), rel=0.05)
    assert smoothed(minute_logs(encoders=()))[1:] == (None, ())


def test_segments_that_the_reader_joined_are_where_clock_steps_are_looked_for() -> None:
    """Three rows are missing and the clock was set back by as much: every stamp looks regular."""
    logs = minute_logs()
    assert logs.ballbar is not None
    log, cut = logs.ballbar, 2500
    t = np.concatenate((log.t[:cut], log.t[cut + 3 :] - 3 * 0.01))
    angles = np.concatenate((log.angles[:cut], log.angles[cut + 3 :]))
    segment = (np.arange(t.size) >= cut).astype(np.uint16)
    joined = BallBarLog(t, angles, log.joints, segment)
    _, told, _ = smoothed(replace(logs, ballbar=joined))
    assert told is not None
    (step,) = told.steps
    assert (step.row, step.channel) == (cut, None)
    assert step.size == pytest.approx(-0.03, abs=1e-3)
    _, untold, _ = smoothed(replace(logs, ballbar=BallBarLog(t, angles, log.joints)))
    assert untold is not None
    assert all(step.channel is not None for step in untold.steps)


def sensor() -> ForceLog:
    return ForceLog(np.arange(3.0), np.zeros((3, 6)))


@pytest.mark.parametrize(
    ("requested", "torque", "force", "source"),
    [
        ("auto", True, True, "sensor"),
        ("auto", True, False, "torque"),
        ("auto", False, False, "none"),
        ("torque", True, True, "torque"),
        ("torque", False, True, "none"),
        ("sensor", True, False, "none"),
        ("none", True, True, "none"),
    ],
)
def test_the_best_logged_signal_gives_the_tension_unless_another_is_requested(
    requested: ForceSource, torque: bool, force: bool, source: str
) -> None:
    t = np.arange(3.0)
    torques: Array | None = np.zeros((3, 6)) if torque else None
    robot = RobotLog(t, np.zeros((3, 6)), torque=torques)
    logs = Logs(robot, None, sensor() if force else None)
    assert logs.force_source(requested, CELL.robot) == source


def test_logs_refuse_what_is_no_log() -> None:
    with pytest.raises(ValueError, match="do not increase strictly"):
        RobotLog(np.array([0.0, 0.0]), np.zeros((2, 6)))
    with pytest.raises(ValueError, match="do not fit"):
        RobotLog(np.array([0.0, 1.0]), np.zeros((3, 6)))
    with pytest.raises(ValueError, match="do not increase within"):
        BallBarLog(np.array([0.0, 1.0]), np.zeros((2, 2)), (2, 1))


def test_the_base_is_taken_from_the_start_also_where_it_is_not_identified(
    fitted: RecordingFit,
) -> None:
    geometry: Geometry = fitted.geometry
    assert geometry.origin == pytest.approx(TRUE.origin, abs=1e-3)
    assert np.array_equal(fitted.nominal.origin, np.zeros(3))
