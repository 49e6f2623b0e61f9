"""How many ticks of its source lie between two rows with new values, by the values alone.

Where the source moves, its values go on from row to row by a whole number of times the way of one
tick. A source that passes on every second tick of its task, or now and then the third, goes on by
half of its usual ticks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.neighbours import Mask, Rows, robust_sigma

FEWEST = 100  # rows with new values, or quick links: fewer tell of no ticks
HALVES = (0.05, 0.1, 0.2)  # [s] of arrivals on either side that show the speed at first
ROWS = (16, 8, 5)  # on either side that show it then, in passes in which their ticks get right
REGION = 16  # links on either side that must go on by whole ticks, for a link to be sure
ENOUGH, MOSTLY = 0.999, 0.5  # of the links, sure ones: no second look; each tick has a row
WHOLE, NEAR = (0.2, 0.4), 4.0  # ticks off a whole number, at least and at most; times the noise
SURE, LIKELY = 0.6, 0.3  # mean cosine of the phases of a region
HALF, HALF_SHARE = 3, 0.8  # links of half ticks that make them the source's own; of those not whole
SAMPLE = 20_000  # rows that show the period at first
LONGEST = 10.0  # ticks between two rows that the values can tell
_CHUNK = 8192
_FINEST = 1e-9  # [s]


class TickLinks(NamedTuple):
    """Steps from one row to the next, as the values tell them."""

    ticks: Array  # (F-1,)
    sure: Mask  # (F-1,) whether these are
    progress: Array  # (F-1,) ticks by the way that the values went
    usual: float = 1.0  # ticks of a step, where the values do not tell


def links_of(arrival: Array, values: Array) -> tuple[float, TickLinks]:
    """[s] period of the ticks, and the links of rows that arrived (F,) [s] with values (C, F)."""
    period = float(np.ptp(arrival)) / (arrival.size - 1)
    links = counted(values, np.ones(arrival.size - 1))
    if links.sure.mean() <= ENOUGH:  # not nearly every tick has a row
        other, others = _some_ticks(arrival, values)
        if others.sure.mean() > links.sure.mean() or links.sure.mean() < MOSTLY:
            period, links = other, others
    half = _halves(links)
    if not half.any():
        return period, links
    progress, sure = 2.0 * links.progress, links.sure | half
    count = np.where(sure, np.rint(progress), 2.0 * links.ticks)
    return 0.5 * period, TickLinks(count, sure, progress, 2.0)


def scaled(channels: Sequence[Array], rows: Rows) -> Array:
    """(C, F) the rows (F,) of channels in units of their second differences; none without any."""
    out, count = np.empty((len(channels), rows.size)), 0
    for channel in channels:
        values = channel if rows.size == channel.size else channel[rows]
        bend = np.abs(np.diff(values[: 10 * SAMPLE], 2)[:: 1 + values.size // SAMPLE])
        size = float(np.median(bend)) or float(np.sqrt(np.mean(bend * bend)))
        if size > 0.0:
            np.divide(values, size, out=out[count])
            count += 1
    return out[:count]


def counted(values: Array, likely: Array, progress: Array | None = None) -> TickLinks:
    """The links by the ticks that the values went on.

    values : (C, F). likely : (F-1,) ticks where the values do not tell. progress : (F-1,) in ticks,
    to begin with.
    """
    from scipy.ndimage import uniform_filter1d  # noqa: PLC0415  slow to import, and rarely needed

    count, sure, begun = likely, np.zeros(likely.size, dtype=bool), progress is not None
    for rows in (0, *ROWS) if begun else ROWS:
        if rows or progress is None:
            clock = np.concatenate(([0.0], np.cumsum(count)))
            progress = _progress(values, clock, rows)[0]
        whole = np.clip(np.rint(progress), 1.0, LONGEST)
        region = uniform_filter1d(np.cos(2.0 * np.pi * progress), 2 * REGION + 1)
        steady = region > SURE
        noise = (progress - whole)[steady][:: 1 + progress.size // SAMPLE]
        tolerance = np.clip(NEAR * robust_sigma(noise), *WHOLE) if noise.size else WHOLE[0]
        sure = steady & (np.abs(progress - whole) < tolerance)
        before, count = count, np.where(region > LIKELY, whole, likely)
        if rows and np.array_equal(before, count):
            break
    return TickLinks(count, sure, np.asarray(progress))


def _halves(links: TickLinks) -> Mask:
    """(F-1,) links between sure ones that are an odd number of half ticks; none if others are not.

    A task of half the period that runs over puts its values off by one of its own ticks.
    """
    _, sure, progress, _ = links
    between = np.zeros(sure.size, dtype=bool)
    between[1:-1] = ~sure[1:-1] & sure[:-2] & sure[2:] & (progress[1:-1] > 1.0)
    half = between & (np.abs(progress - np.floor(progress) - 0.5) < 0.5 * WHOLE[0])
    rule = np.count_nonzero(half) >= max(HALF, HALF_SHARE * np.count_nonzero(between))
    return half if rule else np.zeros(sure.size, dtype=bool)


def _some_ticks(arrival: Array, values: Array) -> tuple[float, TickLinks]:
    """[s] period of a source that skips ticks or shows some again, and its links.

    arrival : (F,) [s]. values : (C, F). The arrivals of many rows show the speed, and this the way
    that is gone again and again.
    """
    rate, part, fit, half = arrival.size / np.ptp(arrival), _sample(values), 0.0, 0
    widest, period = min(SAMPLE, arrival.size) // 3, 0.0
    for width in HALVES:
        tried = min(max(ROWS[-1], int(width * rate)), widest)
        candidate = _period(*_progress(values[:, part], arrival[part], tried))
        if candidate[1] > fit:
            (period, fit), half = candidate, tried
    if not half:
        none = np.zeros(arrival.size - 1)
        return 1.0, TickLinks(none, none > 0.0, none)
    likely = np.clip(np.rint(np.diff(arrival) / period), 1.0, LONGEST)
    return period, counted(values, likely, _progress(values, arrival, half)[0] / period)


def _progress(values: Array, clock: Array, half: int) -> tuple[Array, Array]:
    """(F-1,) how far the clock went between two rows, by the way and the speed of their values.

    values : (C, F). clock : (F,) about which the motion is smooth over 2 `half` + 1 rows. Second:
    (F-1,) the speed.
    """
    along, power = np.zeros(clock.size - 1), np.zeros(clock.size - 1)
    for first in range(half, clock.size - 1 - half, _CHUNK):
        stop = min(first + _CHUNK, clock.size - 1 - half)
        inner, chunk = slice(first, stop), values[:, first - half : stop + half + 1]
        speed = chunk[:, 2 * half + 1 :] - chunk[:, : -2 * half - 1]
        span = clock[first + half + 1 : stop + half + 1] - clock[first - half : stop - half]
        speed /= np.maximum(span, _FINEST)
        way = chunk[:, half + 1 : chunk.shape[1] - half] - chunk[:, half : -half - 1]
        np.einsum("cf,cf->f", way, speed, out=along[inner])
        np.einsum("cf,cf->f", speed, speed, out=power[inner])
    for first, row in ((0, half), (clock.size - 1 - half, clock.size - 2 - half)):  # both ends
        speed = values[:, row + half + 1] - values[:, row - half]
        speed /= max(_FINEST, clock[row + half + 1] - clock[row - half])
        along[first : first + half] = speed @ np.diff(values[:, first : first + half + 1])
        power[first : first + half] = speed @ speed
    np.divide(along, power, out=along, where=power > 0.0)
    return np.nan_to_num(along, posinf=0.0, neginf=0.0), np.sqrt(power, out=power)


def _period(progress: Array, speed: Array) -> tuple[float, float]:
    """[s] the longest period of which the progresses (K,) [s] are whole multiples, and how well.

    Its second part is the mean cosine of the phases, 1 at best.
    """
    quick = progress[(speed > 0.3 * np.quantile(speed, 0.9)) & (progress > 0.0)]
    if quick.size < FEWEST:
        return 0.0, 0.0
    quick = quick[:: 1 + quick.size // 1500]
    tried = np.quantile(quick, 0.25) * np.geomspace(0.25, 1.4, 200)
    fit = np.array([np.cos(2.0 * np.pi / period * quick).mean() for period in tried])
    best = int(np.flatnonzero(fit >= 0.85 * fit.max())[-1])
    while best > 0 and fit[best - 1] > fit[best]:
        best -= 1
    return float(tried[best]), float(fit[best])


def _sample(values: Array) -> slice:
    """The SAMPLE rows in which the channels (C, F) go the longest way."""
    starts = np.arange(0, max(1, values.shape[1] - SAMPLE + 1), SAMPLE // 2)
    way = [np.abs(np.diff(values[:, k : k + SAMPLE : 200])).sum() for k in starts.tolist()]
    first = int(starts[np.argmax(way)])
    return slice(first, first + SAMPLE)
