"""Encoder slips and clock steps: planted, detected in residual or logs, and estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.ident.corrections.base import BAR, State
from ballbar.ident.estimator.build_unknowns import RecordingStart, complete_unknowns
from ballbar.ident.estimator.fit import Fit, fit
from ballbar.ident.estimator.model import Model, joints_as_logged
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.estimator.step_faults import (
    EXACT,
    SLIP_PRIOR,
    as_logged,
    encoder_slips,
    find_step_fault,
    sized,
    step_faults_in_logs,
    with_exact_periods,
)
from ballbar.ident.estimator.unknowns import Unknowns
from ballbar.ident.loads.gear_loads import no_loads
from ballbar.ident.signals.smooth_log import SmoothLog
from ballbar.ident.signals.steps import LogStep, StepFault
from tests.helpers.complete_model import EXCESS, CompleteModel
from tests.helpers.synthetic_recording import (
    CELL,
    NO_CLOCK_ERROR,
    NOMINAL,
    UNIVERSAL_AND_GIMBAL,
    closed,
    exact_log,
    minute,
)

LINES = 3600
PERIOD = 2.0 * np.pi / LINES  # [rad] of an encoder's signal
TIMES = minute().t[30:-30:4]
NOISE = 1e-5  # [rad]


def angles(t: Array, seed: int) -> tuple[Array, Array]:
    """(N, 5) [rad] exact ball-bar angles at t (N,) [s] of the minute, and their white noise."""
    noise = NOISE * np.random.default_rng(seed).standard_normal((t.size, 5))
    return np.asarray(exact_log(minute().t, minute().b).spline(t)), noise


def samples_with(steps: tuple[float, ...] = ()) -> Samples:
    path, columns = minute(), [j - 1 for j in UNIVERSAL_AND_GIMBAL]
    return Samples(
        robot=exact_log(path.t, path.q),
        ballbar=exact_log(path.t, path.b[:, columns]),
        encoders=UNIVERSAL_AND_GIMBAL,
        directions=np.ones(4),
        times=TIMES,
        joint_noise=np.full(6, 2e-6),
        encoder_noise=np.array([NOISE, NOISE, 0.0, NOISE, NOISE]),
        tension=np.zeros(TIMES.size),
        clock_steps=steps,
    )


def layout_of(faults: tuple[StepFault, ...], recordings: int = 1) -> tuple[Unknowns, Array]:
    slips = encoder_slips(faults)
    starts = [
        RecordingStart(
            UNIVERSAL_AND_GIMBAL,
            NOMINAL,
            NO_CLOCK_ERROR,
            clock_steps=sum(f.kind == "clock" and f.recording == k for f in faults),
        )
        for k in range(recordings)
    ]
    corrections = () if slips is None else (slips,)
    return complete_unknowns(CELL, NOMINAL, starts, corrections, gain_sigma=None, rod_sigma=None)


def fitted(ballbar: Array, faults: tuple[StepFault, ...] = (), louder: float = 1.0) -> Fit:
    """The rigid mechanism fitted to ball-bar angles (N, 5) [rad]; a parameter for each fault.

    louder : by how much the encoders' stated noise exceeds NOISE.
    """
    layout, x = layout_of(faults)
    slips = encoder_slips(faults)
    samples = samples_with(tuple(f.time for f in faults if f.kind == "clock"))
    samples = replace(samples, encoder_noise=louder * samples.encoder_noise)
    corrections = () if slips is None else (slips,)
    model = Model(joints_as_logged(6), None, corrections, layout, (samples,))
    return fit(model, x, [ballbar], EXCESS)


def slipped(joint: int, at: float, size: float, seed: int = 41) -> Array:
    exact, noise = angles(TIMES, seed)
    exact[at <= TIMES, joint - 1] += size
    return exact + noise


def clock_set(at: float, step: float, seed: int = 41) -> Array:
    """The ball-bar's clock is set forward by `step` [s]: it shows what was `step` earlier."""
    exact, noise = angles(TIMES - step * (at <= TIMES), seed)
    return exact + noise


@pytest.mark.parametrize("seed", [41, 42, 43])
def test_clean_data_have_no_step_fault(seed: int) -> None:
    exact, noise = angles(TIMES, seed)
    assert find_step_fault(fitted(exact + noise)) is None


@pytest.mark.parametrize(("size", "found"), [(0.0, False), (1e-3, False), (3e-3, True)])
def test_a_step_counts_where_noise_and_what_a_model_lacks_could_not_bring_it_about(
    size: float, found: bool
) -> None:
    """Under 1 mrad of noise fifty samples tell of it, so chi-square falls by 0, 50 and 450."""
    exact, noise = angles(TIMES, 41)
    ballbar = exact + 100.0 * noise
    ballbar[TIMES >= 30.0, 0] += size
    fault = find_step_fault(fitted(ballbar, louder=100.0))
    assert (fault is not None) == found
    assert fault is None or fault.size == pytest.approx(size, rel=0.1)


def test_a_complete_fit_without_a_slip_has_no_step_fault(machine_fit: Fit) -> None:
    assert find_step_fault(machine_fit) is None


@pytest.mark.parametrize("joint", UNIVERSAL_AND_GIMBAL)
@pytest.mark.parametrize("periods", [1, -2])
def test_a_slip_of_an_encoder_is_found_where_it_is_and_sized(joint: int, periods: int) -> None:
    ballbar = slipped(joint, 31.13, periods * PERIOD)
    fault = find_step_fault(fitted(ballbar))
    assert fault is not None
    assert (fault.recording, fault.kind, fault.joint) == (0, "encoder", joint)
    assert fault.time == pytest.approx(31.13, abs=0.2)  # between two samples 0.2 s apart
    # 10 urad of noise, but other unknowns have absorbed a part of the step
    refitted = fitted(ballbar, (fault,))
    (whole,) = sized(refitted, (fault,), LINES)
    assert whole.periods == periods
    assert whole.size == pytest.approx(periods * PERIOD, abs=2e-5)
    assert find_step_fault(refitted) is None


@pytest.mark.parametrize("step", [0.05, -0.02])
def test_a_step_of_the_ball_bars_clock_is_found_where_it_is_and_sized(step: float) -> None:
    ballbar = clock_set(24.71, step)
    fault = find_step_fault(fitted(ballbar))
    assert fault is not None
    assert (fault.kind, fault.joint) == ("clock", 0)
    assert fault.time == pytest.approx(24.71, abs=0.3)
    refitted = fitted(ballbar, (fault,))
    (clock,) = sized(refitted, (fault,), LINES)
    assert clock.size == pytest.approx(step, abs=1e-4)
    assert clock.periods == 0
    assert find_step_fault(refitted) is None


def test_the_larger_of_two_faults_is_found_first_and_the_other_after_it() -> None:
    ballbar = slipped(4, 20.0, 3 * PERIOD)
    ballbar[TIMES >= 40.0, 0] += PERIOD
    first = find_step_fault(fitted(ballbar))
    assert first is not None
    second = find_step_fault(fitted(ballbar, (first,)))
    assert second is not None
    assert [(f.joint, round(f.time)) for f in (first, second)] == [(4, 20), (1, 40)]
    both = sized(fitted(ballbar, (first, second)), (first, second), LINES)
    assert [f.periods for f in both] == [3, 1]


def test_a_step_smaller_than_the_smallest_is_left_to_the_residual() -> None:
    """1e-4 rad is more than noise, but something smooth that a model lacks looks like it."""
    assert find_step_fault(fitted(slipped(2, 30.0, 1e-4))) is None


@pytest.mark.parametrize(("size", "found"), [(1.6e-3, False), (-1.6e-3, False), (2.5e-3, True)])
def test_a_clock_step_shorter_than_two_milliseconds_is_something_smooth(
    size: float, found: bool
) -> None:
    assert (find_step_fault(fitted(clock_set(30.0, size))) is not None) == found


@pytest.mark.parametrize("at", [TIMES[5] - 0.01, TIMES[-5] - 0.01])
def test_a_step_at_either_end_is_little_more_than_a_different_start(at: float) -> None:
    fault = find_step_fault(fitted(slipped(1, at, PERIOD)))
    assert fault is None or TIMES[14] < fault.time < TIMES[-15]


def test_a_slip_is_found_among_all_corrections(machine: CompleteModel) -> None:
    """The reading of b4 jumps by one signal period of 3600 lines behind t = 40 s."""
    ballbar = machine.ballbar.copy()
    ballbar[machine.model.recordings[0].times >= 40.0, 3] += PERIOD
    fault = find_step_fault(fit(machine.model, machine.x, [ballbar], EXCESS))
    assert fault is not None
    assert (fault.kind, fault.joint) == ("encoder", 4)
    assert fault.time == pytest.approx(40.0, abs=0.3)
    assert abs(fault.size) == pytest.approx(PERIOD, rel=0.1)


HELD = (25.0, 33.0)  # [s] the robot stands still in between


def warped(t: Array) -> Array:
    """[s] of the minute's path at t (N,) [s] of a motion that pauses over HELD."""
    pause = np.clip(t - HELD[0], 0.0, HELD[1] - HELD[0])
    return t - pause


def paused(at: float, step: float, stamp: float | None) -> Fit:
    """A clock step inside a dwell; stamp : [s] of the log's irregular stamp of that size."""
    path, columns = minute(), [j - 1 for j in UNIVERSAL_AND_GIMBAL]
    b = exact_log(path.t, path.b)
    # A spline through all rows of a motion that stops would ring; rows close by keep that small.
    t = np.arange(0.0, 50.0, 0.01)
    held = np.asarray(b.spline(warped(t)))
    q = closed(NOMINAL, held, np.asarray(exact_log(path.t, path.q).spline(warped(t))))
    robot, ballbar = exact_log(t, q), exact_log(t, held[:, columns])
    if stamp is not None:
        ballbar = replace(ballbar, stamps=t + step * (t > stamp))
    times = np.arange(2.0, 48.0, 0.2)
    samples = replace(samples_with(), robot=robot, ballbar=ballbar, times=times)
    layout, x = layout_of(())
    model = Model(joints_as_logged(6), None, (), layout, (samples,))
    rng = np.random.default_rng(44)
    angles = b.spline(warped(times - step * (times >= at)))
    angles = angles + NOISE * rng.standard_normal(angles.shape)
    return fit(model, x, [angles], EXCESS)


def test_in_a_dwell_only_the_stamps_tell_when_the_clock_was_set() -> None:
    unknown = find_step_fault(paused(29.0, 0.05, None))
    assert unknown is not None
    assert unknown.kind == "clock"
    assert HELD[0] - 0.3 < unknown.time < HELD[1] + 0.3
    stamped = find_step_fault(paused(29.0, 0.05, 29.004))
    assert stamped is not None
    assert stamped.time == pytest.approx(29.03, abs=0.03)  # the middle of the long row


def test_an_irregular_stamp_of_another_size_tells_nothing() -> None:
    fit = paused(29.0, 0.05, None)
    (samples,) = fit.model.recordings
    assert samples.ballbar is not None
    t = samples.ballbar.stamps
    late = replace(samples.ballbar, stamps=t + 0.5 * (t > 27.0))
    model = replace(fit.model, recordings=(replace(samples, ballbar=late),))
    plain, other = find_step_fault(fit), find_step_fault(replace(fit, model=model))
    assert plain is not None
    assert other is not None
    assert other.time == plain.time


def broken(log: SmoothLog, *steps: LogStep) -> SmoothLog:
    return replace(log, steps=steps)


def test_what_the_logs_showed_by_themselves_is_taken_over() -> None:
    samples = samples_with()
    assert samples.ballbar is not None
    bar = broken(
        samples.ballbar,
        LogStep(row=200, time=10.0, channel=2, size=0.3),
        LogStep(row=300, time=15.0, channel=None, size=0.04),
    )
    robot = broken(
        samples.robot,
        LogStep(row=100, time=5.0, channel=None, size=0.01),
        LogStep(row=400, time=20.0, channel=3, size=0.1),  # a joint's is no fault of a recording
    )
    samples = replace(samples, ballbar=bar, robot=robot, directions=np.array([1, 1, -1.0, 1]))
    slip, step, robots = step_faults_in_logs(samples, Clock(2.0, 0.0), recording=1)
    assert (slip.kind, slip.joint, slip.time, slip.size) == ("encoder", 4, 10.0, -0.3)
    assert slip.removed == slip.size
    assert slip.recording == 1
    assert (step.kind, step.joint, step.time, step.size) == ("clock", 0, 15.0, 0.04)
    # the robot's clock set forward is the ball-bar's set back, at the ball-bar's time
    assert (robots.kind, robots.time, robots.size) == ("clock", 3.0, -0.01)


def test_a_recording_without_encoders_has_no_step_faults_of_its_own() -> None:
    samples = samples_with()
    robot = broken(samples.robot, LogStep(row=100, time=5.0, channel=None, size=0.01))
    assert step_faults_in_logs(replace(samples, robot=robot, ballbar=None), NO_CLOCK_ERROR) == ()


def state(times: Array, recording: int) -> State:
    n = times.size
    return State(
        t=times,
        recording=recording,
        gears=np.zeros((6, n)),
        bar=np.zeros((5, n)),
        loads=no_loads(6, n),
        tension=np.zeros(n),
        width=np.ones(6),
        gear_speed=np.zeros((6, n)),
        gear_acceleration=np.zeros((6, n)),
    )


def test_slips_are_a_correction_that_steps_in_its_own_recording_only() -> None:
    faults = (
        StepFault(0, "encoder", 2, 10.0, 0.1),
        StepFault(0, "clock", 0, 12.0, 0.1),
        StepFault(1, "encoder", 5, 20.0, 0.2, periods=115, removed=0.199),
    )
    slips = encoder_slips(faults)
    assert slips is not None
    free, exact = slips.coefficients
    assert [c.name for c in slips.coefficients] == ["jump1_b2", "jump2_b5"]
    assert [c.channel for c in slips.coefficients] == [BAR + 1, BAR + 4]
    assert (free.mean, free.sigma) == (0.0, SLIP_PRIOR)
    assert exact.mean == pytest.approx(0.199 - 0.2)  # what is left to take out of the log
    assert exact.sigma == EXACT
    times = np.array([9.9, 10.0, 19.9, 20.0])
    assert [list(r) for r in slips.regressors(state(times, 0))] == [[0, 1, 1, 1], [0, 0, 0, 0]]
    assert [list(r) for r in slips.regressors(state(times, 1))] == [[0, 0, 0, 0], [0, 0, 0, 1]]
    assert slips.slopes is None
    assert encoder_slips(faults[1:2]) is None


def test_sizes_are_what_the_log_lost_and_what_the_fit_took_out_beyond_it() -> None:
    """A slip of two periods, of which a part was taken out of the log before the fit."""
    removed = 2 * PERIOD - 3e-4
    fault = StepFault(0, "encoder", 5, 30.0, removed, removed=removed)
    (found,) = sized(fitted(slipped(5, 30.0, 3e-4), (fault,)), (fault,), LINES)
    assert found.size == pytest.approx(2 * PERIOD, abs=2e-5)
    assert found.periods == 2


def test_a_step_that_the_fit_puts_back_was_motion_and_no_fault() -> None:
    fault = StepFault(0, "encoder", 5, 30.0, 1e-3, removed=1e-3)
    refitted = fitted(slipped(5, 30.0, -1e-3), (fault,))  # the log lost what was none
    assert sized(refitted, (fault,), LINES) == ()


def test_slips_by_whole_periods_are_held_at_that_size() -> None:
    fault = StepFault(0, "encoder", 4, 30.0, 0.0)
    free = fitted(slipped(4, 30.0, 3 * PERIOD), (fault,))
    (exact,) = with_exact_periods(free, (fault,), LINES)
    assert exact.periods == 3
    assert exact.size == pytest.approx(3 * PERIOD, rel=1e-12)
    held = fitted(slipped(4, 30.0, 3 * PERIOD), (exact,))
    jump = held.model.unknowns.names.index("jump1_b4")
    assert held.x[jump] == pytest.approx(-3 * PERIOD, abs=1e-8)
    assert np.sqrt(held.covariance[jump, jump]) == pytest.approx(EXACT, rel=1e-3)


@pytest.mark.parametrize("periods", [0.6, 2.05, 0.0])
def test_slips_that_are_no_whole_number_of_periods_stay_free(periods: float) -> None:
    fault = StepFault(0, "encoder", 4, 30.0, 1e-3)
    free = fitted(slipped(4, 30.0, periods * PERIOD), (fault,))
    assert with_exact_periods(free, (fault,), LINES) == (fault,)


def test_clock_steps_of_several_recordings_are_told_apart_by_name() -> None:
    faults = (StepFault(1, "clock", 0, 9.0, 0.0), StepFault(0, "clock", 0, 8.0, 0.0))
    layout, x = layout_of(faults, recordings=2)
    x[layout.names.index("clock_step1@1")] = -0.03
    x[layout.names.index("clock_step1@2")] = 0.07
    single = fitted(angles(TIMES, 41)[0])
    several = replace(
        single,
        linear=replace(single.linear, x=x),
        model=replace(single.model, unknowns=layout, recordings=single.model.recordings * 2),
    )
    assert [f.size for f in sized(several, faults, LINES)] == pytest.approx([-0.07, 0.03])


@pytest.mark.parametrize(
    ("size", "periods"),
    [(2.05 * PERIOD, 2), (-0.95 * PERIOD, -1), (2.2 * PERIOD, 0), (0.4 * PERIOD, 0)],
)
def test_whole_periods_are_recognised_to_a_tenth(size: float, periods: int) -> None:
    assert as_logged(StepFault(0, "encoder", 1, 3.0, size), None, LINES).periods == periods


def test_times_are_those_of_the_log_with_the_clock_steps_before_them() -> None:
    log = broken(
        samples_with().ballbar,
        LogStep(100, 5.0, None, 0.4),
        LogStep(200, 10.0, 1, 0.3),
        LogStep(300, 15.0, None, -0.1),
    )
    at = [
        as_logged(StepFault(0, kind, 0, t, 0.5), log, LINES).time
        for kind, t in (("clock", 4.0), ("encoder", 12.0), ("clock", 20.0))
    ]
    assert at == pytest.approx([4.0, 12.4, 20.3])
