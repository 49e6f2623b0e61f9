"""Damaged values: single values and short bursts of a log that their neighbours contradict.

A value with a notable prediction error (ballbar.cell.neighbours) is judged by a cubic through eight
rows around it. A second damaged value among the eight would spoil their cubic, so notable values
close to each other are also judged in pairs. What is left, three and more close to each other, is
judged as a burst by the rows on both sides. A kink or a step of the motion leaves the rows on no
cubic, and nothing is concluded.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ballbar.acquisition.flags import RowFlag
from ballbar.acquisition.table.table import Table
from ballbar.cell.arrays import Array
from ballbar.cell.neighbours import (
    CLEAR,
    CUBIC,
    DAMAGED,
    NOTABLE,
    SMALLEST,
    Mask,
    Rows,
    damaged_bursts,
    local_fits,
    powers,
    prediction_error,
    prediction_errors,
    robust_sigma,
)

_JUDGES = 8  # rows that judge a value
_REACH = 15.0  # row periods: nine rows further apart than these say nothing of each other
_CLOSE = (
    _JUDGES  # rows: at the end of a log all judges are on one side, and may be spoilt so far away
)
# Notable values, and share of all values: where more are notable, they are steps or grains of the
# values and no pairs.
_MANY, _MANY_OF = 1000, 0.02
SMALLEST_LOAD = 0.1  # [N], [N m]: bends no robot of the cell by a micrometre
_GRAINS = 3.0  # steps of a coarse sensor
_ROUNDING = 1e-9  # [N], [N m]: what the form of numbers changes of them
_BLOCK = 8192  # rows at a time, for the processor's cache
_QUICK = 0.5  # of the highest speed: there noise of the stamps shows
_SAMPLE = 2000  # rows, whose median gives the noise to 3 %


class _Log(NamedTuple):
    """The values that are judged, and the noise by which they are."""

    t: Array  # (N,) [s]
    values: Array  # (N, C) [rad]
    firsts: Rows  # (S,) first row of each stretch
    lasts: Rows  # (S,) last row of each
    sigma: Array  # (C,) [rad] noise
    stamp_sigma: float  # [s] of the stamps, at most
    longest: float  # [s] that nine rows may span


class _Notable(NamedTuple):
    """Values to be judged, the most notable ones first."""

    row: Rows  # (K,)
    channel: Rows  # (K,)
    error: Array  # (K,) [rad] prediction error; 0 at the ends of a stretch, all of which are judged


def damaged_values(t: Array, values: Array, breaks: Mask) -> Mask:
    """(N, C) values that their neighbours contradict.

    t : (N,) [s]. values : (N, C) [rad]. breaks : (N,) rows at which a new stretch begins; rows
        on the other side of a break are no neighbours.
    """
    damaged = np.zeros(values.shape, dtype=bool)
    if t.size <= _JUDGES + 1:
        return damaged
    firsts = np.union1d(0, np.flatnonzero(breaks))
    lasts = np.append(firsts[1:], t.size) - 1
    period = float(np.median(np.diff(t), overwrite_input=True))
    log = _Log(t, values, firsts, lasts, *_noise(t, values), _REACH * period)
    notable = _notable(log)
    many = np.count_nonzero(notable.error) > max(_MANY, _MANY_OF * values.size)
    for apart in range(1 if many else _CLOSE + 1):  # single values, then pairs 1, 2, ... rows apart
        sets = _sets(notable, apart, log)
        for k in np.array_split(np.arange(sets.row.size), sets.row.size // _BLOCK + 1):
            if k.size:
                row, channel = sets.row[k], sets.channel[k]
                _mark(damaged, row, channel, _contradicted(log, row, channel, apart, None), apart)
    for _ in range(_CLOSE):
        row, channel = _beside(damaged)
        if not row.size or not (again := _contradicted(log, row, channel, 0, damaged)[:, 0]).any():
            break
        damaged[row[again], channel[again]] = True
    _mark_bursts(damaged, log, notable)
    return damaged


def load_scale(loads: Array) -> Array:
    """(C,) [rad per unit] by which `damaged_values` judges loads (N, C) [N], [N m] as angles.

    A deviation of SMALLEST_LOAD, or of some grains of a coarse sensor that flickers between two
    values, then is the smallest that it looks for.
    """
    step = np.abs(np.diff(loads, axis=0))
    grain = np.where(step > _ROUNDING, step, np.inf).min(axis=0, initial=np.inf)
    floor = np.maximum(SMALLEST_LOAD, np.where(np.isfinite(grain), _GRAINS * grain, 0.0))
    return np.asarray(SMALLEST / floor)


def with_damaged(table: Table, rows: Rows, channels: Sequence[str] = ()) -> Table:
    """The table with rows flagged and reported whose values no motion explains.

    channels : names of those that are damaged, if known.
    """
    which = f" ({', '.join(channels)})" if channels else ""
    sentence = f"the rows around it lead elsewhere{which}: a damaged number; row left out."
    kind, flag = "implausible value", RowFlag.IMPLAUSIBLE
    return table.remarked(kind, sentence, rows=rows, flag=flag)


def _noise(t: Array, values: Array) -> tuple[Array, float]:
    """(C,) [rad] white noise of each channel; [s] what noise of the stamps quick motion allows.

    A stamp that is wrong displaces a value by the speed.
    """
    rows = np.arange(2, t.size - 2, 1 + (t.size - 4) // _SAMPLE)
    around = [rows + k for k in range(-2, 3)]
    error = np.nan_to_num(prediction_error([t[k] for k in around], [values[k] for k in around]))
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.abs((values[rows + 1] - values[rows - 1]) / (t[rows + 1] - t[rows - 1])[:, None])
        late = (error / speed)[speed > _QUICK * np.nanquantile(speed, 0.99)]
    return robust_sigma(error), float(robust_sigma(late)) if late.size else 0.0


def _notable(log: _Log) -> _Notable:
    """The notable values, the largest error first, then all values at the ends of stretches.

    A damaged value makes its neighbours notable too, with smaller errors.
    """
    t, values, reach = log.t, log.values, np.arange(_JUDGES // 2)
    ends = np.union1d(log.firsts[:, None] + reach, log.lasts[:, None] - reach)
    ends = ends[(ends >= 0) & (ends <= log.lasts[-1])]
    threshold = np.maximum(NOTABLE * log.sigma, 0.5 * SMALLEST)
    rows, channels, errors = [], [], []
    for begin in range(2, t.size - 2, _BLOCK):
        error = prediction_errors(t, values, begin, min(begin + _BLOCK, t.size - 2))
        for k, column in enumerate(error.T):
            notable = np.flatnonzero(column > threshold[k])
            rows.append(notable + begin)
            channels.append(np.full(notable.size, k))
            errors.append(column[notable])
    count = values.shape[1]
    row = np.concatenate((*rows, np.repeat(ends, count)))
    channel = np.concatenate((*channels, np.tile(np.arange(count), ends.size)))
    size = np.concatenate((*errors, np.zeros(ends.size * count)))
    order = np.argsort(-size, kind="stable")
    return _Notable(row[order], channel[order], size[order])


def _sets(notable: _Notable, apart: int, log: _Log) -> _Notable:
    """Values to be judged together with the value `apart` rows later, the most notable first.

    Both are notable, or one is clearly: it may hide the other.
    """
    if not apart:
        return notable
    count = log.t.size
    # Of an end that is notable itself the first entry is taken, which has the prediction error.
    known, index = np.unique(notable.channel * count + notable.row, return_index=True)
    error = notable.error[index]
    clear = error > np.maximum(CLEAR * log.sigma, 0.5 * SMALLEST)[known // count]
    both = np.intersect1d(known, known - apart, assume_unique=True)
    pair = np.unique(np.concatenate((both, known[clear], known[clear] - apart)))
    pair = pair[(pair % count + apart < count) & (pair >= 0)]
    together = np.zeros(pair.size)
    for member in (pair, pair + apart):
        at = np.minimum(np.searchsorted(known, member), known.size - 1)
        together += np.where(known[at] == member, error[at], 0.0)
    order = np.argsort(-together, kind="stable")
    return _Notable(pair[order] % count, pair[order] // count, together[order])


def _beside(damaged: Mask) -> tuple[Rows, Rows]:
    """Rows and channels of the values that have a damaged value (N, C) among their judges."""
    row, channel = np.nonzero(damaged)
    close = np.zeros_like(damaged)
    for k in range(-_JUDGES // 2, _JUDGES // 2 + 1):
        close[np.clip(row + k, 0, len(damaged) - 1), channel] = True
    rows, channels = np.nonzero(close & ~damaged)
    return rows, channels


def _contradicted(log: _Log, row: Rows, channel: Rows, apart: int, damaged: Mask | None) -> Mask:
    """(K, 2) whether `row` and `row + apart` are both off the cubic through the rows beside them.

    damaged : (N, C) values that do not judge, if any are known; some more rows judge in their
        place.
    """
    t, firsts, lasts = log.t, log.firsts, log.lasts
    width = min(_JUDGES + 1 + (apart if damaged is None else _JUDGES // 2), t.size)
    stretch = np.searchsorted(firsts, row, side="right") - 1
    first, last = firsts[stretch], lasts[stretch]
    begin = np.minimum(np.maximum(row - (width - apart) // 2, first), last - width + 1)
    # The last two rows of a log may be the beginning of a motion; good rows between or behind
    # them tell.
    margin = 2 * (apart == 1)
    judged = (begin >= first) & (row - margin >= first) & (row + apart + margin <= last)
    window = np.clip(begin, 0, t.size - width)[:, None] + np.arange(width)  # (K, W)
    span = t[window[:, -1]] - t[window[:, 0]]
    judged &= (span > 0.0) & (span < log.longest * width / (_JUDGES + 1))
    judges = (window != row[:, None]) & (window != row[:, None] + apart)
    if damaged is not None:
        judges &= ~damaged[window, channel[:, None]]
        judged &= judges.sum(axis=1) >= _JUDGES
    x = (t[window] - t[row][:, None]) / np.where(span > 0.0, span, 1.0)[:, None]
    fits = local_fits(powers(x, CUBIC), judges)
    chosen = log.values[window, channel[:, None]]
    residual = fits.residual(chosen)
    speed = fits.coefficients(chosen)[:, 1] / np.where(span > 0.0, span, 1.0)
    sigma = np.hypot(log.sigma[channel], log.stamp_sigma * speed)
    deviation = fits.deviation(np.maximum(sigma, fits.spread(residual)))
    at = np.clip((row - window[:, 0])[:, None] + (0, apart), 0, width - 1)  # (K, 2)
    off = np.take_along_axis(np.abs(residual), at, axis=1)
    # Both, or it is one of them alone.
    far = (off > DAMAGED * np.take_along_axis(deviation, at, axis=1)).all(axis=1)
    return np.asarray((off > SMALLEST) & (far & judged & fits.full)[:, None])


def _mark(out: Mask, row: Rows, channel: Rows, contradicted: Mask, apart: int) -> None:
    """Marks contradicted values in `out` (N, C), in place.

    A value close to a marked one is not marked: that one may be the reason.
    """
    for k in np.flatnonzero(contradicted.any(axis=1)):
        first, column = int(row[k]), int(channel[k])
        beside = slice(max(0, first - _JUDGES // 2), first + apart + _JUDGES // 2 + 1)
        if not out[beside, column].any():
            out[first, column] |= contradicted[k, 0]
            out[first + apart, column] |= contradicted[k, 1]


def _mark_bursts(out: Mask, log: _Log, notable: _Notable) -> None:
    """Marks in `out` (N, C) the bursts among the values that are not marked yet, in place."""
    far = notable.error > np.maximum(DAMAGED * log.sigma, 0.5 * SMALLEST)[notable.channel]
    if not (far & ~out[notable.row, notable.channel]).any():
        return
    for first, last in zip(log.firsts, log.lasts, strict=True):
        rows = first + np.flatnonzero(~out[first : last + 1].any(axis=1))
        if rows.size > _JUDGES + 1:
            out[rows] = damaged_bursts(log.t[rows], log.values[rows])
