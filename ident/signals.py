"""A log as a smooth function of time: values, speeds, and the noise left over.

Least-squares splines of degree five on uniform knots. They are symmetric in time, so they delay neither log against the
other, and they are linear, so white noise comes out known: a log with `n` rows and `k` coefficients keeps k/n of its noise
variance at the samples, and the residual gives the noise level itself without a dwell.

The knot spacing is the widest one whose residual is white: a coarser one would bend the motion, a finer one keep noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from cell.chain import Array

DEGREE = 5
_WHITE = 0.1  # lag-one autocorrelation of the residual above which motion is left in it (smoothing alone makes it negative)
GAP_PERIODS = 3.0  # a longer stretch without rows is not interpolated (log_formats H.5: missing samples)
_ROWS_PER_KNOT = 3  # least-squares needs more rows than coefficients


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
    """Spline of one log; t (N,) [s], values (N, channels) [rad].

    Raises ValueError when the log has fewer rows than a spline needs.
    """
    if t.size < 4 * DEGREE:
        raise ValueError(f"a log of {t.size} rows is too short to be smoothed; at least {4 * DEGREE} are needed")
    period = float(np.median(np.diff(t)))
    spacing = max(widest_knot_spacing, _ROWS_PER_KNOT * period)
    while True:
        spline, residual, coefficients = _fit(t, values, spacing)
        if (_lag_one(residual) < _WHITE).all() or spacing * 0.5 < _ROWS_PER_KNOT * period:
            break
        spacing *= 0.5
    dof = max(1, t.size - coefficients)
    noise = np.sqrt((residual * residual).sum(axis=0) / dof)
    wide = np.flatnonzero(np.diff(t) > GAP_PERIODS * period)
    gaps = np.column_stack((t[wide], t[wide + 1]))
    return SmoothLog(spline, spline.derivative(), float(t[0]), float(t[-1]), noise, period, spacing, gaps)


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
