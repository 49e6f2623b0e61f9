"""Least squares of the clock between two logs of one motion, from a start.

Each group of channels of log A follows one of log B through a constant map
(ballbar.ident.estimator.channel_map), at the instants

    t_a = offset + (1 + skew) t_b.

The maps are fitted at each step and projected out of the clock's columns (variable projection,
Golub & Pereyra 1973), which leaves two unknowns, the clock at the middle of the overlap and the
skew. The speed by which a residual changes with the clock is the mean of both logs' speeds, and the
curvature their product, in which the noise of either does not count. Weights follow from each
residual. The window grows from the middle of the overlap, so a skew that shifts the ends by more
than the motion allows does no harm. The covariance is inflated for autocorrelation by blocks of
time (sandwich, as for Newey & West 1987).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.ndimage import uniform_filter1d

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.ident.estimator import channel_map as maps
from ballbar.ident.estimator.channel_map import ChannelMap, Trace
from ballbar.ident.estimator.sample_times import MARGIN
from ballbar.ident.signals.smooth_log import SmoothLog

SHORTEST = 2.5  # [s] of overlap that is fitted
FIRST_WINDOW, GROWTH = 60.0, 4.0  # [s] of the first refinement, and the factor to the next one
ITERATIONS, CONVERGED = 30, 1e-9  # [s] change of the clock anywhere in the overlap
MAX_STEP = 0.2  # [s] of one iteration; a fast motion is straight for less
STRAY = 1.0  # [s] a clock that leaves its start by more has no minimum there
CLOCK_PRIOR = 1.0, 1e-3  # [s], [1] keeps the steps finite where a window says nothing
MOST_SAMPLES = 200_000
# Iterations after which measured and predicted speeds that correlate by less are of other instants.
TRIED, HOPELESS = 5, 0.3
AVERAGED = 0.3  # [s] of speeds that are compared: noise of the positions does not hide the motion
# [s] of the sandwich; the largest inflation counts, for a minute holds few blocks of the longest.
BLOCKS = 0.5, 1.0, 3.0
LEAST = 0.25  # of the variance of white residuals; those of rates from a quaternion are less


@dataclass(frozen=True, eq=False)
class Side:
    """One log's side of a group of channels, each about its centre and over its scale."""

    smooth: SmoothLog  # of this and perhaps other groups
    spline: BSpline  # of this group: its points, then perhaps a quaternion
    points: int  # 0, 1 or 3
    as_rate: bool  # the rate that the quaternion shows is compared
    centre: Array  # (points,) [unit]
    scale: float  # [unit]

    def trace(self, t: Array) -> Trace:
        """The channels at times t (N,) [s]."""
        at = np.clip(t, self.smooth.start, self.smooth.end)
        return maps.trace(self.spline, at, points=self.points, as_rate=self.as_rate)


@dataclass(frozen=True, eq=False)
class GroupFit:
    """A group of channels at one clock with its best map, which the clock's columns are free of."""

    t: Array  # (N,) [s] on the clock of B
    a: Trace
    b: Trace
    map: ChannelMap
    at: maps.Linearised
    root: Array  # (m,) of the weights
    measured: (
        Array  # (2, N, m) whitened change of A with the clock at the middle [1/s] and the skew
    )
    predicted: Array  # (2, N, m) the same by B's speeds
    along: Array  # (P, 2) change of the map with the clock

    @property
    def columns(self) -> Array:
        """(2, N, m) mean of both."""
        return 0.5 * (self.measured + self.predicted)

    @property
    def scores(self) -> Array:
        """(2, N) gradient of half the cost of each instant."""
        return np.asarray(np.einsum("pnm,nm->pn", self.columns, self.at.residual * self.root))

    @property
    def rms(self) -> Array:
        """(parts,) of the residual, no less than what exact channels leave."""
        return np.array([1.0 / self.root[part][0] for part in self.map.parts])

    @property
    def spread(self) -> Array:
        """(parts,) rms of A's values about their mean."""
        values = [self.a.point - self.a.point.mean(axis=0)] if self.map.zero.size else []
        if self.map.hand is not None and self.a.turn is not None:
            values.append((self.a.turn.mean().inv() * self.a.turn).as_rotvec())
        return np.array([float(np.sqrt((value**2).mean())) for value in values])

    @property
    def correlation(self) -> Array:
        """(parts,) of the measured and the predicted speed, or of their moving means."""
        samples = max(1, round(AVERAGED / float(np.median(np.diff(self.t)))))
        rates = np.stack((self.at.measured_rate, self.at.predicted_rate))
        speeds = rates, uniform_filter1d(rates, samples, axis=1)
        return np.array([max(_correlation(*x[:, :, p]) for x in speeds) for p in self.map.parts])

    def covariances(self, of_clock: Array) -> tuple[Array, Array]:
        """(P, P) of the map with what autocorrelation and the clock add, and of white residuals.

        of_clock : (2, 2) of the clock at the middle [s] and the skew.
        """
        columns = self.at.columns * self.root[:, None]
        white = np.asarray(np.linalg.inv(maps.normal_of(self.map, columns)), dtype=np.float64)
        scores = np.einsum("nmp,nm->pn", columns, self.at.residual * self.root)
        return _inflated(white, scores, self.t) + self.along @ of_clock @ self.along.T, white


@dataclass(frozen=True, eq=False)
class ClockFit:
    """The clock that a start leads to, and the maps of all groups."""

    clock: Clock
    covariance: Array  # (2, 2) of offset at the middle [s] and skew, inflated
    middle: float  # [s] on the clock of B, of the overlap
    inflation: float  # of the clock's sigma for autocorrelated residuals
    overlap: float  # [s]
    groups: tuple[GroupFit, ...]

    @property
    def rms(self) -> Array:
        """(all parts,) residuals."""
        return np.concatenate([group.rms for group in self.groups])

    @property
    def correlation(self) -> float:
        """The largest correlation of measured and predicted speeds of any part."""
        return float(max(group.correlation.max() for group in self.groups))

    @property
    def evidence(self) -> float:
        """Overlap [s] times the log-likelihood gain over channels at rest."""
        gains = [
            (part.stop - part.start) * np.log(max(1.0, spread / rms))
            for group in self.groups
            for part, spread, rms in zip(group.map.parts, group.spread, group.rms, strict=True)
        ]
        return float(self.overlap * sum(gains))


Pairs = Sequence[tuple[Side, Side]]
Maps = Sequence[ChannelMap | None]
_PRIOR = np.diag(1.0 / np.array(CLOCK_PRIOR) ** 2)


def fit_clock(pairs: Pairs, offset: float) -> ClockFit | None:
    """The clock from a start offset [s]; None where the logs share too little there.

    pairs : each group's side of log A and of log B.
    """
    clock, window, whole = Clock(offset, 0.0), FIRST_WINDOW, False
    starts: Maps = [None] * len(pairs)
    while True:
        t = [_instants(a.smooth, b.smooth, clock) for a, b in pairs]
        if any(each.size < 4 or each[-1] - each[0] < SHORTEST for each in t):
            return None
        first, last = min(each[0] for each in t), max(each[-1] for each in t)
        middle = 0.5 * float(first + last)
        part = t if whole else [each[np.abs(each - middle) <= 0.5 * window] for each in t]
        if all(each.size >= 4 for each in part):
            if (refined := _converged(pairs, clock, part, middle, starts)) is None:
                return None
            clock, starts = refined
        if whole:
            return _result(pairs, clock, t, middle, starts)
        whole = window >= last - first
        window *= GROWTH


def _instants(a: SmoothLog, b: SmoothLog, clock: Clock) -> Array:
    """(N,) [s] on the clock of B, even where both logs have rows."""
    first, last = (float(t) for t in clock.ballbar_time(np.array([a.start, a.end])))
    first, last = max(b.start, first) + MARGIN, min(b.end, last) - MARGIN
    if last <= first:
        return np.empty(0)
    step = max(0.5 * min(a.knot_spacing, b.knot_spacing), (last - first) / MOST_SAMPLES)
    t = first + step * np.arange(int((last - first) / step) + 1, dtype=np.float64)
    return np.asarray(t[a.covers(clock.robot_time(t)) & b.covers(t)])


def _group(
    pair: tuple[Side, Side], clock: Clock, t: Array, middle: float, m: ChannelMap | None
) -> GroupFit:
    """One group at one clock with its best map; m : a map to start from."""
    a, b = pair[0].trace(clock.robot_time(t)), pair[1].trace(t)
    m = maps.fitted(m, a, b)
    at = maps.linearised(m, a, b)
    root = np.sqrt(maps.weights(m, at.residual))
    columns = at.columns * root[:, None]
    flat = columns.reshape(-1, columns.shape[2])
    rates = np.stack((at.measured_rate, at.predicted_rate)) * root
    clocks = np.stack((rates, rates * (t - middle)[:, None]), axis=1).reshape(4, -1).T
    along = np.linalg.solve(maps.normal_of(m, columns), flat.T @ clocks)  # (P, 4)
    measured, predicted = (clocks - flat @ along).T.reshape(2, 2, *at.residual.shape)
    change = -0.5 * (along[:, :2] + along[:, 2:])
    return GroupFit(t, a, b, m, at, root, measured=measured, predicted=predicted, along=change)


def _converged(
    pairs: Pairs, clock: Clock, t: Sequence[Array], middle: float, starts: Maps
) -> tuple[Clock, Maps] | None:
    """The clock of least squares at instants t of each group (Gauss-Newton), and the maps.

    None where it strays from its start.
    """
    half, first = max(abs(float(x[k]) - middle) for x in t for k in (0, -1)), clock
    for tried in range(ITERATIONS):
        groups = [_group(*each) for each in _each(pairs, clock, t, middle, starts)]
        starts = [group.map for group in groups]
        columns = [group.columns.reshape(2, -1) for group in groups]
        normal = sum(each @ each.T for each in columns) + _PRIOR
        step = -np.linalg.solve(normal, sum(group.scores.sum(axis=1) for group in groups))
        most = abs(step[0]) + half * abs(step[1])
        step *= min(1.0, MAX_STEP / most) if most > 0.0 else 1.0
        skew = clock.skew + float(step[1])
        clock = Clock(clock.robot_time(middle) + float(step[0]) - (1.0 + skew) * middle, skew)
        if most < CONVERGED:
            break
        related = max(_correlation(group.measured[0], group.predicted[0]) for group in groups)
        strays = abs(clock.robot_time(middle) - first.robot_time(middle)) > STRAY
        if strays or (tried == TRIED and related < HOPELESS):
            return None
    return clock, starts


def _result(
    pairs: Pairs, clock: Clock, t: Sequence[Array], middle: float, starts: Maps
) -> ClockFit:
    """The fit at a clock, with the autocorrelation-robust covariance."""
    groups = [_group(*each) for each in _each(pairs, clock, t, middle, starts)]
    products = [np.einsum("pnm,qnm->pq", g.measured, g.predicted, optimize=True) for g in groups]
    values, vectors = np.linalg.eigh(sum(products) + sum(products).T)
    curvature = (0.5 * vectors * np.maximum(values, 0.0)) @ vectors.T + _PRIOR
    white = np.asarray(np.linalg.inv(curvature), dtype=np.float64)
    scores = np.concatenate([group.scores for group in groups], axis=1)
    covariance = _inflated(white, scores, np.concatenate(t))
    inflation = float(np.sqrt(covariance[0, 0] / white[0, 0]))
    overlap = max(float(each[-1] - each[0]) for each in t)
    return ClockFit(clock, covariance, middle, inflation, overlap, tuple(groups))


def _each(
    pairs: Pairs, clock: Clock, t: Sequence[Array], middle: float, starts: Maps
) -> list[tuple[tuple[Side, Side], Clock, Array, float, ChannelMap | None]]:
    """The arguments of `_group` for each group."""
    return [(p, clock, own, middle, m) for p, own, m in zip(pairs, t, starts, strict=True)]


def _correlation(a: Array, b: Array) -> float:
    power = max(float((a * a).sum() * (b * b).sum()), np.finfo(float).tiny)
    return float((a * b).sum() / np.sqrt(power))


def _inflated(covariance: Array, scores: Array, t: Array) -> Array:
    """A covariance (P, P) with the variances that blocks of time show.

    scores : (P, N) at instants t (N,) [s].
    """
    factor = np.full(len(covariance), LEAST)
    for block in BLOCKS:
        number = np.floor((t - t.min()) / block).astype(np.intp)
        sums = np.stack([np.bincount(number, row) for row in scores])
        factor = np.maximum(factor, ((covariance @ sums) ** 2).sum(axis=1) / np.diag(covariance))
    return np.asarray(covariance * np.sqrt(np.outer(factor, factor)))
