"""Clock offset and skew between two logs of one motion, from any channels that both hold.

Units, directions and zeros of the recorders do not matter: each group of channels, a single one,
a vector, a rotation or a pose, has a constant map of its own (ballbar.ident.estimator.channel_map).
Rows that repeat a held value do not count (ballbar.cell.held_values). Both logs are smoothed
(ballbar.ident.signals.smooth_log), all lags are compared by the speeds of the channels
(ballbar.ident.start.speed_scan), and the best ones are refined by least squares
(ballbar.ident.estimator.clock_fit).

Where a motion repeats itself, several lags explain the logs equally well. Such logs are refused:
nothing in them tells which lag is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.errors import FailureError, LogError
from ballbar.cell.held_values import fresh_rows
from ballbar.cell.logs import ChannelLog, segment_starts
from ballbar.cell.number_text import duration_text, significant_text
from ballbar.ident.channel_groups import UNIT, Group, Names, checked_groups, groups_by_name
from ballbar.ident.channel_pair import MOVES, ChannelPair, channel_pair
from ballbar.ident.estimator.clock_fit import AVERAGED, ClockFit, Side, fit_clock
from ballbar.ident.signals.smooth_log import WIDEST_KNOT_SPACING, SmoothLog, smooth_log
from ballbar.ident.start.lag_scan import best_lags, subsample
from ballbar.ident.start.speed_scan import Columns, likely_pairs, scan_speeds, speed_correlation

SCAN_STEP = 0.02  # [s] of the lags
MIN_OVERLAP = 5.0  # [s] less cannot tell one motion from another
LAGS, LAG_SEPARATION = 8, 0.5  # peaks of the scan that are refined, and [s] between them
WINDOW = 60.0  # [s] in which pairs of channels are looked for
RELATED = 0.8  # speed correlation from which two channels are taken for one motion
# A second lag whose residuals are at most so many times those of the best one, over so much of its
# overlap, explains the logs as well; the same lag if it is closer than SAME.
RIVAL_RESIDUAL, RIVAL_OVERLAP, SAME = 2.0, 0.5, 0.05  # [1], [1], [s]


class AlignmentError(FailureError):
    """Two logs cannot be brought to one clock, and why."""


@dataclass(frozen=True)
class LogAlignment:
    """The clock of log B against that of log A, both counted from the first row of their log."""

    clock: Clock  # t_a = offset + (1 + skew) t_b
    offset_sigma: float  # [s]
    skew_sigma: float  # [1]
    correlation: float  # of offset and skew
    middle: float  # [s] on the clock of B, of the overlap, where the clock is known best
    middle_sigma: float  # [s] of t_a there
    overlap: float  # [s]
    samples: int  # instants compared
    inflation: float  # of the sigmas for autocorrelated residuals
    pairs: tuple[ChannelPair, ...]
    remarks: tuple[str, ...]  # channels that did not take part, and repairs of the logs


@dataclass(frozen=True, eq=False)
class _Smoothed:
    """Some channels of a log: its fresh rows smoothed, about their centres, over their scales."""

    log: ChannelLog
    names: Names
    smooth: SmoothLog
    centre: Array  # (C,) [unit]
    scale: Array  # (C,) [unit]
    late: float  # [s] standard deviation of the age of held values when they are read
    remarks: tuple[str, ...]

    def side(self, group: Group, k: int) -> Side:
        """Side k of a group of these channels."""
        columns = [self.names.index(name) for name in group[k]]
        points = len(columns) - 4 if len(columns) > 3 else len(columns)
        rate = len(columns) == 4 and len(group[1 - k]) == 3
        spline = self.smooth.spline
        own = BSpline(spline.t, np.ascontiguousarray(spline.c[:, columns]), spline.k)
        centre = np.zeros(3) if rate else self.centre[columns[:points]]
        return Side(self.smooth, own, points, rate, centre, float(self.scale[columns[0]]))


def align_logs(
    a: ChannelLog,
    b: ChannelLog,
    pairs: Sequence[tuple[str, str]] = (),
    groups: Sequence[Group] = (),
) -> LogAlignment:
    """Clock offset and skew of log B against log A.

    pairs : channels of A and B that belong together. groups : the same of vectors, rotations and
    poses. Otherwise those that their names show, then channels of the same name, and without any of
    them pairs that move together.

    Raises LogError if a log is too short, nothing moves in it, or a channel does not exist;
    AlignmentError if no lag makes the channels agree, or several do.
    """
    requested = [*(((x,), (y,)) for x, y in pairs), *groups]
    checked_groups(a, b, requested)
    if requested:
        return _aligned(a, b, requested, requested=True)
    vectors = groups_by_name(a, b)
    taken = {name for group in vectors for names in group for name in names}
    equal: list[Group] = [((name,), (name,)) for name in a.names if name in b.names]
    try:
        return _aligned(a, b, vectors + [group for group in equal if group[0][0] not in taken])
    except AlignmentError:
        if not vectors:
            raise
        return _aligned(a, b, equal)


def _aligned(
    a: ChannelLog, b: ChannelLog, named: Sequence[Group], *, requested: bool = False
) -> LogAlignment:
    """The alignment by the named groups; without any by all single channels that go together."""
    every: list[Group] = [((x,), (y,)) for x, y in product(a.names, b.names)]
    groups = list(named) or every
    sides = _sides(a, b, groups)[0]
    speeds, columns = _speeds(a, b, groups, sides)
    among = [pair for pairs in columns for pair in pairs]
    least = round(MIN_OVERLAP / SCAN_STEP)
    scan = scan_speeds(*speeds, among, least=least, paired=bool(named))
    best = best_lags(scan, count=LAGS, separation=round(LAG_SEPARATION / SCAN_STEP))
    if not best:
        raise LogError(
            f"{a.name} and {b.name} share no {MIN_OVERLAP:g} s at any clock offset. Log a longer "
            "run with both."
        )
    samples = [round(span / SCAN_STEP) for span in (WINDOW, AVERAGED)]
    lag = int(scan.lags[best[0]])
    sizes = speed_correlation(*speeds, among, lag, window=samples[0], mean_of=samples[1])
    first = np.cumsum([0, *map(len, columns)])[:-1]
    correlation = np.maximum.reduceat(sizes, first)
    related, remarks = groups, list[str]()
    if not named:
        table = correlation.reshape(len(a.names), len(b.names))
        related = [((a.names[i],), (b.names[j],)) for i, j in likely_pairs(table, RELATED)]
    elif not requested:
        related = [g for g, r in zip(groups, correlation, strict=True) if r >= RELATED]
        remarks = [
            f"channels {','.join(x)} and {','.join(y)} were left out: their speeds correlate by "
            f"{r:.2f} only"
            for (x, y), r in zip(groups, correlation, strict=True)
            if r < RELATED
        ]
    if not related or correlation.max() < RELATED:
        raise AlignmentError(_unrelated(a, b))
    sides, smoothed = _sides(a, b, related)
    starts = (subsample(scan, index) * SCAN_STEP for index in best)
    fits = [
        fit for start in starts if (fit := fit_clock(sides, start)) and fit.correlation >= RELATED
    ]
    if not fits:
        raise AlignmentError(_unrelated(a, b))
    chosen = max(fits, key=lambda fit: fit.evidence)
    _refuse_rivals(chosen, fits)
    repairs = [remark for part in smoothed for remark in _repairs(part)]
    of_a, of_b = (max(part.late for part in smoothed if part.log is log) for log in (a, b))
    return _result(chosen, related, sides, float(np.hypot(of_a, of_b)), (*remarks, *repairs))


def _sides(
    a: ChannelLog, b: ChannelLog, groups: Sequence[Group]
) -> tuple[list[tuple[Side, Side]], list[_Smoothed]]:
    """Both sides of each group, and the smoothed channels they are of: single ones together."""
    parts, sides = list[_Smoothed](), list[list[Side]]()
    for log, k in ((a, 0), (b, 1)):
        if log.t.size < 2 or log.t[-1] - log.t[0] < MIN_OVERLAP:
            raise LogError(
                f"{log.name}: the log lasts {np.ptp(log.t) if log.t.size else 0.0:.3g} s; aligning "
                f"two clocks needs {MIN_OVERLAP:g} s in common. Log a longer run with both."
            )
        single = tuple(dict.fromkeys(group[k][0] for group in groups if len(group[k]) == 1))
        own = {names: _smoothed(log, names, vector=False) for names in {single} - {()}}
        own |= {g[k]: _smoothed(log, g[k], vector=True) for g in groups if len(g[k]) > 1}
        if all(_still(part) for part in own.values()):
            raise LogError(
                f"{log.name}: nothing moves in {', '.join(n for names in own for n in names)}, so "
                "its clock cannot be compared with another. Log both while the machine moves."
            )
        parts += own.values()
        sides.append([own[g[k] if len(g[k]) > 1 else single].side(g, k) for g in groups])
    return list(zip(*sides, strict=True)), parts


def _still(part: _Smoothed) -> bool:
    spread = np.asarray(part.smooth.spline(part.smooth.stamps)).std(axis=0)
    return bool((spread <= MOVES * part.smooth.noise).all())


def _smoothed(log: ChannelLog, names: Names, *, vector: bool) -> _Smoothed:
    """Some channels of a log smoothed: single ones, or those of a vector.

    Each is taken about its median and over its spread, which the coordinates of a vector share; a
    quaternion keeps its values, with steady signs.
    """
    values = log.values[:, [log.names.index(name) for name in names]]
    rows, remarks, points = fresh_rows(log.t, values), [], len(names)
    period = 0.0 if rows.all() else float(np.median(np.diff(log.t)))
    if period:
        share = significant_text(100.0 * (1.0 - rows.mean()), 2)
        remarks.append(
            f"{log.name}: {share} % of the rows repeat {','.join(names)}: held values; only rows "
            f"with new ones count, each up to {duration_text(period)} old"
        )
    if vector and len(names) > 3:
        points = len(names) - 4
        norm = np.linalg.norm(values[:, points:], axis=1)
        unit = np.abs(norm - 1.0) < UNIT
        if unit.mean() < 0.5:
            what = f"{','.join(names[points:])} is no quaternion, of norm {np.median(norm):.3g}."
            raise LogError.at(log.name, what, "Name its x, y, z and w.")
        if not unit.all():
            remarks.append(f"{log.name}: {(~unit).sum()} rows without a unit quaternion; left out")
        rows &= unit
    t, values = log.t[rows], values[rows]
    centre, scale = np.median(values, axis=0), values.std(axis=0)
    centre[points:] = 0.0
    if vector:
        flips = (values[1:, points:] * values[:-1, points:]).sum(axis=1) < 0.0
        values[1:, points:] *= np.where(np.cumsum(flips) % 2, -1.0, 1.0)[:, None]
        scale[:points] = np.linalg.norm(scale[:points]) / np.sqrt(3.0)
        scale[points:] = 1.0
    scale = np.where(scale > 0.0, scale, 1.0)
    try:
        smooth = smooth_log(
            t,
            (values - centre) / scale,
            widest_knot_spacing=WIDEST_KNOT_SPACING,
            starts=segment_starts(None if log.segment is None else log.segment[rows]),
        )
    except ValueError as error:
        raise LogError(f"{log.name}: {error}. Log a longer run.") from None
    return _Smoothed(
        log, names, smooth, centre, scale, late=period / np.sqrt(12.0), remarks=tuple(remarks)
    )


def _speeds(
    a: ChannelLog, b: ChannelLog, groups: Sequence[Group], sides: Sequence[tuple[Side, Side]]
) -> tuple[tuple[Array, Array], list[list[tuple[Columns, Columns]]]]:
    """Speeds (N, C) of both logs on even grids, and the columns of each group that are compared.

    Of points their speed, of rotations the angular rate, both of poses; about their mean, over
    their rms, 0 in gaps.
    """
    stacks: tuple[list[Array], ...] = ([], [])
    known: tuple[dict[tuple[Names, str], tuple[int, ...]], ...] = ({}, {})
    columns = list[list[tuple[Columns, Columns]]]()
    for group, pair in zip(groups, sides, strict=True):
        lengths = {len(names) for names in group}
        whats = ["speed"] * (4 not in lengths) + ["rate"] * (lengths <= {4, 7})
        for what in whats or ["point"]:
            for k, log in enumerate((a, b)):
                if (group[k], what) not in known[k]:
                    t = np.arange(log.t[0], log.t[-1], SCAN_STEP)
                    speed = getattr(pair[k].trace(t), what)
                    first = sum(x.shape[1] for x in stacks[k])
                    known[k][group[k], what] = tuple(range(first, first + speed.shape[1]))
                    stacks[k].append(_normalised(speed, pair[k].smooth.covers(t)))
        columns.append([(known[0][group[0], w], known[1][group[1], w]) for w in whats or ["point"]])
    left, right = (np.concatenate(stack, axis=1) for stack in stacks)
    return (left, right), columns


def _normalised(speed: Array, covered: NDArray[np.bool_]) -> Array:
    """Speeds (N, d) about their mean, over the rms of all of them; 0 in gaps."""
    centred = np.where(covered[:, None], speed - speed.mean(axis=0), 0.0)
    rms = float(np.sqrt((centred * centred).mean()))
    # The rounding of a constant speed is no motion.
    return centred / rms if rms > 1e-6 * np.abs(speed).max(initial=1e-300) else 0.0 * centred


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


def _repairs(part: _Smoothed) -> list[str]:
    """A sentence for what smoothing repaired in some channels of a log or left out of them."""
    log, smooth, remarks = part.log, part.smooth, list(part.remarks)
    for step in smooth.steps:
        if step.channel is None:
            what = f"the clock stepped by {step.size * 1e3:+.1f} ms"
        else:
            size = step.size * part.scale[step.channel]
            what = f"channel {part.names[step.channel]} jumped by {size:+.4g}"
        remarks.append(f"{log.name}: {what} at t = {step.time:.2f} s; taken out of it")
    if rows := smooth.outliers.rows:
        remarks.append(f"{log.name}: {rows} of {smooth.outliers.of} rows are outliers; left out")
    return remarks


def _result(
    fit: ClockFit,
    groups: Sequence[Group],
    sides: Sequence[tuple[Side, Side]],
    late: float,
    remarks: tuple[str, ...],
) -> LogAlignment:
    """The alignment; late : [s] standard deviation of the age of held values."""
    at_middle = fit.covariance + np.diag([late**2, 0.0])
    to_first = np.array([[1.0, -fit.middle], [0.0, 1.0]])  # row of B
    covariance = to_first @ at_middle @ to_first.T
    sigma = np.sqrt(np.diag(covariance))
    return LogAlignment(
        clock=fit.clock,
        offset_sigma=float(sigma[0]),
        skew_sigma=float(sigma[1]),
        correlation=float(covariance[0, 1] / (sigma[0] * sigma[1])),
        middle=fit.middle,
        middle_sigma=float(np.sqrt(at_middle[0, 0])),
        overlap=fit.overlap,
        samples=sum(group.t.size for group in fit.groups),
        inflation=fit.inflation,
        pairs=tuple(
            channel_pair(group, pair, own, fit.covariance)
            for group, pair, own in zip(groups, sides, fit.groups, strict=True)
        ),
        remarks=remarks,
    )
