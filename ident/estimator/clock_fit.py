"""Least squares of the clock between two smoothed logs of one motion, from a start.

Channel k of log A follows channel k of log B through an affine map of its own,

    a_k(t_a) = gain_k b_k(t_b) + zero_k,      t_a = offset + (1 + skew) t_b.

Gains and zeros are linear: they are projected out at each step (variable projection, Golub &
Pereyra 1973), which leaves two unknowns, the clock at the middle of the overlap and the skew.
Weights follow from each channel's residual. The window grows from the middle of the overlap, so a
skew that shifts the ends by more than the motion allows does no harm. The covariance is inflated
for autocorrelation as that of a fit is (ident.estimator.uncertainty).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.clock import Clock
from ident.estimator.sample_times import MARGIN
from ident.estimator.time_blocks import block_numbers
from ident.estimator.uncertainty import inflation_factors
from ident.signals.smooth_log import SmoothLog

SHORTEST = 2.5  # [s] of overlap that is fitted
FIRST_WINDOW, GROWTH = 60.0, 4.0  # [s] of the first refinement, and the factor to the next one
ITERATIONS, CONVERGED = 30, 1e-9  # [s] change of the clock anywhere in the overlap
MAX_STEP = 0.2  # [s] of one iteration; a fast motion is straight for less
CLOCK_PRIOR = 1.0, 1e-3  # [s], [1] keeps the steps finite where a window says nothing
FINEST = 1e-9  # of a channel's unit: residual of exact channels
MOST_SAMPLES = 200_000
# [s] of the sandwich; the largest inflation counts, for a minute holds few blocks of the longest.
BLOCKS = 0.5, 1.0, 3.0


@dataclass(frozen=True, eq=False)
class ClockFit:
    """The clock that a start leads to, and the channels at the aligned instants."""

    clock: Clock
    covariance: Array  # (2, 2) of offset [s] and skew, inflated
    inflation: float  # of the offset's sigma for autocorrelated residuals
    overlap: float  # [s]
    a: Array  # (N, K) channels of A
    b: Array  # (N, K) channels of B
    gain: Array  # (K,)
    zero: Array  # (K,)
    residual: Array  # (N, K)

    @property
    def rms(self) -> Array:
        """(K,) residual, no less than what exact channels leave."""
        return np.asarray(np.maximum(FINEST, np.sqrt((self.residual**2).mean(axis=0))))

    @property
    def speed_correlation(self) -> Array:
        """(K,) size of the correlation of the channels' changes from one instant to the next."""
        a, b = np.diff(self.a, axis=0), np.diff(self.b, axis=0)
        power = np.maximum((a * a).sum(axis=0) * (b * b).sum(axis=0), np.finfo(float).tiny)
        return np.asarray(np.abs((a * b).sum(axis=0)) / np.sqrt(power))

    @property
    def evidence(self) -> float:
        """Overlap [s] times the log-likelihood gain over channels at rest."""
        return float(self.overlap * np.log(np.maximum(1.0, self.a.std(axis=0) / self.rms)).sum())


def fit_clock(a: SmoothLog, b: SmoothLog, offset: float) -> ClockFit | None:
    """The clock from a start offset [s]; None where the logs share too little there.

    a, b : K channels each, all of a size near 1.
    """
    clock, window, whole = Clock(offset, 0.0), FIRST_WINDOW, False
    while not whole:
        t = _instants(a, b, clock)
        if t.size < 4 or t[-1] - t[0] < SHORTEST:
            return None
        middle = 0.5 * (t[0] + t[-1])
        whole = window >= t[-1] - t[0]
        part = t if whole else t[np.abs(t - middle) <= 0.5 * window]
        if part.size:
            clock = _converged(a, b, clock, part)
        window *= GROWTH
    t = _instants(a, b, clock)
    if t.size < 4 or t[-1] - t[0] < SHORTEST:
        return None
    return _at(a, b, _converged(a, b, clock, t), t)


def _instants(a: SmoothLog, b: SmoothLog, clock: Clock) -> Array:
    """(N,) [s] on the clock of B, even where both logs have rows."""
    first, last = (float(t) for t in clock.ballbar_time(np.array([a.start, a.end])))
    first, last = max(b.start, first) + MARGIN, min(b.end, last) - MARGIN
    if last <= first:
        return np.empty(0)
    step = max(0.5 * min(a.knot_spacing, b.knot_spacing), (last - first) / MOST_SAMPLES)
    t = first + step * np.arange(int((last - first) / step) + 1, dtype=np.float64)
    return np.asarray(t[a.covers(clock.robot_time(t)) & b.covers(t)])


@dataclass(frozen=True, eq=False)
class _Linearised:
    """Channels and their change with the clock at one clock, gains and zeros projected out."""

    a: Array  # (N, K)
    b: Array  # (N, K)
    gain: Array  # (K,)
    zero: Array  # (K,)
    residual: Array  # (N, K)
    columns: Array  # (2, N, K) change of the channels of A per second, and per unit of skew
    weight: Array  # (K,) one over the variance of each residual

    @property
    def normal(self) -> Array:
        """(2, 2) normal matrix of clock [s] at the middle and skew."""
        return np.asarray(np.einsum("pnk,qnk,k->pq", self.columns, self.columns, self.weight))

    @property
    def scores(self) -> Array:
        """(2, N) gradient of half the cost of each instant."""
        return np.asarray(np.einsum("pnk,nk,k->pn", self.columns, self.residual, self.weight))


def _linearised(a: SmoothLog, b: SmoothLog, clock: Clock, t: Array) -> _Linearised:
    at = np.clip(clock.robot_time(t), a.start, a.end)
    left, right = np.asarray(a.spline(at)), np.asarray(b.spline(t))
    speed = np.asarray(a.speed(at))
    columns = np.stack((speed, speed * (t - _middle(t))[:, None]))
    mean_a, mean_b = left.mean(axis=0), right.mean(axis=0)
    moved = right - mean_b
    power = np.maximum((moved * moved).sum(axis=0), np.finfo(float).tiny)
    gain = (moved * (left - mean_a)).sum(axis=0) / power
    zero = mean_a - gain * mean_b
    residual = left - gain * right - zero
    columns -= columns.mean(axis=1, keepdims=True)
    columns -= moved * (np.einsum("nk,pnk->pk", moved, columns) / power)[:, None]
    weight = 1.0 / np.maximum(FINEST**2, (residual * residual).mean(axis=0))
    return _Linearised(
        a=left, b=right, gain=gain, zero=zero, residual=residual, columns=columns, weight=weight
    )


def _middle(t: Array) -> float:
    return 0.5 * float(t[0] + t[-1])


def _converged(a: SmoothLog, b: SmoothLog, clock: Clock, t: Array) -> Clock:
    """The clock that least squares gives at instants t (N,) [s] (Gauss-Newton)."""
    half, middle = 0.5 * float(t[-1] - t[0]), _middle(t)
    prior = np.diag(1.0 / np.array(CLOCK_PRIOR) ** 2)
    for _ in range(ITERATIONS):
        at = _linearised(a, b, clock, t)
        step = -np.linalg.solve(at.normal + prior, at.scores.sum(axis=1))
        most = abs(step[0]) + half * abs(step[1])
        step *= min(1.0, MAX_STEP / most) if most > 0.0 else 1.0
        skew = clock.skew + float(step[1])
        clock = Clock(clock.robot_time(middle) + float(step[0]) - (1.0 + skew) * middle, skew)
        if most < CONVERGED:
            break
    return clock


def _at(a: SmoothLog, b: SmoothLog, clock: Clock, t: Array) -> ClockFit:
    """The fit at a clock, with the autocorrelation-robust covariance of offset and skew."""
    at = _linearised(a, b, clock, t)
    prior = np.diag(1.0 / np.array(CLOCK_PRIOR) ** 2)
    covariance = np.asarray(np.linalg.inv(at.normal + prior), dtype=np.float64)
    each = [_inflation(covariance, at.scores, t, block) for block in BLOCKS]
    inflation = np.asarray(np.max(each, axis=0))
    covariance = covariance * np.outer(inflation, inflation)
    # From the clock at the middle to that at the first row of B.
    to_first = np.array([[1.0, -_middle(t)], [0.0, 1.0]])
    return ClockFit(
        clock=clock,
        covariance=to_first @ covariance @ to_first.T,
        inflation=float(inflation[0]),
        overlap=float(t[-1] - t[0]),
        a=at.a,
        b=at.b,
        gain=at.gain,
        zero=at.zero,
        residual=at.residual,
    )


def _inflation(covariance: Array, scores: Array, t: Array, block: float) -> Array:
    """(2,) factor on the sigmas of offset and skew from blocks of time [s].

    covariance : (2, 2). scores : (2, N) at instants t (N,) [s].
    """
    number = block_numbers(t, block)
    sums = np.zeros((2, number[-1] + 1))
    np.add.at(sums.T, number, scores.T)
    return inflation_factors(covariance, scores @ scores.T, sums)
