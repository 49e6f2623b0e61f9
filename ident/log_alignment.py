"""Clock offset and skew between two logs of one motion, from any channels that both hold.

Units, directions and zeros of the recorders do not matter: each pair of channels has an affine map
of its own. Both logs are smoothed (ident.signals.smooth_log), all lags are compared by the speeds
of the channels (ident.start.speed_scan), and the best ones are refined by least squares
(ident.estimator.clock_fit).

Where a motion repeats itself, several lags explain the logs equally well. Such logs are refused:
nothing in them tells which lag is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.clock import Clock
from cell.errors import FailureError, LogError
from cell.logs import ChannelLog, segment_starts
from ident.estimator.clock_fit import ClockFit, fit_clock
from ident.signals.smooth_log import SmoothLog, smooth_log
from ident.start.lag_scan import LagScan, best_lags, subsample
from ident.start.speed_scan import likely_pairs, scan_speeds, speed_correlation

WIDEST_KNOT_SPACING = 0.08  # [s] motion below 3 Hz; finer where the residual asks for it
SCAN_STEP = 0.02  # [s] of the lags
MIN_OVERLAP = 5.0  # [s] less cannot tell one motion from another
LAGS, LAG_SEPARATION = 8, 0.5  # peaks of the scan that are refined, and [s] between them
MOVES = 3.0  # times its noise: a channel with less spread stands still
WINDOW = 60.0  # [s] in which pairs of channels are looked for
RELATED = 0.8  # speed correlation from which two channels are taken for one motion
# A second lag whose residuals are at most so many times those of the best one, over so much of its
# overlap, explains the logs as well; the same lag if it is closer than SAME.
RIVAL_RESIDUAL, RIVAL_OVERLAP, SAME = 2.0, 0.5, 0.05  # [1], [1], [s]


class AlignmentError(FailureError):
    """Two logs cannot be brought to one clock, and why."""


@dataclass(frozen=True)
class ChannelPair:
    """Channels of both logs that hold one motion: `a = gain b + zero`."""

    a: str
    b: str
    correlation: float  # of the values at the aligned instants
    gain: float  # [unit of a per unit of b]
    zero: float  # [unit of a]
    residual: float  # [unit of a] rms
    residual_share: float  # of the rms of a about its mean


@dataclass(frozen=True)
class LogAlignment:
    """The clock of log B against that of log A, both counted from the first row of their log."""

    clock: Clock  # t_a = offset + (1 + skew) t_b
    offset_sigma: float  # [s]
    skew_sigma: float  # [1]
    correlation: float  # of offset and skew
    overlap: float  # [s]
    samples: int  # instants compared
    inflation: float  # of the sigmas for autocorrelated residuals
    pairs: tuple[ChannelPair, ...]
    remarks: tuple[str, ...]  # channels that did not take part, and repairs of the logs


@dataclass(frozen=True, eq=False)
class _Scaled:
    """A smoothed log whose channels were divided by their spread."""

    log: ChannelLog
    smooth: SmoothLog  # of (values - centre) / scale
    centre: Array  # (C,) [unit]
    scale: Array  # (C,) [unit]

    @property
    def start(self) -> float:
        """[s]"""
        return self.smooth.start

    def speeds(self) -> Array:
        """(N, C) speeds about their mean over their rms, on an even grid; 0 in gaps."""
        t = np.arange(self.smooth.start, self.smooth.end, SCAN_STEP)
        speed = np.asarray(self.smooth.speed(t))
        speed = np.where(self.smooth.covers(t)[:, None], speed - speed.mean(axis=0), 0.0)
        rms = np.sqrt((speed * speed).mean(axis=0))
        # The rounding of a constant speed is no motion.
        unsteady = rms > 1e-6 * np.abs(speed).max(initial=1e-300)
        return np.asarray(np.where(unsteady, speed / np.where(unsteady, rms, 1.0), 0.0))


def align_logs(a: ChannelLog, b: ChannelLog, pairs: Sequence[tuple[str, str]] = ()) -> LogAlignment:
    """Clock offset and skew of log B against log A.

    pairs : channels of A and B that belong together; otherwise those of the same name, and without
    any pairs that move together.

    Raises LogError if a log is too short, nothing moves in it, or a channel does not exist;
    AlignmentError if no lag makes the channels agree, or several do.
    """
    named = list(pairs) or [(name, name) for name in a.names if name in b.names]
    a, b = _channels(a, b, named)
    left, right = _moving(a), _moving(b)
    speeds = left.speeds(), right.speeds()
    scan = _scan(speeds, named=bool(named))
    best = best_lags(scan, count=LAGS, separation=round(LAG_SEPARATION / SCAN_STEP))
    if not best:
        raise LogError(
            f"{a.name} and {b.name} share no {MIN_OVERLAP:g} s at any clock offset. Log a longer "
            "run with both."
        )
    correlation = speed_correlation(*speeds, int(scan.lags[best[0]]), round(WINDOW / SCAN_STEP))
    columns, remarks = _related(a, b, correlation, named=bool(named), requested=bool(pairs))
    left, right = _only(left, [i for i, _ in columns]), _only(right, [j for _, j in columns])
    starts = (subsample(scan, index) * SCAN_STEP for index in best)
    fits = [
        fit
        for start in starts
        if (fit := fit_clock(left.smooth, right.smooth, start + left.start - right.start))
        and fit.speed_correlation.max() >= RELATED
    ]
    if not fits:
        raise AlignmentError(_unrelated(a, b))
    chosen = max(fits, key=lambda fit: fit.evidence)
    _refuse_rivals(chosen, fits)
    return _result(chosen, left, right, (*remarks, *_repairs(left), *_repairs(right)))


def _channels(
    a: ChannelLog, b: ChannelLog, named: Sequence[tuple[str, str]]
) -> tuple[ChannelLog, ChannelLog]:
    """Both logs reduced to the named channels, in their order; whole logs without names."""
    if not named:
        return a, b
    parts = []
    for log, names in zip((a, b), zip(*named, strict=True), strict=True):
        for name in names:
            if name not in log.names:
                what = f"no channel {name!r}; it has {', '.join(log.names)}."
                raise LogError.at(log.name, what, "Name one of them.")
            if names.count(name) > 1:
                what = f"channel {name!r} is named {names.count(name)} times."
                raise LogError.at(log.name, what, "Pair each channel once.")
        parts.append(log.part([log.names.index(name) for name in names]))
    return parts[0], parts[1]


def _moving(log: ChannelLog) -> _Scaled:
    """The log smoothed. Raises LogError if it is too short or nothing moves in it."""
    if log.t.size < 2 or log.t[-1] - log.t[0] < MIN_OVERLAP:
        raise LogError(
            f"{log.name}: the log lasts {np.ptp(log.t) if log.t.size else 0.0:.3g} s; aligning two "
            f"clocks needs {MIN_OVERLAP:g} s in common. Log a longer run with both."
        )
    scaled = _smoothed(log)
    still = np.asarray(scaled.smooth.spline(log.t)).std(axis=0) <= MOVES * scaled.smooth.noise
    if still.all():
        raise LogError(
            f"{log.name}: nothing moves in {', '.join(log.names)}, so its clock cannot be compared "
            "with another. Log both while the machine moves."
        )
    return scaled


def _smoothed(log: ChannelLog) -> _Scaled:
    """The log smoothed, every channel about its median and over its spread."""
    spread = log.values.std(axis=0)
    centre, scale = np.median(log.values, axis=0), np.where(spread > 0.0, spread, 1.0)
    try:
        smooth = smooth_log(
            log.t,
            (log.values - centre) / scale,
            widest_knot_spacing=WIDEST_KNOT_SPACING,
            starts=segment_starts(log.segment),
        )
    except ValueError as error:
        raise LogError(f"{log.name}: {error}. Log a longer run.") from None
    return _Scaled(log, smooth, centre, scale)


def _only(scaled: _Scaled, columns: list[int]) -> _Scaled:
    """The log of some channels in that order, smoothed again without the others."""
    if columns == list(range(len(scaled.log.names))):
        return scaled
    return _smoothed(scaled.log.part(columns))


def _scan(speeds: tuple[Array, Array], *, named: bool) -> LagScan:
    """Score of every lag; named : column k of one log belongs to column k of the other."""
    a, b = (range(speed.shape[1]) for speed in speeds)
    pairs = [(k, k) for k in a] if named else [(i, j) for i in a for j in b]
    return scan_speeds(*speeds, pairs, least=round(MIN_OVERLAP / SCAN_STEP), paired=named)


def _related(
    a: ChannelLog, b: ChannelLog, correlation: Array, *, named: bool, requested: bool
) -> tuple[list[tuple[int, int]], list[str]]:
    """Columns of the pairs that move together at the best lag, and a sentence for each other pair.

    correlation : (Ca, Cb) of the speeds. named : as in `_scan`. requested : pairs that the user
    named all stay.
    Raises AlignmentError if none moves together.
    """
    pairs = [(k, k) for k in range(len(a.names))] if named else likely_pairs(correlation, RELATED)
    related = [(i, j) for i, j in pairs if abs(correlation[i, j]) >= RELATED]
    if not related:
        raise AlignmentError(_unrelated(a, b))
    if requested:
        return pairs, []
    remarks = [
        f"channels {a.names[i]} and {b.names[j]} were left out: their speeds correlate by "
        f"{correlation[i, j]:.2f} only"
        for i, j in pairs
        if (i, j) not in related
    ]
    return related, remarks


def _unrelated(a: ChannelLog, b: ChannelLog) -> str:
    return (
        f"no clock offset makes the channels of {a.name} and {b.name} move together. Are both of "
        "one run? Name channels of the same motion with --channel a=b."
    )


def _refuse_rivals(chosen: ClockFit, refined: Sequence[ClockFit]) -> None:
    """Raises AlignmentError if another lag explains the logs as well."""
    for rival in refined:
        apart = abs(rival.clock.offset - chosen.clock.offset)
        comparable = float(np.exp(np.log(rival.rms / chosen.rms).mean())) <= RIVAL_RESIDUAL
        if apart > SAME and comparable and rival.overlap >= RIVAL_OVERLAP * chosen.overlap:
            raise AlignmentError(
                f"the motion repeats itself: clock offsets {chosen.clock.offset:+.3f} s and "
                f"{rival.clock.offset:+.3f} s explain both logs equally well. Add a move that "
                "occurs once, or cut one log to the true beginning."
            )


def _repairs(scaled: _Scaled) -> list[str]:
    """A sentence for what smoothing repaired in a log or left out of it."""
    log, smooth, remarks = scaled.log, scaled.smooth, []
    for step in smooth.steps:
        if step.channel is None:
            what = f"the clock stepped by {step.size * 1e3:+.1f} ms"
        else:
            size = step.size * scaled.scale[step.channel]
            what = f"channel {log.names[step.channel]} jumped by {size:+.4g}"
        remarks.append(f"{log.name}: {what} at t = {step.time:.2f} s; taken out of it")
    if rows := smooth.outliers.rows:
        remarks.append(f"{log.name}: {rows} of {smooth.outliers.of} rows are outliers; left out")
    return remarks


def _result(fit: ClockFit, a: _Scaled, b: _Scaled, remarks: tuple[str, ...]) -> LogAlignment:
    gain = fit.gain * a.scale / b.scale
    zero = fit.zero * a.scale + a.centre - gain * b.centre
    rms = np.sqrt((fit.residual**2).mean(axis=0))
    pairs = tuple(
        ChannelPair(
            a=a.log.names[k],
            b=b.log.names[k],
            correlation=float(np.corrcoef(fit.a[:, k], fit.b[:, k])[0, 1]),
            gain=float(gain[k]),
            zero=float(zero[k]),
            residual=float(rms[k] * a.scale[k]),
            residual_share=float(rms[k] / fit.a[:, k].std()),
        )
        for k in range(gain.size)
    )
    sigma = np.sqrt(np.diag(fit.covariance))
    return LogAlignment(
        clock=fit.clock,
        offset_sigma=float(sigma[0]),
        skew_sigma=float(sigma[1]),
        correlation=float(fit.covariance[0, 1] / (sigma[0] * sigma[1])),
        overlap=fit.overlap,
        samples=len(fit.a),
        inflation=fit.inflation,
        pairs=pairs,
        remarks=remarks,
    )
