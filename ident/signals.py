"""A log as a smooth function of time: values, speeds, and the noise left over.

Least-squares splines of degree five on uniform knots. They are symmetric in time, so they delay neither log against the
other, and they are linear, so white noise comes out known: a log with `n` rows and `k` coefficients keeps k/n of its noise
variance at the samples, and the residual gives the noise level itself without a dwell.

The knot spacing is the widest one whose residual is white: a coarser one would bend the motion, a finer one keep noise.

Before that the log is made continuous (ident.breaks) and rows that its neighbours contradict are left out (ident.outliers);
then those that stand out of the spline's residual, until no more do. All of it is kept with the result, to be reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from cell.chain import Array
from ident.breaks import Break, find_breaks, without_breaks
from ident.outliers import FAR_OUT, LOCAL_ROWS, SMALLEST, outliers, robust_sigma

DEGREE = 5
_WHITE = 0.1  # lag-one autocorrelation of the residual above which motion is left in it (smoothing alone makes it negative)
GAP_PERIODS = 3.0  # a longer stretch without rows is not interpolated (log_formats H.5: missing samples)
_ROWS_PER_KNOT = 3  # least-squares needs more rows than coefficients
_QUARTILE = 1.1503  # upper quartile of |x| over its standard deviation, for normal x
_TRIMMINGS = 20  # far more than it takes; each removes rows, so it ends anyway


@dataclass(frozen=True, eq=False)
class Outliers:
    """Values of a log that no motion explains; their rows were left out."""

    times: Array  # (K,) [s] on the log's clock
    channels: NDArray[np.intp]  # (K,) from 0
    rows: int  # left out; fewer than K where a row has several
    of: int  # rows of the log


@dataclass(frozen=True, eq=False)
class SmoothLog:
    """One log as a spline over its own clock."""

    spline: BSpline  # (channels,) [rad] over [s]
    speed: BSpline  # (channels,) [rad/s]
    start: float  # [s]
    end: float  # [s]
    noise: Array  # (channels,) [rad] standard deviation of one row
    row_period: float  # [s] median
    knot_spacing: float  # [s]
    gaps: Array  # (G, 2) [s] stretches without rows, where the spline says nothing
    outliers: Outliers
    breaks: tuple[Break, ...]  # jumps that were taken out

    def covers(self, t: Array) -> NDArray[np.bool_]:
        """(N,) whether rows stand on both sides close by: inside the log and in no gap."""
        inside = (t >= self.start) & (t <= self.end)
        for begin, end in self.gaps:
            inside &= (t <= begin) | (t >= end)
        return inside

    def sample_sigma(self, spacing: float) -> Array:
        """(channels,) [rad] standard deviation of the spline at samples `spacing` [s] apart.

        Samples closer than a knot interval share noise; their deviation is counted so that they may pass for independent.
        """
        return np.asarray(self.noise * np.sqrt(min(1.0, self.row_period / min(spacing, self.knot_spacing))))


def smooth_log(t: Array, values: Array, *, widest_knot_spacing: float) -> SmoothLog:
    """Spline of one log without its jumps and outliers; t (N,) [s], values (N, channels) [rad].

    Where the clock jumped, the spline's time is that of the clock before its first step.
    Raises ValueError when the log has fewer rows than a spline needs.
    """
    if t.size < 4 * DEGREE:
        raise ValueError(f"a log of {t.size} rows is too short to be smoothed; at least {4 * DEGREE} are needed")
    stamps = t
    breaks = find_breaks(t, values)
    t, values = without_breaks(t, values, breaks)
    period = float(np.median(np.diff(t)))
    spacing = max(widest_knot_spacing, _ROWS_PER_KNOT * period)
    contradicted = outliers(t, values)
    while True:
        out = contradicted.copy()
        spline, residual, coefficients = _fit_trimmed(t, values, spacing, out)
        if (_lag_one(residual) < _WHITE).all() or spacing * 0.5 < _ROWS_PER_KNOT * period:
            break
        spacing *= 0.5
    rows = ~out.any(axis=1)
    t = t if rows.all() else t[rows]
    dof = max(1, t.size - coefficients)
    noise = np.sqrt((residual * residual).sum(axis=0) / dof)
    wide = np.flatnonzero(np.diff(t) > GAP_PERIODS * period)
    gaps = np.column_stack((t[wide], t[wide + 1]))
    found, channels = np.nonzero(out)
    left_out = Outliers(stamps[found], channels, int((~rows).sum()), rows.size)
    return SmoothLog(spline, spline.derivative(), float(t[0]), float(t[-1]), noise, period, spacing, gaps, left_out, breaks)


def _fit_trimmed(t: Array, values: Array, spacing: float, out: NDArray[np.bool_]) -> tuple[BSpline, Array, int]:
    """The spline without the rows that hold an outlier of `out` (N, channels), to which those of its residual are added in place."""
    for _ in range(_TRIMMINGS):
        rows = np.flatnonzero(~out.any(axis=1))
        whole = rows.size == t.size
        spline, residual, coefficients = _fit(t if whole else t[rows], values if whole else values[rows], spacing)
        found = _standing_out(residual)
        if not found.any():
            break
        out[rows] |= found
    return spline, residual, coefficients


def _standing_out(residual: Array) -> NDArray[np.bool_]:
    """(N, channels) what is far out of the residual, and of the residual around it where that is wide: motion may be left there."""
    size = np.abs(residual)
    found = size > np.maximum(FAR_OUT * robust_sigma(residual), SMALLEST)
    rows, channels = np.nonzero(found)
    offsets = np.arange(-LOCAL_ROWS, LOCAL_ROWS + 1)
    around = rows[:, None] + offsets[np.abs(offsets) > 0]
    local = np.quantile(size[np.clip(around, 0, size.shape[0] - 1), channels[:, None]], 0.75, axis=1) / _QUARTILE
    found[rows, channels] = size[rows, channels] > FAR_OUT * local
    return found


def _fit(t: Array, values: Array, spacing: float) -> tuple[BSpline, Array, int]:
    inner = np.linspace(t[0], t[-1], max(2, int(np.ceil((t[-1] - t[0]) / spacing)) + 1))[1:-1]
    # a gap without rows carries no knot: every knot interval kept holds rows (Schoenberg-Whitney)
    filled = np.diff(np.searchsorted(t, np.concatenate(([t[0]], inner)))) >= 1
    inner = inner[filled]
    knots = np.concatenate((np.repeat(t[0], DEGREE + 1), inner, np.repeat(t[-1], DEGREE + 1)))
    spline = make_lsq_spline(t, values, knots, k=DEGREE)
    return spline, values - spline(t), knots.size - DEGREE - 1


def _lag_one(residual: Array) -> Array:
    power = (residual * residual).sum(axis=0)
    return np.asarray((residual[1:] * residual[:-1]).sum(axis=0) / np.where(power > 0.0, power, 1.0))
