"""All clock offsets of a gimbal at once, against the one that was planted."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbar.ident.start.lag_scan import (
    DIRECTION_SIGMA,
    MIN_OVERLAP,
    WITHIN,
    LagScan,
    Pair,
    PairScan,
    best_lags,
    scan_lags,
    subsample,
)
from ballbar.ident.start.speed_scan import likely_pairs, scan_speeds, speed_correlation

STEP = 0.02  # [s]


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
    """A gimbal follows a direction for 100 s, shifted by up to 40 s: the signals tell all."""
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


def gimbal(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Both angles (N,) [rad] of a gimbal at t (N,) [s], and the direction (N, 3) that it holds."""
    t1 = 1.3 * np.sin(0.31 * t) + 0.5 * np.sin(0.83 * t + 1)
    t2 = -0.9 + 0.5 * np.sin(0.23 * t + 2)
    return (
        t1,
        t2,
        np.stack((-np.sin(t2) * np.cos(t1), -np.sin(t2) * np.sin(t1), np.cos(t2)), axis=1),
    )


def test_a_gimbal_has_two_readings_that_hold_the_same_direction() -> None:
    """Turning by half a turn and tilting to the other side; both are kept as branches."""
    t1, t2, direction = gimbal(STEP * np.arange(3000))
    scan = PairScan(Pair(t1, t2, direction), STEP)
    branches = scan.branches(int(np.flatnonzero(scan.lags == 0)[0]))
    floor = DIRECTION_SIGMA**2
    variances = [b.variance for b in branches]
    assert variances == sorted(variances)
    assert variances[-1] + floor <= WITHIN * (variances[0] + floor)
    best = branches[0]
    assert best.sign == 1
    assert abs(np.sin(best.turning_offset)) < 1e-3
    assert abs(np.sin(best.tilting_offset)) < 1e-3


def test_the_score_adds_up_over_pairs_and_ignores_short_overlaps() -> None:
    t1, t2, direction = gimbal(STEP * np.arange(2000))
    pair = PairScan(Pair(t1, t2, direction), STEP)
    single, double = scan_lags([pair]), scan_lags([pair, pair])
    long = single.overlap * STEP >= MIN_OVERLAP
    assert np.isneginf(single.score[~long]).all()
    assert np.allclose(double.score[long], 2.0 * single.score[long])
    assert single.lags[np.argmax(single.score)] == 0
    assert single.overlap[single.lags == 0] == 2000
    assert single.overlap[single.lags == -1999] == 1


def scan_of(score: list[float]) -> LagScan:
    lags = np.arange(len(score)) - 2
    return LagScan(lags, np.array(score), np.full(lags.size, 100))


def test_the_best_lags_are_local_maxima_far_enough_apart() -> None:
    scan = scan_of([0.0, 5.0, 4.0, 4.5, 0.0, -np.inf, 3.0, 0.0, 9.0])
    assert best_lags(scan, count=5, separation=1) == [8, 1, 3, 6]
    assert best_lags(scan, count=5, separation=3) == [8, 1]
    assert best_lags(scan, count=1, separation=1) == [8]


def test_a_lag_between_two_steps_is_that_of_the_parabola() -> None:
    lags = np.arange(-5, 6)
    scan = LagScan(lags, -((lags - 1.3) ** 2), np.full(lags.size, 100))
    assert np.isclose(subsample(scan, 6), 1.3)  # the maximum on the grid stands at 1
    assert subsample(scan, 0) == -5.0  # an end has one neighbour only
    assert subsample(scan_of([-np.inf, 2.0, 1.0]), 1) == -1.0


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
    correlation = speed_correlation(a, b, every, 700, window=400).reshape(2, 2)
    np.testing.assert_allclose([correlation[0, 1], correlation[1, 0]], 1.0, atol=1e-12)
    assert likely_pairs(correlation, 0.9) == [(0, 1), (1, 0)]


def test_dwell_against_dwell_scores_nothing() -> None:
    still = np.zeros((1000, 1))
    scan = scan_speeds(still, still, [(0, 0)], least=100, paired=True)
    assert np.abs(scan.score[np.isfinite(scan.score)]).max() == 0.0


def test_each_column_is_paired_once_and_weak_ones_never() -> None:
    correlation = np.array([[0.99, -0.95], [0.97, 0.1], [0.5, 0.6]])
    assert likely_pairs(correlation, 0.8) == [(0, 0)]
    assert likely_pairs(correlation, 0.55) == [(0, 0), (2, 1)]
