"""Speeds of two logs against each other at all lags."""

from __future__ import annotations

import numpy as np

from ident.start.speed_scan import likely_pairs, scan_speeds, speed_correlation


def speeds(count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 2) smooth random speeds of rms 1."""
    raw = rng.standard_normal((count + 100, 2))
    smooth = np.stack([np.convolve(c, np.hanning(101), mode="valid") for c in raw.T], axis=1)
    return smooth / smooth.std(axis=0)


def test_the_score_is_highest_at_the_lag_whatever_gain_and_order_of_the_channels() -> None:
    rng = np.random.default_rng(1)
    full = speeds(3000, rng)
    a, b = full[:2000], -full[700:2400, ::-1]
    named = scan_speeds(a, b, [(0, 1), (1, 0)], least=250, paired=True)
    every = [(0, 0), (0, 1), (1, 0), (1, 1)]
    for scan in (named, scan_speeds(a, b, every, least=250, paired=False)):
        assert scan.lags[np.argmax(scan.score)] == 700
        assert scan.overlap[np.argmax(scan.score)] == 1300
    correlation = speed_correlation(a, b, 700, window=400)
    np.testing.assert_allclose([correlation[0, 1], correlation[1, 0]], -1.0, atol=1e-12)
    assert likely_pairs(correlation, 0.9) == [(0, 1), (1, 0)]


def test_dwell_against_dwell_scores_nothing() -> None:
    still = np.zeros((1000, 1))
    scan = scan_speeds(still, still, [(0, 0)], least=100, paired=True)
    assert np.abs(scan.score[np.isfinite(scan.score)]).max() == 0.0


def test_each_column_is_paired_once_and_weak_ones_never() -> None:
    correlation = np.array([[0.99, -0.95], [0.97, 0.1], [0.5, 0.6]])
    assert likely_pairs(correlation, 0.8) == [(0, 0)]
    assert likely_pairs(correlation, 0.55) == [(0, 0), (2, 1)]
