"""The complete model: corrections selected by the data, step faults, tension, continuation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from ballbar.ident import complete_fit
from ballbar.ident.complete_fit import (
    CONTINUATION,
    DEVIATION,
    FIRST_EXCESS,
    WANDERING,
    Pose,
    approached,
    clock_steps_of,
    continued,
    fit_complete,
    fit_pose,
    posed,
    start_of,
    with_likely_tension,
    with_tension,
)
from ballbar.ident.corrections import CORRECTIONS, supported_corrections
from ballbar.ident.corrections.base import Correction
from ballbar.ident.corrections.rod_elongation import rod_elongation
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.uncertainty import mean_autocorrelation
from ballbar.ident.held_machine import closed_loop
from ballbar.ident.model_choice import AUTOCORRELATED, coefficients_of, lasting, unsupported
from ballbar.ident.options import FitOptions, Listener
from ballbar.ident.recording_fit import RecordingFit, fit_recording
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.signals.steps import StepFault
from tests.helpers.known_loads import tension_at
from tests.helpers.minute_logs import LATE, minute_logs
from tests.helpers.synthetic_recording import CELL, UNIVERSAL_AND_GIMBAL

OPTIONS = FitOptions(model="complete", samples=300)
RIPPLE = 1e-4  # [rad]
PERIOD = 2.0 * np.pi / CELL.ballbar.encoder_lines
WITHOUT_LOADS = ("gear_ripple", "encoder_harmonics")


def formed(names: Sequence[str]) -> list[Correction]:
    return [CORRECTIONS[name](CELL, UNIVERSAL_AND_GIMBAL) for name in names]


def fitted(**plants: object) -> RecordingFit:
    return fit_recording(CELL, minute_logs(**plants), OPTIONS)


@pytest.fixture(scope="module")
def rippled() -> RecordingFit:
    return fitted(ripple=RIPPLE)


@pytest.fixture(scope="module")
def elastic() -> RecordingFit:
    """Gears as elastic as the catalogue's, motor torques logged."""
    return fitted(compliance=1.0, torque=True)


@pytest.fixture(scope="module")
def found(rippled: RecordingFit) -> Fit:
    """Ripple and harmonics together, of which only ripple is there."""
    return fit_pose(posed(CELL, [rippled], formed(WITHOUT_LOADS), OPTIONS), FIRST_EXCESS)


def test_a_correction_without_effect_is_not_supported_and_a_planted_one_is(found: Fit) -> None:
    assert unsupported(found) == {"encoder_harmonics"}


def test_nothing_is_seen_to_be_absent_beside_something_systematic(found: Fit) -> None:
    """The residual may hide it, and left out it would be zero for sure."""
    residual = found.linear.residuals[0]
    slow = np.broadcast_to(3.0 * np.sin(0.05 * np.arange(residual.shape[1])), residual.shape)
    hidden = replace(found, linear=replace(found.linear, residuals=(slow,)))
    assert mean_autocorrelation(hidden) > AUTOCORRELATED
    assert unsupported(hidden) == set()


def test_planted_ripple_is_found_in_its_own_coefficient(found: Fit) -> None:
    position = coefficients_of(found, CORRECTIONS["gear_ripple"](CELL, ()))
    sine, cosine = found.x[position][:2]
    sigma = np.sqrt(found.covariance[position.start, position.start])
    # The log reads the ripple; what the joint does is the reading and the correction.
    assert sine == pytest.approx(RIPPLE, abs=4.0 * sigma)
    assert abs(cosine) < 4.0 * sigma
    others = found.x[position][2:] / np.sqrt(np.diag(found.covariance)[position][2:])
    assert np.mean(others**2) < 2.0


def test_useless_corrections_are_left_out_of_the_complete_fit(rippled: RecordingFit) -> None:
    told: list[str] = []
    result = fit_complete(CELL, [rippled], WITHOUT_LOADS, OPTIONS, Listener(told.append))
    assert [c.name for c in lasting(result)] == ["gear_ripple"]
    assert told[-1].startswith("fitting ")
    assert "fitting again without encoder_harmonics" in told
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.15)


def test_corrections_that_the_options_name_stay(rippled: RecordingFit) -> None:
    options = replace(OPTIONS, corrections=WITHOUT_LOADS)
    result = fit_complete(CELL, [rippled], WITHOUT_LOADS, options)
    assert [c.name for c in lasting(result)] == list(WITHOUT_LOADS)


def test_of_all_corrections_only_the_elastic_gears_of_an_elastic_robot_stay(
    elastic: RecordingFit,
) -> None:
    result = fit_complete(CELL, [elastic], supported_corrections(CELL.robot), OPTIONS)
    assert result.converged
    (correction,) = lasting(result)
    assert correction.name == "joint_compliance"
    position = coefficients_of(result, correction)
    true = 1.0 / CELL.robot.gears.stiffness
    sigma = np.sqrt(np.diag(result.covariance)[position])
    # the white covariance, and a little of the other corrections that were there before
    assert (np.abs(result.x[position] - true) < 5.0 * sigma).all()
    assert (sigma[:3] < 0.1 * true[:3]).all()
    tension = result.model.tension(result.x, 0)
    expected = tension_at(LATE.robot_time(result.model.recordings[0].times))
    assert np.sqrt(((tension - expected) ** 2).mean()) < 3.0  # [N] of 80


def test_a_slip_by_a_whole_period_is_held_at_that_size() -> None:
    """Too small for the log to show, so the residual finds it; then nothing of it is fitted."""
    recording, told = fitted(slip=(4, 30.0, -PERIOD)), list[str]()
    result = fit_complete(CELL, [recording], (), OPTIONS, Listener(told.append))
    (fault,) = result.step_faults
    assert (fault.kind, fault.joint, fault.periods) == ("encoder", 4, -1)
    assert fault.time == pytest.approx(30.0, abs=0.2)
    assert fault.size == pytest.approx(-PERIOD, abs=1e-8)
    assert "fitting again with whole signal periods" in told
    assert lasting(result) == []  # the slip is a recording's, not the machine's
    assert [c.name for c in result.model.corrections] == ["encoder_jumps"]


def test_a_slip_that_only_the_residual_shows_is_found_and_sized() -> None:
    recording, told = fitted(slip=(1, 22.0, 4e-4)), list[str]()
    result = fit_complete(CELL, [recording], (), OPTIONS, Listener(told.append))
    (fault,) = result.step_faults
    assert (fault.joint, fault.periods) == (1, 0)
    assert fault.size == pytest.approx(4e-4, abs=2e-5)
    assert any(line.startswith("a step fault at t = 2") for line in told)
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("by_itself", [True, False])
def test_a_slip_in_one_of_two_recordings_shows_in_it_by_itself(
    by_itself: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A step that shows only beside the other recording is no slip: their machines differ."""
    found = complete_fit.find_step_fault
    monkeypatch.setattr(
        complete_fit,
        "find_step_fault",
        lambda fit: found(fit) if by_itself or len(fit.model.recordings) > 1 else None,
    )
    recordings = [fitted(seed=1), fitted(slip=(1, 22.0, 4e-4))]
    faults = fit_complete(CELL, recordings, (), OPTIONS).step_faults
    assert [(fault.recording, fault.joint) for fault in faults] == [(1, 1)] * by_itself


def test_a_step_that_does_not_explain_the_residual_is_not_taken(
    rippled: RecordingFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever is wrong, it is no step: chi-square must fall by a fiftieth."""
    fault, found = StepFault(0, "encoder", 1, 25.0, 1e-3), complete_fit.find_step_fault
    claimed = iter([fault])
    monkeypatch.setattr(
        complete_fit, "find_step_fault", lambda fit: next(claimed, None) or found(fit)
    )
    result = fit_complete(CELL, [rippled], ("gear_ripple",), OPTIONS)
    assert [c.name for c in result.model.corrections] == ["gear_ripple"]
    assert result.step_faults == ()
    assert next(claimed, None) is None


def test_coefficients_are_found_by_the_name_of_their_correction(found: Fit) -> None:
    ripple, harmonics = found.model.corrections
    first = found.model.unknowns.coefficients.start
    count = len(ripple.coefficients)
    assert coefficients_of(found, ripple) == slice(first, first + count)
    assert coefficients_of(found, harmonics).start == first + count
    assert coefficients_of(found, harmonics).stop == found.model.unknowns.coefficients.stop
    with pytest.raises(KeyError, match="rod_strain"):
        coefficients_of(found, CORRECTIONS["rod_strain"](CELL, ()))


def test_a_fit_of_a_few_samples_comes_first_where_there_are_very_many(
    rippled: RecordingFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    pose = posed(CELL, [rippled], formed(WITHOUT_LOADS), OPTIONS)
    assert approached(pose, FIRST_EXCESS) is pose
    monkeypatch.setattr(complete_fit, "COARSE_SAMPLES", 70)
    near, whole = approached(pose, FIRST_EXCESS), fit_pose(pose, FIRST_EXCESS)
    assert near.model is pose.model
    # a quarter of the samples: twice the deviation
    sigma = np.sqrt(np.diag(whole.covariance))
    assert (np.abs(near.x - whole.x) < 7.0 * sigma).all()
    first = coefficients_of(whole, CORRECTIONS["gear_ripple"](CELL, ())).start
    assert pose.x[first] == 0.0
    assert near.x[first] == pytest.approx(RIPPLE, rel=0.5)


def test_the_model_has_loads_tension_and_splines_only_where_a_correction_needs_them(
    elastic: RecordingFit,
) -> None:
    bare = posed(CELL, [elastic], formed(WITHOUT_LOADS), OPTIONS).model
    assert bare.masses is None
    assert bare.unknowns.gain is None
    assert bare.unknowns.own[0].knots is None
    assert not bare.recordings[0].tension.any()
    loaded = posed(CELL, [elastic], formed(("joint_compliance",)), OPTIONS).model
    assert loaded.masses is not None
    assert loaded.unknowns.gain is not None
    samples = loaded.recordings[0]
    off = samples.tension - tension_at(LATE.robot_time(samples.times))
    assert np.median(np.abs(off)) < 2.0  # [N]
    own = loaded.unknowns.own[0].knots
    assert own is not None
    assert set(loaded.unknowns.sigma[own]) == {DEVIATION["torque"]}


def test_a_rod_without_any_signal_has_a_spline_and_no_gain(elastic: RecordingFit) -> None:
    options = replace(OPTIONS, force="none")
    model = posed(CELL, [elastic], formed(("joint_compliance",)), options).model
    assert model.unknowns.gain is None
    assert not model.recordings[0].tension.any()
    knots = model.unknowns.own[0].knots
    assert knots is not None
    assert set(model.unknowns.sigma[knots]) == {DEVIATION["none"]}


def test_without_a_signal_the_fit_begins_with_much_noise_and_a_wide_backlash(
    elastic: RecordingFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    stages: list[tuple[float, ExcessNoise]] = []

    def followed(pose: Pose, excess: ExcessNoise, *, max_iterations: int) -> Fit:
        stages.append((pose.model.sharpness, excess))
        return fit_pose(pose, excess, max_iterations=max_iterations)

    monkeypatch.setattr(complete_fit, "fit_pose", followed)
    options = replace(OPTIONS, force="none")
    pose = posed(CELL, [elastic], formed(("joint_compliance", "gear_backlash")), options)
    near = continued(pose, Listener(told.append))
    assert [line.split("(")[1] for line in told] == [
        f"{k:g} times the noise)" for k in CONTINUATION
    ]
    assert [sharpness for sharpness, _ in stages] == [1.0 / k for k in CONTINUATION]
    assert [excess.rod for _, excess in stages] == [k * FIRST_EXCESS.rod for k in CONTINUATION]
    assert near.model is pose.model  # of the last stage only the values are taken over
    assert near.model.sharpness == 1.0
    knots = near.model.unknowns.own[0].knots
    assert knots is not None
    tension = near.model.tension(near.x, 0)
    expected = tension_at(LATE.robot_time(near.model.recordings[0].times))
    assert np.corrcoef(tension, expected)[0, 1] > 0.9  # from geometry alone
    assert not pose.x[knots].any()


def test_knots_get_a_prior_as_wide_as_they_turned_out(elastic: RecordingFit) -> None:
    pose = posed(CELL, [elastic], formed(("joint_compliance",)), OPTIONS)
    fit = fit_pose(pose, FIRST_EXCESS)
    knots = fit.model.unknowns.own[0].knots
    assert knots is not None
    model = with_likely_tension(fit)
    likely = np.sqrt(np.mean(fit.x[knots] ** 2 + np.diag(fit.covariance)[knots]))
    assert model.unknowns.sigma[knots] == pytest.approx(np.full(knots.stop - knots.start, likely))
    others = np.setdiff1d(np.arange(fit.x.size), np.arange(fit.x.size)[knots])
    assert np.array_equal(model.unknowns.sigma[others], fit.model.unknowns.sigma[others])
    assert set(fit.model.unknowns.sigma[knots]) == {DEVIATION["torque"]}


def test_clock_steps_are_those_of_one_recording() -> None:
    faults = (
        StepFault(0, "clock", 0, 9.0, 0.1),
        StepFault(0, "encoder", 2, 11.0, 0.1),
        StepFault(1, "clock", 0, 12.0, 0.1),
        StepFault(0, "clock", 0, 3.0, 0.1),
    )
    assert clock_steps_of(faults, 0) == (9.0, 3.0)
    assert clock_steps_of(faults, 1) == (12.0,)
    assert clock_steps_of(faults, 2) == ()


def test_a_rod_that_wanders_is_held_to_no_narrower_a_tension_than_it_was_identified_with(
    rippled: RecordingFit,
) -> None:
    rod = rod_elongation(CELL)
    robot = IdentifiedRobot(CELL, rippled.geometry, (rod,), np.array([rod.coefficients[0].mean]))
    told: list[str] = []
    held = closed_loop(robot, rippled, OPTIONS, (), FIRST_EXCESS, Listener(told.append))
    (own,) = held.model.unknowns.own
    assert set(held.model.unknowns.sigma[own.knots]) == {WANDERING}
    assert told == []  # the force is not sought: nothing but the rod's length depends on it


def test_a_recordings_own_unknowns_start_where_its_kinematic_fit_ended(
    rippled: RecordingFit,
) -> None:
    samples = with_tension(CELL, rippled, "none", (20.0, 30.0), loaded=True)
    start = start_of(rippled, samples, "none", ())
    assert start.clock == rippled.clock
    assert start.geometry is rippled.geometry or np.array_equal(
        start.geometry.values, rippled.geometry.values
    )
    assert start.knots == samples.splines.shape[0] > 0
    assert start.tension_sigma == DEVIATION["none"]
    assert start.clock_steps == 2
    wandering = start_of(rippled, samples, "torque", [rod_elongation(CELL)])
    assert wandering.tension_sigma == WANDERING > DEVIATION["torque"]
    assert samples.clock_steps == (20.0, 30.0)
    assert with_tension(CELL, rippled, "none", (), loaded=False).splines.shape[0] == 0


def test_two_recordings_share_the_machine_and_keep_their_own_clocks() -> None:
    """The same machine twice: its coefficients are known better by the root of two."""
    recordings = [fitted(ripple=RIPPLE, seed=seed) for seed in (1, 2)]
    single, both = (
        fit_pose(posed(CELL, some, formed(("gear_ripple",)), OPTIONS), FIRST_EXCESS)
        for some in (recordings[:1], recordings)
    )
    assert "offset@2" in both.model.unknowns.names
    position = coefficients_of(single, CORRECTIONS["gear_ripple"](CELL, ()))
    variance = np.diag(single.covariance)[position]
    gain = np.sqrt(variance / np.diag(both.covariance)[position])
    known = np.sqrt(variance) < 0.1 * single.model.unknowns.sigma[position]  # not by the prior
    assert known.sum() > 10
    assert gain[known] == pytest.approx(np.full(known.sum(), np.sqrt(2.0)), rel=0.05)
