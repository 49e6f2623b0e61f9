"""Smoothing, sphere and lag scan: the pieces of the automatic start, each against a case with a known answer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ident.estimator.problem import Clock
from ident.estimator.sampling import sample_times

from ident.estimator.uncertainty import autocorrelation
from ident.signals.smooth_log import smooth_log, smoothing
from ident.signals.steps import find_breaks
from ident.start.lag_scan import Pair, PairScan, best_lags, scan_lags, subsample
from ident.start.sphere import sphere_candidates

STEP = 0.02  # [s]


def motion(t: np.ndarray) -> np.ndarray:
    return np.stack((np.sin(0.7 * t) + 0.3 * np.sin(1.9 * t), 0.8 + 0.4 * np.cos(0.45 * t)), axis=1)


def test_smoothing_recovers_values_speeds_and_the_noise_level() -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.choice([0.010, 0.015], 8000, p=[0.99, 0.01]))
    log = smooth_log(t, motion(t) + rng.normal(0, 2e-5, (t.size, 2)), widest_knot_spacing=0.08)
    inner = np.linspace(1.0, t[-1] - 1.0, 3000)
    error = log.spline(inner) - motion(inner)
    assert log.noise == pytest.approx([2e-5, 2e-5], rel=0.03)  # 8000 rows: 1 % of sampling noise
    assert error.std(axis=0) == pytest.approx(log.sample_sigma(0.2), rel=0.15)
    assert (
        np.abs(
            log.speed(inner)[:, 0] - (0.7 * np.cos(0.7 * inner) + 0.57 * np.cos(1.9 * inner))
        ).max()
        < 2e-3
    )


def test_smoothing_delays_nothing() -> None:
    t = np.arange(0.0, 60.0, 0.01)
    forth = smooth_log(t, motion(t), widest_knot_spacing=0.08)
    back = smooth_log(t, motion(t)[::-1].copy(), widest_knot_spacing=0.08)
    inner = np.linspace(1.0, 58.0, 500)
    assert np.abs(forth.spline(inner) - back.spline(t[-1] - inner)).max() < 1e-9
    assert np.abs(forth.spline(inner) - motion(inner)).max() < 1e-9


def test_a_quick_motion_gets_closer_knots_than_a_slow_one() -> None:
    t = np.arange(0.0, 30.0, 0.004)
    rng = np.random.default_rng(2)
    quick = np.sin(2 * np.pi * 6.0 * t)[:, None] + rng.normal(0, 1e-5, (t.size, 1))
    assert smooth_log(t, quick, widest_knot_spacing=0.08).knot_spacing < 0.03
    assert (
        smooth_log(
            t, motion(t) + rng.normal(0, 1e-5, (t.size, 2)), widest_knot_spacing=0.08
        ).knot_spacing
        == 0.08
    )


def test_a_log_with_two_of_three_rows_lost_for_seconds_is_smoothed_as_well_as_any() -> None:
    for seed in range(100):
        rng = np.random.default_rng(seed)
        rows = np.arange(3000)
        t = 0.004 * rows[rng.random(rows.size) < np.where(rows // 500 % 2, 0.3, 1.0)]
        log = smooth_log(t, motion(t) + rng.normal(0, 1e-5, (t.size, 2)), widest_knot_spacing=0.012)
        assert np.abs(log.spline(t) - motion(t)).max() < 1e-4, seed


def test_the_arm_accelerates_as_the_path_does_and_not_with_the_ripple_of_the_log() -> None:
    t = np.arange(0.0, 60.0, 0.004)
    rng = np.random.default_rng(4)
    ripple = 1e-5 * np.sin(2.0 * np.pi * 15.0 * t)  # a resolver's: 0.09 rad/s^2
    log = smooth_log(
        t, motion(t) + ripple[:, None] + rng.normal(0, 2e-6, (t.size, 2)), widest_knot_spacing=0.08
    )
    inner = np.linspace(1.0, 59.0, 2000)
    true = -0.49 * np.sin(0.7 * inner) - 1.083 * np.sin(1.9 * inner)
    assert (
        np.abs(log.spline(inner, 2)[:, 0] - true).max() > 0.05
    )  # what inertia would be multiplied with
    assert np.abs(log.arm(inner, 2)[:, 0] - true).max() < 2e-3


def test_smoothed_noise_is_not_taken_for_a_systematic_residual_however_dense_the_samples() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 60.0, 0.004)
    log = smooth_log(t, motion(t) + rng.normal(0, 1e-5, (t.size, 2)), widest_knot_spacing=0.08)
    for step in (0.2, 0.07, 0.03, 0.01):
        times = np.arange(1.0, 59.0, step)
        assert (
            abs(autocorrelation((log.spline(times) - motion(times)).T, times, smoothing(log, None)))
            < 0.15
        )
        drift = np.sin(times / 2.0)[None] + 0.3 * rng.normal(0.0, 1.0, (1, times.size))
        assert autocorrelation(drift, times, smoothing(log, None)) > 0.7


def test_samples_avoid_gaps_and_long_standstills() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 60.0, 0.01)
    t = t[(t < 30.0) | (t > 31.5)]
    moving = 15.0 + 15.0 * np.sin(
        np.pi * (np.clip(t, 20.0, 50.0) - 35.0) / 30.0
    )  # at rest until 20 s and from 50 s
    values = motion(moving) + rng.normal(0, 1e-6, (t.size, 2))
    log = smooth_log(t, values, widest_knot_spacing=0.08)
    times = sample_times(log, log, Clock(0.0, 0.0), 500)
    assert not ((times > 30.0) & (times < 31.5)).any()
    assert times[0] == pytest.approx(19.0, abs=0.3)
    assert times[-1] == pytest.approx(51.0, abs=0.3)
    with pytest.raises(ValueError, match="do not overlap"):
        sample_times(log, log, Clock(100.0, 0.0), 500)


def test_the_sphere_is_found_from_points_on_a_patch_of_it() -> None:
    rng = np.random.default_rng(4)
    u = rng.normal(0, 1, (400, 3)) * np.array([1, 1, 0.4]) + np.array([0, 0, 1.5])
    points = (
        np.array([0.7, -0.2, 0.5])
        + 0.602 * u / np.linalg.norm(u, axis=1)[:, None]
        + rng.normal(0, 1e-3, (400, 3))
    )
    found = sphere_candidates(points, 0.6)
    assert len(found) == 1
    assert found[0].centre == pytest.approx([0.7, -0.2, 0.5], abs=2e-3)
    assert found[0].radius == pytest.approx(0.602, abs=2e-3)


def test_points_on_a_circle_leave_two_centres() -> None:
    angle = np.linspace(0, 2 * np.pi, 200)
    points = np.stack((0.4 * np.cos(angle), 0.4 * np.sin(angle), np.zeros(200)), axis=1)
    heights = sorted(s.centre[2] for s in sphere_candidates(points, 0.5))
    assert heights == pytest.approx([-0.3, 0.3], abs=1e-3)


def test_a_standing_tool_shows_no_sphere() -> None:
    with pytest.raises(ValueError, match="moves less than a hundredth"):
        sphere_candidates(np.zeros((50, 3)) + 0.001, 0.6)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(-2000, 2000),
    st.sampled_from([1, -1]),
    st.floats(-3.1, 3.1),
    st.floats(-3.1, 3.1),
    st.booleans(),
)
def test_lag_sign_and_both_zeros_of_a_pair_come_out_of_one_scan(
    lag: int, sign: int, zero1: float, zero2: float, truncated: bool
) -> None:
    """A gimbal that follows a direction for 100 s, shifted by up to 40 s: everything is read off the two signals."""
    k = np.arange(7000 if truncated else 9000)
    full = np.arange(-3000, 12000) * STEP
    moving = np.clip(full, 20.0, 110.0)
    t1 = 1.3 * np.sin(0.31 * moving) + 0.5 * np.sin(0.83 * moving + 1)
    t2 = -0.9 + 0.5 * np.sin(0.23 * moving + 2)
    direction = np.stack((-np.sin(t2) * np.cos(t1), -np.sin(t2) * np.sin(t1), np.cos(t2)), axis=1)
    robot = direction[3000 : 3000 + k.size]
    e1, e2 = sign * (t1 - zero1), t2 - zero2
    seen = slice(3000 + lag, 3000 + lag + k.size)
    scan = PairScan(Pair(e1[seen], e2[seen], robot), STEP)
    lags = scan_lags([scan])
    best = best_lags(lags, count=1, separation=100)[0]
    assert abs(subsample(lags, best) - lag) < 1.0
    branch = scan.branches(int(np.flatnonzero(lags.lags == lag)[0]))[0]
    assert branch.sign == sign
    assert abs(np.angle(np.exp(1j * (branch.turning_offset - zero1)))) < 1e-3
    assert abs(np.angle(np.exp(1j * (branch.tilting_offset - zero2)))) < 1e-3
    assert branch.variance < 1e-5


def test_smoothing_delays_neither_log_against_the_other() -> None:
    """The same motion in logs of 4.032 and 10 ms with noise: what smoothing shifts is far below a microsecond."""
    rng = np.random.default_rng(4)
    motion = lambda t: np.stack([0.5 * np.sin(1.3 * t), 0.4 * np.cos(0.9 * t + 0.3)], axis=1)  # noqa: E731
    inner = np.linspace(2.0, 58.0, 4000)
    speed = np.stack([0.65 * np.cos(1.3 * inner), -0.36 * np.sin(0.9 * inner + 0.3)], axis=1)
    for period in (0.004032, 0.010):
        t = np.arange(0.0, 60.0, period)
        log = smooth_log(
            t, motion(t) + rng.normal(0.0, 1e-6, (t.size, 2)), widest_knot_spacing=0.08
        )
        delay = -((log.spline(inner) - motion(inner)) * speed).sum() / (speed * speed).sum()
        assert (
            abs(delay) < 2e-7
        )  # [s] noise of 1 urad over 60 s leaves 3e-8; a causal filter of one row would delay by 4e-3


@pytest.mark.parametrize("missing", [0, 1, 2, 5])
def test_a_clock_step_beside_rows_that_were_left_out_is_measured(missing: int) -> None:
    """Regression: the reader had left out two damaged rows behind a clock step of 50 ms.

    The gap was 20 ms wider than the step, and it passed for three steps of encoders.
    """
    t = np.arange(0.0, 20.0, 0.01)
    rng = np.random.default_rng(2)
    values = motion(t) + rng.normal(0, 1e-6, (t.size, 2))
    stamps = t + 0.05 * (t >= 10.0)
    rows = (t < 10.0) | (t >= 10.0 + 0.01 * missing - 1e-9)
    breaks = find_breaks(stamps[rows], values[rows], checked=True)
    assert [step.channel for step in breaks] == [None]
    # [s] the motion is no cubic over 25 rows: with five missing it leaves 0.3 ms.
    assert breaks[0].size == pytest.approx(0.05, abs=5e-4)
