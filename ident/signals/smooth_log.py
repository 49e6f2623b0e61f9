"""A log as a smooth function of time: values, speeds, and the noise left over.

Least-squares splines of degree five on uniform knots. They are symmetric in time, so they delay
neither log against the other, and they are linear, so white noise comes out known: a log with `n`
rows and `k` coefficients keeps k/n of its noise variance at the samples, and the residual gives the
noise level itself without a dwell.

The knot spacing is the widest one whose residual is white: a coarser one would bend the motion, a
finer one keep noise.

Before that the log is made continuous (ballbar.ident.signals.steps). Damaged values are left out by
the reader (ballbar.acquisition.faults.damaged_values); of a log that comes without its flags they
are left out here. Then values that stand out of the spline's residual are left out, until no more
do. What was left out is kept with the result, to be reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from ballbar.cell.arrays import Array
from ballbar.cell.logs import BallBarLog, LengthLog, RobotLog, TrackerLog, segment_starts
from ballbar.cell.neighbours import SMALLEST, damaged_bursts, robust_sigma
from ballbar.cell.splines import DEGREE, smoothing_spline
from ballbar.ident.signals.stamp_noise import stamp_noise
from ballbar.ident.signals.steps import LogStep, find_steps, without_steps

# Lag-one autocorrelation of the residual above which motion is left in it; smoothing makes it
# negative.
_WHITE = 0.1
# A longer stretch without rows is not interpolated (notes/log_formats sec. H.5: missing
# samples).
GAP_PERIODS = 3.0
WIDEST_KNOT_SPACING = 0.08  # [s] motion below 3 Hz; finer where the residual asks for it
ARM_KNOT_SPACING = 0.25  # [s] keeps motion below 2 Hz
_GRID = 10  # instants a knot of the arm's motion
_ROWS_PER_KNOT = 3  # least-squares needs more rows than coefficients
_UPPER_QUARTILE = 1.1503  # of |x| over its standard deviation, for normal x
_WIDE = 2.0  # times the noise
_AROUND = 8  # rows on either side, which show whether the motion is too quick for the knots
STANDING_OUT = 5.0  # sigma of the spline's residual: 0.6 of a million values of white noise
# [rad] a joint that crosses its backlash moves by that within a row or two; where nothing else is
# damaged it is no outlier.
STRIKE = 1e-4


@dataclass(frozen=True, eq=False)
class LogOutliers:
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
    stamps: Array  # (N,) [s] of all rows
    outliers: LogOutliers
    steps: tuple[LogStep, ...]  # steps that were taken out
    stamp_noise: float = 0.0  # [s] standard deviation of the stamps, beyond `noise`

    @cached_property
    def arm(self) -> BSpline:
        """(channels,) [rad] the motion of the arm as a rigid body: the log, low-pass filtered.

        Gears and resolvers add ripple to the log that the inertia does not feel: 10 urad at 15 Hz
        are 0.1 rad/s^2, on a large arm 100 N m.
        """
        t = np.linspace(
            self.start,
            self.end,
            max(4 * DEGREE, round((self.end - self.start) / (ARM_KNOT_SPACING / _GRID))),
        )
        return _fit(t, np.asarray(self.spline(t)), ARM_KNOT_SPACING)[0]

    def covers(self, t: Array) -> NDArray[np.bool_]:
        """(N,) whether rows stand on both sides close by: inside the log and in no gap."""
        inside = (t >= self.start) & (t <= self.end)
        for begin, end in self.gaps:
            inside &= (t <= begin) | (t >= end)
        return inside

    def sample_sigma(self, spacing: float) -> Array:
        """(channels,) [rad] standard deviation of the spline at samples `spacing` [s] apart.

        Samples closer than a knot interval share noise; theirs is stated as if they were
        independent.
        """
        return np.asarray(self.noise * self._left(spacing))

    def sample_stamp_sigma(self, spacing: float) -> float:
        """[s] standard deviation of the time at such samples."""
        return self.stamp_noise * self._left(spacing)

    def _left(self, spacing: float) -> float:
        """Share of a row's noise that smoothing leaves."""
        return float(np.sqrt(min(1.0, self.row_period / min(spacing, self.knot_spacing))))


def smoothing(robot: SmoothLog, bar: SmoothLog | None) -> float:
    """[s] over which both logs are smoothed: instants closer than that share noise."""
    return max(robot.knot_spacing, bar.knot_spacing if bar else 0.0)


def interpolating_log(t: Array, angles: Array, noise: Array) -> SmoothLog:
    """A log whose spline passes through exact angles.

    t : (N,) [s], even. angles : (N, C) [rad].
    noise : (C,) [rad] standard deviation of one row; zeros for exact angles.
    """
    spline = make_interp_spline(t, angles, k=DEGREE)
    period = float(t[1] - t[0])
    none = LogOutliers(np.empty(0), np.empty(0, dtype=np.intp), 0, t.size)
    return SmoothLog(
        spline=spline,
        speed=spline.derivative(),
        start=float(t[0]),
        end=float(t[-1]),
        noise=noise,
        row_period=period,
        knot_spacing=period,
        gaps=np.empty((0, 2)),
        stamps=t,
        outliers=none,
        steps=(),
    )


def motion_of(log: RobotLog | BallBarLog | LengthLog | TrackerLog, values: Array) -> SmoothLog:
    """Values (N, C) of a log as a function of time."""
    return smooth_log(
        log.t,
        values,
        widest_knot_spacing=WIDEST_KNOT_SPACING,
        starts=segment_starts(log.segment),
        checked=isinstance(log, TrackerLog) or log.flags is not None,
    )


def smooth_log(
    t: Array,
    values: Array,
    *,
    widest_knot_spacing: float,
    starts: Sequence[int] = (),
    checked: bool = False,
) -> SmoothLog:
    """Spline of one log without its steps and outliers.

    t : (N,) [s]. values : (N, channels) [rad].
    starts : rows at which a segment begins (ballbar.cell.logs.segment_starts).
    checked : whether damaged values have been left out already, as from a log that has flags: only
        a
        reader sets them.

    Where the clock was set, the spline's time is that of the clock before its first step.
    Raises ValueError when the log has fewer rows than a spline needs.
    """
    if t.size < 4 * DEGREE:
        raise ValueError(
            f"a log of {t.size} rows is too short to be smoothed; at least {4 * DEGREE} are needed"
        )
    logged = t
    steps = find_steps(t, values, starts, checked=checked)
    t, values = without_steps(t, values, steps)
    period = float(np.median(np.diff(t)))
    spacing = max(widest_knot_spacing, _ROWS_PER_KNOT * period)
    damaged = np.zeros(values.shape, dtype=bool) if checked else damaged_bursts(t, values)
    smallest = SMALLEST if damaged.any() else STRIKE
    while True:
        finest = spacing * 0.5 < _ROWS_PER_KNOT * period
        fit = _fit_rows(t, values, spacing, damaged)
        if finest or _is_white(np.where(_standing_out(fit, smallest), 0.0, fit.residual)):
            fit = _trimmed(t, values, spacing, fit, smallest)
            if finest or _is_white(fit.residual):
                break
        spacing *= 0.5
    remaining = fit.t
    freedom = max(1, remaining.size - fit.coefficients)
    missing = _stretches(t, GAP_PERIODS * period)
    # Where outliers lie, up to a knot interval is bridged.
    bridged = _stretches(remaining, max(GAP_PERIODS * period, spacing))
    outlier_rows, channels = np.nonzero(fit.out)
    lost, (scatter, noise) = np.sqrt(remaining.size / freedom), fit.noise
    return SmoothLog(
        spline=fit.spline,
        speed=fit.spline.derivative(),
        start=float(remaining[0]),
        end=float(remaining[-1]),
        noise=lost * noise,
        row_period=period,
        knot_spacing=spacing,
        gaps=np.unique(np.concatenate((missing, bridged)), axis=0),
        stamps=t,
        outliers=LogOutliers(logged[outlier_rows], channels, t.size - remaining.size, t.size),
        steps=steps,
        stamp_noise=float(lost) * scatter,
    )


def _stretches(t: Array, longest: float) -> Array:
    """(G, 2) [s] where rows t (N,) are further apart."""
    wide = np.flatnonzero(np.diff(t) > longest)
    return np.column_stack((t[wide], t[wide + 1]))


@dataclass(frozen=True, eq=False)
class _Fit:
    """A spline of the rows without outliers."""

    t: Array  # (remaining rows,) [s]
    spline: BSpline
    residual: Array  # (remaining rows, channels) [rad]
    coefficients: int
    out: NDArray[np.bool_]  # (N, channels) the outliers

    @cached_property
    def speed(self) -> Array:
        """(remaining rows, channels) [rad/s]"""
        return np.asarray(self.spline.derivative()(self.t))

    @cached_property
    def noise(self) -> tuple[float, Array]:
        """[s] standard deviation of the stamps, and (channels,) [rad] noise of each channel."""
        return stamp_noise(self.residual, self.speed)


def _fit_rows(t: Array, values: Array, spacing: float, out: NDArray[np.bool_]) -> _Fit:
    rows = ~out.any(axis=1)
    if not rows.all():
        t, values = t[rows], values[rows]
    return _Fit(t, *_fit(t, values, spacing), out)


def _trimmed(t: Array, values: Array, spacing: float, fit: _Fit, smallest: float) -> _Fit:
    """The fit without the values that stand out of its residual, repeated until none does.

    Values around which the residual stays wide come back for good: motion too quick for the knots
    is no outlier.
    """
    motion, given = np.zeros(values.shape, dtype=bool), fit.out
    while True:
        rows = ~fit.out.any(axis=1)
        outlier = np.zeros(values.shape, dtype=bool)
        outlier[rows] = _standing_out(fit, smallest)
        outlier &= ~motion
        if not outlier.any():
            return fit
        trial = _fit_rows(t, values, spacing, fit.out | outlier)
        back = trial.out & ~given & _in_motion(values - trial.spline(t), trial.out)
        motion |= back
        out = trial.out & ~back
        if not np.array_equal(out, fit.out):
            fit = _fit_rows(t, values, spacing, out) if back.any() else trial


def _standing_out(fit: _Fit, smallest: float) -> NDArray[np.bool_]:
    """(remaining rows, channels) residuals far out, and no smaller than `smallest` [rad].

    Where the stamps scatter, quick rows may be further out.
    """
    scatter, own = fit.noise
    out = np.empty(fit.residual.shape, dtype=bool)
    for c, left in enumerate(fit.residual.T):
        usual = np.hypot(own[c], scatter * fit.speed[:, c]) if scatter else np.ones(1)
        sigma = usual * robust_sigma((left / usual)[:, None])
        out[:, c] = np.abs(left) > np.maximum(STANDING_OUT * sigma, smallest)
    return out


def _in_motion(residual: Array, out: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N, channels) the outliers around which the residual [rad] of the other rows is wide."""
    sigma = robust_sigma(np.where(out, 0.0, residual))
    offsets = np.concatenate((np.arange(-_AROUND, 0), np.arange(1, _AROUND + 1)))
    rows, channels = np.nonzero(out)
    around = np.clip(rows[:, None] + offsets, 0, residual.shape[0] - 1), channels[:, None]
    size = np.where(out[around], 0.0, np.abs(residual[around]))
    wide = np.zeros(out.shape, dtype=bool)
    wide[rows, channels] = (
        np.quantile(size, 0.75, axis=1) > _WIDE * _UPPER_QUARTILE * sigma[channels]
    )
    return wide


def _is_white(residual: Array) -> bool:
    """Whether no channel of a residual (N, C) is autocorrelated from row to row."""
    power = (residual * residual).sum(axis=0)
    correlation = (residual[1:] * residual[:-1]).sum(axis=0) / np.where(power > 0.0, power, 1.0)
    return bool((correlation < _WHITE).all())


def _fit(t: Array, values: Array, spacing: float) -> tuple[BSpline, Array, int]:
    inner = np.linspace(t[0], t[-1], max(2, int(np.ceil((t[-1] - t[0]) / spacing)) + 1))[1:-1]
    spline = smoothing_spline(t, values, inner)
    return spline, values - spline(t), len(spline.c)
