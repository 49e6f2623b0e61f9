"""Logs as smooth functions of time, against motions that are known."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.ident.signals.smooth_log import _in_motion, smooth_log
from ballbar.ident.signals.steps import find_steps


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
    # what inertia would be multiplied with
    assert np.abs(log.spline(inner, 2)[:, 0] - true).max() > 0.05
    assert np.abs(log.arm(inner, 2)[:, 0] - true).max() < 2e-3


def test_smoothing_delays_neither_log_against_the_other() -> None:
    """The same motion in logs of 4.032 and 10 ms with noise is shifted by far less than 1 us."""
    rng = np.random.default_rng(4)

    def motion(t: np.ndarray) -> np.ndarray:
        return np.stack([0.5 * np.sin(1.3 * t), 0.4 * np.cos(0.9 * t + 0.3)], axis=1)

    inner = np.linspace(2.0, 58.0, 4000)
    speed = np.stack([0.65 * np.cos(1.3 * inner), -0.36 * np.sin(0.9 * inner + 0.3)], axis=1)
    for period in (0.004032, 0.010):
        t = np.arange(0.0, 60.0, period)
        log = smooth_log(
            t, motion(t) + rng.normal(0.0, 1e-6, (t.size, 2)), widest_knot_spacing=0.08
        )
        delay = -((log.spline(inner) - motion(inner)) * speed).sum() / (speed * speed).sum()
        # [s] noise of 1 urad over 60 s leaves 3e-8; a causal filter of one row would delay by 4e-3.
        assert abs(delay) < 2e-7


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
    steps = find_steps(stamps[rows], values[rows], checked=True)
    assert [step.channel for step in steps] == [None]
    # [s] the motion is no cubic over 25 rows: with five missing it leaves 0.3 ms.
    assert steps[0].size == pytest.approx(0.05, abs=5e-4)


@pytest.mark.parametrize(("size", "damage"), [(0.05, 5e-3), (180.0, 0.0)])
def test_a_clock_step_has_its_size_beside_a_damaged_value_and_over_minutes(
    size: float, damage: float
) -> None:
    t = np.arange(0.0, 20.0, 0.01)
    values = motion(t) + np.random.default_rng(3).normal(0, 1e-6, (t.size, 2))
    values[1003, 0] += damage
    (step,) = find_steps(t + size * (t >= 10.0 - 1e-9), values, checked=damage > 0.0)
    assert (step.row, step.channel) == (1000, None)
    assert step.size == pytest.approx(size, abs=1e-4)


def test_a_pause_of_seconds_in_which_the_arm_moved_on_is_no_step() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    values = motion(t) + np.random.default_rng(5).normal(0, 1e-6, (t.size, 2))
    rows = (t < 8.0) | (t >= 11.0)
    assert [s for s in find_steps(t[rows], values[rows]) if s.channel is None] == []


@pytest.mark.parametrize(
    ("wide", "rows", "motion"), [(2.6, 6, True), (2.0, 6, False), (9.0, 3, False)]
)
def test_outliers_are_motion_where_a_quarter_of_the_rows_around_are_twice_as_wide(
    wide: float, rows: int, motion: bool
) -> None:
    """wide : of `rows` of the 16 rows around an outlier of one channel, in standard deviations."""
    residual = 1e-5 * np.random.default_rng(7).choice([-1.0, 1.0], (400, 2)) * [0.6745, 6.745]
    out = np.zeros(residual.shape, dtype=bool)
    out[[100, 300], 1] = True
    residual[out] = 1.0
    around = [108, 92, 104, 96, 103, 97][:rows]
    residual[around, 1] *= wide / 0.6745
    expected = np.zeros(residual.shape, dtype=bool)
    expected[100, 1] = motion
    assert (_in_motion(residual, out) == expected).all()
