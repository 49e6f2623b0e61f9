"""Times of the rows of a regular source whose log has stamps of arrival.

Software stamps a row when it gets it: rows come in bursts and late, a source that is asked too
often repeats its last values, and one that is asked too seldom skips some. Row i shows the values
of tick n_i of the source and arrives at

    a_i = s + n_i T + d_i,    d_i >= 0 the delay, n_i whole numbers that increase.

The values themselves tell n_i wherever the source moves: between two rows they go on by a whole
number of times the way of one tick, whenever the rows arrive. Elsewhere the most likely sequence of
ticks is taken, in which hardly any row arrives before its tick and few are late. T and s come from
the rows of the least delay among some dozens, whose phases against T are unwrapped over ever longer
spans.

Stamps are changed only where the values fit whole ticks at least twice as well as the stamps.
A common delay cannot be seen in one log: s is chosen so that the usual delay of new values is zero,
the mean of delays without the longest and the shortest tenth. It becomes part of the clock offset.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.stamps.likely_ticks import likeliest_ticks, links_sigma, missed_ticks
from ballbar.acquisition.stamps.links import (
    ENOUGH,
    FEWEST,
    LONGEST,
    SAMPLE,
    TickLinks,
    counted,
    links_of,
    scaled,
)
from ballbar.acquisition.stamps.order import STAMP, amount
from ballbar.acquisition.table.table import Table
from ballbar.cell.arrays import Array
from ballbar.cell.held_values import whole_and_torn_rows
from ballbar.cell.neighbours import Mask, Rows, robust_sigma

ARRIVAL = "stamps of arrival"  # the finding
IRREGULAR, SHARE = 0.25, 0.05  # of the usual step, and of the rows: what no device's clock shows
FEW = 0.2  # sure links, of all: fewer tell of no ticks
BETTER = 0.5  # of what the stamps leave: as much whole ticks may leave
MANY = 100_000  # delays, whose mean is the usual one
BLOCK, STEADY = 32, 0.15  # rows among which the least delay counts; ticks by which it may scatter
MOST = 4000  # blocks
MOST_TICKS = 1.5  # from row to row in the mean, of a log that shows most ticks of its source
SPANS = 10  # of rows with sure ticks, over which the period shows better
STEADIED = 32  # blocks on either side that show the phase of clocks that drift apart
DRIFT = 10.0  # times the noise of that phase
FURTHER = np.arange(-8.0, 9.0)[:, None]  # ticks that the whole log may have, at first
SEARCHED, REPEATS = 30_000, 3  # rows at most of a log in which they are tried; passes with them
PASSES = 3  # in which the most likely sequence is sought
STILL = 0.01  # of the usual way of a tick: so slow is a source that stands
SHORT = 3.0  # ticks between two rows that need none in between
HUBER = 2.0  # medians of what a line leaves, from where its points count less
_REWEIGHTED = 10


class _Source(NamedTuple):
    """A regular source behind stamps of arrival."""

    period: float  # [s]
    start: Array  # (F,) [ticks] time of tick 0, as it is when each row with new values arrives
    ticks: Array  # (F,) of these rows
    sigma: float  # [s] standard deviation of a row's time about its tick, by the values
    usual: float  # ticks from one set of values to the next


def _source(arrival: Array, values: Array) -> _Source | None:
    """The source of rows with new values; None where the stamps fit better than whole ticks.

    arrival : (F,) [s]. values : (C, F).
    """
    period, links = links_of(arrival, values)
    left = _left(arrival, links, period)
    if left is None:
        return None
    count, sure, _, usual = links
    ticks = np.concatenate(([0.0], np.cumsum(np.where(sure, count, usual))))
    period = _refined(arrival, ticks, sure, period)
    period, phase, prompt, block = _blocks(arrival, ticks, period)
    start = np.interp(np.arange(arrival.size), prompt, _starts(phase))
    ticks += missed_ticks(arrival / period - start - ticks, sure, block)
    period, ticks = _settled(arrival, values, ticks, period, block, links)
    if np.mean(np.diff(ticks) <= 0.0) > SHARE:  # rows of one tick: more than one source
        return None
    period, start = _line(arrival, ticks, period, block)
    return _Source(period, start, ticks, period * float(np.sqrt(0.5 * np.mean(left**2))), usual)


def _left(arrival: Array, links: TickLinks, period: float) -> Array | None:
    """(K,) [ticks] how far sure links are from whole ticks; None where the stamps are as good."""
    count, sure, progress, _ = links
    every = slice(None, None, 1 + sure.size // SAMPLE)
    known, shown = sure[every], progress[every]
    if np.count_nonzero(sure) < max(FEWEST, FEW * sure.size) or not known.any():
        return None
    left = np.abs(shown - count[every])[known]
    stamped = np.abs((arrival[1:][every] - arrival[:-1][every]) / period - shown)[known]
    irregular = np.mean(stamped > IRREGULAR) >= SHARE
    return left if irregular and left.mean() <= BETTER * stamped.mean() else None


def _promptest(late: Array, block: int) -> Rows:
    """(B,) rows of the least delays late (F,) of each block of rows; fewer rows at the end go."""
    first = block * np.arange(max(1, late.size // block))
    blocks = late[: first.size * block].reshape(first.size, -1)
    return np.asarray(first + blocks.argmin(axis=1))


def _refined(arrival: Array, ticks: Array, sure: Mask, period: float) -> float:
    """[s] period by arrivals (F,) [s] of prompt rows over ticks (F,), where these are all sure.

    It is the median slope over the longest spans in which they are.
    """
    prompt = _promptest(arrival - period * ticks, min(BLOCK, arrival.size // 8))
    unsure, t, n = np.concatenate(([0], np.cumsum(~sure)))[prompt], arrival[prompt], ticks[prompt]
    span, whole = prompt.size // 2, np.zeros(0, dtype=np.intp)
    while span and whole.size < SPANS:
        whole = np.flatnonzero(unsure[span:] == unsure[:-span])
        slope = (t[whole + span] - t[whole]) / (n[whole + span] - n[whole])
        span //= 2
    return float(np.median(slope)) if whole.size else period


def _blocks(arrival: Array, ticks: Array, period: float) -> tuple[float, Array, Rows, int]:
    """[s] period, (B,) [ticks] phases and rows of the promptest rows of blocks, and their length.

    arrival : (F,) [s]. ticks : (F,) right up to whole numbers.
    """
    block, coarse = max(BLOCK, arrival.size // MOST), period
    late = arrival - coarse * ticks
    prompt = _promptest(late, block)
    while True:
        period = coarse
        t, n, lag = arrival[prompt], ticks[prompt], 1
        while lag <= prompt.size // 2:
            apart = n[lag:] - n[:-lag]
            off = t[lag:] - t[:-lag] - apart * period
            period += float(np.median((off - period * np.rint(off / period)) / apart))
            lag *= 2
        phase = t / period - n
        step = np.diff(phase)
        noise = robust_sigma(step - np.rint(step)) / np.sqrt(2.0)
        if noise < STEADY or prompt.size < 2 * STEADIED:
            if noise >= STEADY:  # the phases do not tell whole ticks
                period, phase = coarse, t / coarse - n
            period *= 1.0 + _tilt(n, _off(phase))
            return period, t / period - n, prompt, block
        block, prompt = 2 * block, prompt[_promptest(late[prompt], 2)]


def _off(phase: Array) -> Array:
    """(B,) [ticks] phases (B,) from their mean direction, up to whole numbers."""
    off = phase - np.angle(np.exp(2j * np.pi * phase).mean()) / (2.0 * np.pi)
    return np.asarray(off - np.rint(off))


def _tilt(ticks: Array, off: Array) -> float:
    """Slope of phases off (B,), about zero, over ticks (B,): a robust line."""
    columns, weight = np.stack((np.ones(ticks.size), ticks - ticks.mean())), np.ones(ticks.size)
    for _ in range(_REWEIGHTED):
        line = np.linalg.solve((columns * weight) @ columns.T, (columns * weight) @ off)
        left = np.abs(off - line @ columns)
        weight = 1.0 / np.maximum(1.0, left / (HUBER * np.median(left) + 1e-9))
    return float(line[1])


def _line(arrival: Array, ticks: Array, period: float, block: int) -> tuple[float, Array]:
    """[s] period and (F,) [ticks] start of the source by the promptest rows of blocks.

    The period is by their means where these lie closer to a line. arrival : (F,) [s]. ticks : (F,).
    period : [s] about.
    """
    late = arrival / period - ticks
    prompt = _promptest(late, block)
    means = late[: prompt.size * block].reshape(prompt.size, -1).mean(axis=1)
    lines = []
    for delays in (late[prompt], means):
        slope = _tilt(ticks[prompt], delays - np.median(delays))
        left = delays - slope * ticks[prompt]
        lines.append((float(robust_sigma(left - np.median(left))), slope))
    period *= 1.0 + min(lines)[1]
    period *= 1.0 + _tilt(ticks[prompt], _off(arrival[prompt] / period - ticks[prompt]))
    phase = arrival[prompt] / period - ticks[prompt]
    return period, np.interp(np.arange(ticks.size), prompt, _starts(phase))


def _starts(phase: Array) -> Array:
    """(B,) [ticks] smooth phase of the source against the clock, from those of prompt rows (B,).

    A constant, unless clocks that drift apart move it by more than it scatters.
    """
    turn = np.exp(2j * np.pi * phase)
    centre = np.angle(turn.mean()) / (2.0 * np.pi)
    off = phase - centre - np.rint(phase - centre)
    usual = centre + float(np.median(off))
    sums = np.concatenate(([0.0], np.cumsum(turn)))
    first = np.clip(np.arange(phase.size) - STEADIED, 0, None)
    stop = np.clip(np.arange(phase.size) + STEADIED + 1, None, phase.size)
    moving = np.unwrap(np.angle((sums[stop] - sums[first]) / turn.mean())) / (2.0 * np.pi)
    noise = robust_sigma(off - (usual - centre)) / np.sqrt(2.0 * STEADIED)
    drifts = np.ptp(moving) > DRIFT * noise and phase.size > 4 * STEADIED
    return usual + moving if drifts else np.full(phase.size, usual)


def _settled(
    arrival: Array, values: Array, ticks: Array, period: float, block: int, links: TickLinks
) -> tuple[float, Array]:
    """[s] period and (F,) ticks of the most likely sequence.

    arrival : (F,) [s]. values : (C, F). ticks : (F,) about. block : rows among which one is hardly
    late. Each pass looks at some ticks on either side of what the one before has found. Where rests
    leave many links unsure, the period depends on how they are counted: the first pass tries some
    ticks more and less in the whole log.
    """
    for turn in range(PASSES):
        _, sure, progress, usual = links
        period, start = _line(arrival, ticks, period, block)
        late, share = arrival / period - start - ticks, ticks / ticks[-1] - 0.5
        count, link = np.diff(ticks), np.flatnonzero(~sure)
        if not link.size:
            break
        sigma = links_sigma(values, count, sure, np.abs(progress - count))
        search = not turn and sure.mean() <= ENOUGH and late.size <= SEARCHED
        further = FURTHER if search else np.zeros((1, 1))
        first = np.concatenate(([0], link + 1))
        begun = np.rint(further * share[first])  # of the rows from one such link to the next
        more = np.repeat(begun, np.diff(first, append=late.size), axis=1)  # (K, F)
        for _ in range(REPEATS if search else 1):
            counts, delay = (count + np.diff(more))[:, link], late + further * share - more
            change, cost = likeliest_ticks(delay, link, counts, progress[link], sigma, usual)
            more += change
        best = int(cost.argmin())
        ticks, period = ticks + more[best], period * (1.0 - float(further[best, 0]) / ticks[-1])
        if sure.mean() > ENOUGH or not more[best].any():
            break
        links = counted(values, np.clip(np.diff(ticks), 1.0, LONGEST))._replace(usual=usual)
    return period, ticks


class _Times(NamedTuple):
    """Times of the rows of one stretch of a log."""

    row: Rows  # (K,) those with new values, and those in which the source stands
    time: Array  # (K,) [s]
    period: float  # [s]
    sigma: float  # [s] of a time
    latest: float  # [s] the longest delay, against the usual one
    torn: Rows  # those in which some values were new and some were not


def _times(arrival: Array, channels: Sequence[Array]) -> _Times | None:
    """The times of the rows of one stretch; None where its stamps stay.

    arrival : (N,) [s]. channels : (N,) each.
    """
    fresh, torn = whole_and_torn_rows(channels)
    if fresh.size < FEWEST or arrival[-1] == 0.0 or not _irregular(np.diff(arrival[fresh])):
        return None
    new, at = scaled(channels, fresh), arrival[fresh] if fresh.size < arrival.size else arrival
    if not len(new) or (source := _source(at, new)) is None:
        return None
    period, start, ticks, sigma, each = source
    forward = np.concatenate(([True], ticks[1:] > np.maximum.accumulate(ticks)[:-1]))
    if not forward.all():
        fresh, new = fresh[forward], new[:, forward]
        ticks, start, at = (column[forward] for column in (ticks, start, at))
    late = at - (start + ticks) * period
    row, tick = _with_standing(fresh, ticks, new, arrival, period)
    delays = np.sort(late[:: 1 + late.size // MANY])
    usual = float(delays[delays.size // 10 : delays.size - delays.size // 10].mean())
    time = (np.interp(tick, ticks, start) + tick) * period + usual
    return _Times(row, time, each * period, sigma, float(late.max()) - usual, torn)


def _irregular(step: Array) -> bool:
    """Whether steps (K,) differ from each other as those of no device's clock do."""
    step = step[:: 1 + step.size // SAMPLE]
    usual = float(np.median(step))
    return bool(np.mean(np.abs(step - usual) > IRREGULAR * usual) > SHARE)


def _with_standing(
    fresh: Rows, ticks: Array, new: Array, arrival: Array, period: float
) -> tuple[Rows, Array]:
    """Rows (K,) that are measurements, and their ticks (K,).

    They are those with new values: fresh (F,) with their ticks (F,) and values (C, F). Repeated
    values are too where the source stands, as many as it has ticks. arrival : (N,) [s].
    """
    after = np.floor((arrival[-1] - arrival[fresh[-1]]) / period)
    passed = np.append(np.diff(ticks), after + 1.0)
    repeats = np.diff(fresh, append=arrival.size) - 1
    if not repeats.any():
        return fresh, ticks
    way = np.append(np.sqrt((np.diff(new) ** 2).sum(axis=0)), 0.0) / passed
    count = np.minimum(repeats, passed - 1.0).astype(np.intp)
    count[(way > STILL * np.quantile(way, 0.9)) | (passed <= SHORT)] = 0
    link = np.repeat(np.arange(fresh.size), count)
    place = np.arange(link.size) - np.repeat(np.cumsum(count) - count, count) + 1
    row = fresh[link] + place * repeats[link] // np.maximum(1, count[link])
    tick = ticks[link] + place * passed[link] / (count[link] + 1.0)
    order = np.argsort(row := np.concatenate((fresh, row)), kind="stable")
    return row[order], np.concatenate((ticks, tick))[order]


def with_source_times(table: Table, names: Sequence[str]) -> Table:
    """The table with the source's times in place of stamps of arrival, without held values.

    names : columns of the values that the source measures. Each start of the logger, and each
    stamp that goes back, begins a stretch with a line of its own.
    """
    stamps = table.columns[STAMP]
    if len(table) < FEWEST or not names:
        return table
    values = [_continuous(table.columns[name]) for name in names]
    cuts = np.flatnonzero((np.diff(stamps) < 0) | table.begins[1:]) + 1
    used, moved, stretches = np.ones(stamps.size, dtype=bool), stamps.copy(), list[_Times]()
    torn = list[int]()
    for first, stop in pairwise([0, *cuts.tolist(), stamps.size]):
        arrival = (stamps[first:stop] - stamps[first]) * 1e-9
        with np.errstate(all="ignore"):  # of damaged values
            times = _times(arrival, [channel[first:stop] for channel in values])
        if times is not None:
            used[first:stop] = False
            used[first + times.row] = True
            moved[first + times.row] = stamps[first] + np.rint(times.time * 1e9).astype(np.int64)
            stretches.append(times)
            torn.extend((first + times.torn).tolist())
    if not stretches:
        return table
    period, sigma = (
        float(np.median([getattr(t, n) for t in stretches])) for n in ("period", "sigma")
    )
    sentence = (
        f"rows came up to {amount(max(t.latest for t in stretches))} late, from a source with new "
        f"values every {amount(period)}; each has the time of the source's tick (standard "
        f"deviation {amount(sigma)}). The usual delay, a mean without the longest and the shortest "
        "tenth, is part of the clock offset."
    )
    count = sum(t.row.size for t in stretches)
    table = table.remarked(ARRIVAL, sentence, count=count)
    if torn:
        sentence = "some values were renewed when it was read, and some not yet; left out."
        table = table.remarked("torn row", sentence, rows=np.array(torn))
    held = ~used
    held[torn] = False
    if held.any():
        sentence = "the row before again, before the source had new values: held; left out."
        table = table.remarked("held values", sentence, rows=np.flatnonzero(held))
    return replace(table, columns={**table.columns, STAMP: moved}).take(used)


def of_one_source(table: Table) -> bool:
    """Whether the stamps were of arrival and the rows show most ticks of one source.

    Pairs of rows with many ticks between one and the next may be of two.
    """
    step = np.diff(table.columns[STAMP])
    undone = any(entry.kind == ARRIVAL for entry in table.findings)
    usual = float(np.quantile(step[:: 1 + step.size // SAMPLE], 0.1))
    return undone and float(step.mean()) < MOST_TICKS * usual


def _continuous(column: NDArray[Any]) -> Array:
    """(N,) values of a column, of a counter's words (N,) without wraps."""
    if column.dtype.kind != "i":
        return column
    step = np.diff(column).astype(np.int32)  # the low 32 bits, signed
    return np.concatenate(([0.0], np.cumsum(step, dtype=np.float64)))
