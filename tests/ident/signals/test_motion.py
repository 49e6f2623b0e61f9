"""A robot's log as the motion of its joints, against the sines that it was made of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.ident.signals.motion import MotionByLog
from ballbar.ident.signals.smooth_log import interpolating_log

T = np.arange(0.0, 20.0, 0.01)  # [s] rows
AT = np.linspace(3.0, 17.0, 50)
RATE, SIZE = np.array([0.9, 1.7]), np.array([0.4, 0.2])  # [rad/s] and [rad] of two joints
NOISE = np.array([1e-5, 2e-5])  # [rad] of a row


def sines(t: Array, derivative: int = 0) -> Array:
    """(N, 2) [rad], or derivatives by time, at t (N,) [s]."""
    return SIZE * RATE**derivative * np.sin(RATE * t[:, None] + derivative * np.pi / 2.0)


@pytest.fixture
def motion() -> MotionByLog:
    log = replace(interpolating_log(T, sines(T), NOISE), stamp_noise=1e-3, knot_spacing=0.08)
    return MotionByLog("run", log, Clock(0.5, 1e-5))


def test_angles_speeds_and_accelerations_are_those_of_the_sines(motion: MotionByLog) -> None:
    np.testing.assert_allclose(motion.angles(AT), sines(AT), atol=1e-9)
    np.testing.assert_allclose(motion.speed(AT), sines(AT, 1), atol=1e-8)
    speed, acceleration = motion.arm(AT)  # low-pass filtered at 2 Hz, far above the sines
    np.testing.assert_allclose(speed, sines(AT, 1), atol=1e-4)
    np.testing.assert_allclose(acceleration, sines(AT, 2), atol=1e-3)


def test_times_are_kept_inside_the_log(motion: MotionByLog) -> None:
    within = motion.within(np.array([-1.0, 5.0, 30.0]))
    np.testing.assert_array_equal(within, [0.0, 5.0, T[-1]])


@pytest.mark.parametrize("spacing", [0.04, 0.08, 10.0])
def test_noise_falls_by_the_rows_that_a_sample_stands_for(
    motion: MotionByLog, spacing: float
) -> None:
    """Rows are 10 ms apart; no more than those of a knot interval of 80 ms are averaged."""
    angles, stamps = motion.noise(spacing)
    left = np.sqrt(0.01 / min(spacing, 0.08))
    np.testing.assert_allclose(angles, NOISE * left)
    assert stamps == pytest.approx(1e-3 * left)


def test_another_clock_leaves_the_rest_as_it_was(motion: MotionByLog) -> None:
    other = motion.by(Clock(-2.0, 0.0))
    assert (other.clock, motion.clock) == (Clock(-2.0, 0.0), Clock(0.5, 1e-5))
    assert (other.name, other.log) == (motion.name, motion.log)


def test_loads_are_interpolated_where_something_holds_the_tool(motion: MotionByLog) -> None:
    assert motion.carried(AT) is None
    slopes = np.arange(1.0, 9.0)  # [N m/s] of two gears and six components
    held = replace(motion, loads=make_interp_spline(T, T[:, None] * slopes, k=1))
    carried = held.carried(AT)
    assert carried is not None
    np.testing.assert_allclose(carried, slopes[:, None] * AT)
