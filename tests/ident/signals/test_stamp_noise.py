"""Scattering stamps are told from noisy channels, and keep sound rows from being outliers."""

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.ident.signals.smooth_log import SmoothLog, smooth_log
from ballbar.ident.signals.stamp_noise import stamp_noise

T = 0.004 * np.arange(8000)
NOISE = 2e-6


def motion(t: Array) -> Array:
    """(N, 4) [rad]"""
    return np.stack([0.3 * np.sin((0.5 + 0.3 * k) * t + k) for k in range(4)], axis=1)


def logged(scatter: float) -> SmoothLog:
    """The log of rows whose stamps scatter by so many seconds."""
    rng = np.random.default_rng(4)
    values = motion(T) + NOISE * rng.standard_normal((T.size, 4))
    stamps = np.sort(T + scatter * rng.standard_normal(T.size))
    return smooth_log(stamps, values, widest_knot_spacing=0.08, checked=True)


def test_sound_stamps_have_no_noise_and_the_channels_keep_theirs() -> None:
    log = logged(0.0)
    assert log.stamp_noise == 0.0
    assert log.noise == pytest.approx(NOISE, rel=0.05)


@pytest.mark.parametrize("scatter", [2e-4, 1e-3])
def test_the_scatter_of_the_stamps_is_estimated_beside_the_noise(scatter: float) -> None:
    log = logged(scatter)
    assert log.stamp_noise == pytest.approx(scatter, rel=0.1)
    assert (log.noise < 20.0 * NOISE).all()  # 0.05 to 0.4 mrad if it were the channels'
    assert log.sample_stamp_sigma(0.02) == pytest.approx(
        log.stamp_noise * np.sqrt(log.row_period / 0.02), rel=1e-6
    )


def test_rows_of_scattering_stamps_are_no_outliers() -> None:
    assert logged(2e-4).outliers.rows == 0


def test_independent_noise_of_the_channels_is_none_of_the_stamps() -> None:
    rng = np.random.default_rng(5)
    residual = np.array([1e-6, 5e-5, 1e-4, 2e-6]) * rng.standard_normal((T.size, 4))
    scatter, own = stamp_noise(residual, np.gradient(motion(T), T, axis=0))
    assert scatter == 0.0
    assert own == pytest.approx(np.sqrt((residual**2).mean(axis=0)))
