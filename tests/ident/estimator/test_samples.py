"""Instants of a recording: where both logs exist and the robot moves, and what is known there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.geometry import robot_frames
from ballbar.ident.estimator.closure import close_loop
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.sample_times import (
    DWELL_KEPT,
    MARGIN,
    STRETCH,
    close_times,
    overlap,
    sample_times,
)
from ballbar.ident.estimator.samples import Samples, samples_of
from ballbar.ident.signals.smooth_log import smooth_log
from tests.helpers.synthetic_recording import NO_CLOCK_ERROR, NOMINAL, exact_log, recording


def motion(t: Array) -> Array:
    return np.stack((np.sin(0.7 * t) + 0.3 * np.sin(1.9 * t), 0.8 + 0.4 * np.cos(0.45 * t)), axis=1)


def test_samples_avoid_gaps_and_long_dwells() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 60.0, 0.01)
    t = t[(t < 30.0) | (t > 31.5)]
    # at rest until 20 s and from 50 s
    moving = 15.0 + 15.0 * np.sin(np.pi * (np.clip(t, 20.0, 50.0) - 35.0) / 30.0)
    values = motion(moving) + rng.normal(0, 1e-6, (t.size, 2))
    log = smooth_log(t, values, widest_knot_spacing=0.08)
    times = sample_times(log, log, NO_CLOCK_ERROR, 500)
    assert not ((times > 30.0) & (times < 31.5)).any()
    assert times[0] == pytest.approx(19.0, abs=0.3)
    assert times[-1] == pytest.approx(51.0, abs=0.3)
    with pytest.raises(ValueError, match="do not overlap"):
        sample_times(log, log, Clock(100.0, 0.0), 500)


def test_a_gap_of_either_log_has_no_samples() -> None:
    t = np.arange(0.0, 40.0, 0.02)
    whole = exact_log(t, np.sin(t)[:, None])
    holed = replace(whole, gaps=np.array([[20.0, 22.0]]))
    clock = Clock(3.0, 0.0)  # the robot's clock is 3 s ahead of the ball-bar's
    for robot, ballbar, first, last in ((whole, holed, 20.0, 22.0), (holed, whole, 17.0, 19.0)):
        times = sample_times(robot, ballbar, clock, 400)
        inside = (times > first) & (times < last)
        assert not inside.any()
        assert np.diff(times).max() == pytest.approx(last - first, abs=0.2)


def test_samples_that_must_be_close_come_in_stretches_over_a_long_recording() -> None:
    t = np.arange(0.0, 1200.0, 0.05)
    whole = exact_log(t, np.sin(t)[:, None])
    holed = replace(whole, gaps=np.array([[10.0, 12.0]]))
    every = sample_times(whole, whole, NO_CLOCK_ERROR, 600)
    samples = samples_of(holed, None, (), (), every)
    times = close_times(samples, NO_CLOCK_ERROR, 0.2)
    begins = np.flatnonzero(np.diff(times, prepend=-np.inf) > 3.0)
    assert np.diff(times[begins]) == pytest.approx(np.full(5, (1200.0 - STRETCH) / 5), rel=0.01)
    assert times.size == pytest.approx(600 - 10, abs=2)  # the gap's are missing
    assert np.median(np.diff(times)) == pytest.approx(0.2)
    assert times[-1] == pytest.approx(every[-1], abs=0.21)
    assert close_times(samples, NO_CLOCK_ERROR, 2.1) is every  # close enough as they are


def test_a_second_of_the_dwell_at_either_end_is_kept() -> None:
    """Where the motion starts and stops tells the clock."""
    t = np.arange(0.0, 40.0, 0.02)
    at_rest = exact_log(t, np.sin(np.clip(t, 10.0, 25.0))[:, None])
    times = sample_times(at_rest, None, NO_CLOCK_ERROR, 100)
    # the grid on which motion is looked for is 0.2 s wide, and a spline rings where motion starts
    assert times[0] == pytest.approx(10.0 - DWELL_KEPT, abs=0.4)
    assert times[-1] == pytest.approx(25.0 + DWELL_KEPT, abs=0.4)
    assert times.size == 100


def test_samples_are_spread_evenly_over_what_both_logs_cover() -> None:
    t = np.arange(0.0, 40.0, 0.02)
    log = exact_log(t, np.sin(t)[:, None])
    times = sample_times(log, log, Clock(5.0, 0.0), 50)  # the ball-bar's log begins 5 s later
    assert np.diff(times) == pytest.approx(np.diff(times)[0])
    assert times[[0, -1]] == pytest.approx([MARGIN, 40.0 - 0.02 - 5.0 - MARGIN])


def test_samples_are_no_closer_than_the_logs_are_smoothed() -> None:
    t = np.arange(0.0, 40.0, 0.02)
    fine = exact_log(t, np.sin(t)[:, None])
    smooth = replace(fine, knot_spacing=0.1)
    for robot, ballbar in ((smooth, fine), (fine, smooth), (smooth, None)):
        times = sample_times(robot, ballbar, NO_CLOCK_ERROR, 3000)
        assert 0.1 <= np.diff(times).min() < 0.101


def test_a_robot_that_stands_still_is_refused() -> None:
    t = np.arange(0.0, 20.0, 0.02)
    log = exact_log(t, np.full((t.size, 1), 0.3))
    with pytest.raises(ValueError, match="stands still wherever the two logs overlap"):
        sample_times(log, log, NO_CLOCK_ERROR, 50)


@pytest.mark.parametrize(
    ("clock", "expected"),
    [
        (Clock(0.0, 0.0), (0.0, 10.0)),
        (Clock(4.0, 0.0), (0.0, 10.0)),
        (Clock(-4.0, 0.0), (4.0, 10.0)),
        (Clock(15.0, 0.0), (0.0, 5.0)),
        (Clock(-4.0, 1e-3), (4.0 / 1.001, 10.0)),
    ],
)
def test_the_overlap_is_counted_on_the_ball_bars_clock(
    clock: Clock, expected: tuple[float, float]
) -> None:
    robot_t, bar_t = np.linspace(0.0, 20.0, 201), np.linspace(0.0, 10.0, 101)
    robot, bar = exact_log(robot_t, np.sin(robot_t)[:, None]), exact_log(bar_t, bar_t[:, None])
    assert overlap(robot, bar, clock) == pytest.approx(expected)


def test_logs_that_do_not_overlap_end_before_they_start() -> None:
    t = np.linspace(0.0, 10.0, 101)
    log = exact_log(t, t[:, None])
    first, last = overlap(log, log, Clock(12.0, 0.0))
    assert last < first


def test_without_encoders_the_overlap_is_the_robots_log() -> None:
    t = np.linspace(2.0, 10.0, 101)
    assert overlap(exact_log(t, t[:, None]), None, Clock(5.0, 0.0)) == (2.0, 10.0)


@pytest.mark.parametrize("encoders", [(), (1, 2), (1, 2, 4, 5), (1, 2, 3, 4, 5)])
def test_the_angles_of_an_exact_recording_close_the_loop_on_either_clock(
    encoders: tuple[int, ...],
) -> None:
    clock = Clock(0.4, 2e-4) if encoders else NO_CLOCK_ERROR
    samples = recording(encoders=encoders, clock=clock)
    q = samples.robot.spline(samples.robot_time(clock, samples.times))
    b = samples.ballbar_angles(NOMINAL, clock)
    # A spline through rows 0.05 s apart leaves 1e-7 rad between them.
    assert np.abs(close_loop(NOMINAL, q, b).error).max() < 1e-7
    assert samples.has_clock == bool(encoders)
    assert samples.unmeasured == [j for j in range(5) if j + 1 not in encoders]


def test_an_encoder_that_counts_backwards_is_turned_round() -> None:
    samples = recording(encoders=(1, 2))
    turned = replace(samples, directions=np.array([-1.0, 1.0]))
    there, back = (s.ballbar_angles(NOMINAL, NO_CLOCK_ERROR) for s in (samples, turned))
    assert np.array_equal(back[:, 0], -there[:, 0])
    assert np.array_equal(back[:, 1], there[:, 1])


def test_angles_are_stated_at_any_instants() -> None:
    samples = recording()
    t = samples.times[10:20] + 0.013
    direct = samples.ballbar_angles(NOMINAL, NO_CLOCK_ERROR, t)
    assert np.array_equal(direct[:, [0, 1, 3, 4]], samples.ballbar.spline(t))
    tips = robot_frames(NOMINAL, samples.robot.spline(t)).tip
    assert np.abs(close_loop(NOMINAL, samples.robot.spline(t), direct).bar.tip - tips).max() < 1e-6


def test_robot_times_stay_inside_the_robots_log() -> None:
    samples = recording()
    times = samples.robot_time(Clock(-100.0, 0.0), samples.times)
    assert (times == samples.robot.start).all()


def test_the_noise_of_a_sample_is_that_of_the_smoothed_log() -> None:
    """Unmeasured joints have none; rows that are averaged over leave less."""
    t, rng = np.arange(0.0, 30.0, 0.004), np.random.default_rng(7)
    angles = np.tile(motion(t), 3)
    robot = smooth_log(t, angles + rng.normal(0, 2e-5, angles.shape), widest_knot_spacing=0.08)
    bar = smooth_log(t, angles[:, :2] + rng.normal(0, 4e-5, (t.size, 2)), widest_knot_spacing=0.08)
    samples = samples_of(robot, bar, (4, 5), (1.0, 1.0), np.arange(1.0, 29.0, 0.2))
    averaged = np.sqrt(0.004 / 0.08)  # one row in twenty's worth of coefficients
    assert samples.joint_noise == pytest.approx(np.full(6, 2e-5 * averaged), rel=0.03)
    assert samples.encoder_noise == pytest.approx([0, 0, 0, 4e-5 * averaged, 4e-5 * averaged], 0.03)
    assert samples.smoothing == 0.08
    assert samples.spacing == pytest.approx(0.2)
    dense = samples_of(robot, bar, (4, 5), (1.0, 1.0), samples.times, spacing=0.02)
    assert dense.joint_noise == pytest.approx(2.0 * samples.joint_noise)


def test_thinned_samples_are_every_nth_with_all_that_belongs_to_them() -> None:
    samples: Samples = recording()
    splines = np.arange(2.0 * samples.times.size).reshape(2, -1)
    full = replace(samples, tension=np.sin(samples.times), splines=type(samples.splines)(splines))
    thin = full.thinned(3)
    assert np.array_equal(thin.times, full.times[::3])
    assert np.array_equal(thin.tension, full.tension[::3])
    assert np.array_equal(thin.splines.toarray(), splines[:, ::3])


def test_clock_steps_act_from_their_instant_on() -> None:
    samples = recording()
    at = float(samples.times[100])
    after = replace(samples, clock_steps=(at, at + 1e9)).after_clock_steps()
    assert after.shape == (2, samples.times.size)
    assert np.array_equal(after[0], np.arange(samples.times.size) >= 100)
    assert not after[1].any()
    assert samples.after_clock_steps().shape == (0, samples.times.size)


def test_each_encoder_has_the_noise_of_its_channel_and_none_where_it_is_not_fitted() -> None:
    samples = recording(encoders=(2, 4, 5), stated=3e-6)
    ballbar = replace(samples.ballbar, noise=np.array([1e-6, 2e-6, 3e-6]))
    noise = replace(samples, ballbar=ballbar).log_noise
    assert np.array_equal(noise.encoder, [0.0, 1e-6, 0.0, 2e-6, 3e-6])
    assert np.array_equal(noise.joint, np.full(6, 3e-6))


def test_a_ball_bar_without_encoders_has_no_noise() -> None:
    samples = recording(encoders=())
    assert not samples.log_noise.encoder.any()


def test_without_excess_noise_the_logs_say_it_all() -> None:
    assert ExcessNoise() == ExcessNoise(gear=0.0, wrist=0.0, bar=0.0, rod=0.0)
