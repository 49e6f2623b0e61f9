"""Most likely ticks of the rows between which the values alone do not tell them.

Delays are about exponential, those of neighbours are not independent, and hardly any row arrives
before its tick. Two rows have one tick only where the values say so: a source that was read while
it renewed its values. The sequence is found by dynamic programming (Viterbi 1967).
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.neighbours import Mask, Rows, robust_sigma

CHANGES = 3  # ticks by which it may differ from that of the pass before
EARLY = 0.15  # [ticks] standard deviation of an arrival before its tick
TOGETHER, LEAST_DELAY = 4.0, 0.2  # rows that are late together; [ticks] of the usual delay
SIGMA, UNEVEN = 0.1, 0.3  # [ticks] of a link by its values, at least; where the speed changes
TORN, SEEN = 0.5, 0.25  # [ticks] of a link of two rows of one tick, and how well it has to be known
WORST, MISSED = 12.0, 4.0  # cost of a link that its values contradict; of a tick that no row shows
IMPOSSIBLE = 1e6  # cost of rows whose order their ticks contradict
WINDOW = 5  # links on either side, whose speeds show whether it changes
SAMPLE, EDGES = 5000, np.arange(-2.0, 2.1, 0.125).tolist()  # rows; [ticks]
AHEAD = 4  # blocks with a row that is hardly late, by all odds
_CHUNK, _TINY = 256, 1e-9


def links_sigma(values: Array, count: Array, sure: Mask, off: Array) -> Array:
    """(L,) [ticks] standard deviation of the progress of links that are not sure, by their values.

    values : (C, F). count, sure, off : (F-1,) of all links: ticks, whether these are sure, and how
    far the progress is from them. Noise counts against the way of the rows around: at rest they
    tell nothing. Where the speed changes within few rows, its mean about a link is not that in it.
    """
    link, clock = np.flatnonzero(~sure), np.concatenate(([0.0], np.cumsum(count)))

    def speed(first: Rows, last: Rows) -> Array:
        net = np.sqrt(((values[:, last] - values[:, first]) ** 2).sum(axis=0))
        return np.asarray(net / np.maximum(1.0, clock[last] - clock[first]))

    known = np.flatnonzero(sure[:: 1 + sure.size // SAMPLE]) * (1 + sure.size // SAMPLE)
    scatter = robust_sigma(off[known] * speed(known, known + 1)) if known.size else 1.0
    first, last = np.maximum(link - WINDOW, 0), np.minimum(link + 1 + WINDOW, sure.size)
    before, after = speed(first, link), speed(link + 1, last)
    uneven = np.abs(after - before) / np.maximum(after + before, _TINY)
    by_noise = scatter / np.maximum(speed(first, last), _TINY)
    return np.asarray(np.sqrt(by_noise**2 + SIGMA**2 + (UNEVEN * uneven) ** 2))


def likeliest_ticks(
    late: Array, link: Rows, count: Array, progress: Array, sigma: Array, usual: float = 1.0
) -> tuple[Array, Array]:
    """(K, F) whole ticks by which rows most likely differ from each of K counts (Viterbi 1967).

    Second: (K,) cost of these. Delays are about exponential, and neighbours late together; an
    arrival before its tick is hardly possible. Two rows have one tick only where the values say so.

    late : (K, F) [ticks] of arrivals after the counted ticks. link : (L,) links that are not sure.
    count : (K, L) ticks of these as counted. progress, sigma : (L,) by their values.
    usual : ticks of a link.
    """
    change = np.arange(-CHANGES, CHANGES + 1.0)
    first = np.concatenate(([0], link + 1))
    cost = np.stack([_delay_costs(row, change, first) for row in late], axis=1)  # (L+1, K, S)
    fewest = np.where((sigma < SEEN) & (progress < TORN), 0.0, 1.0)
    apart = change - change[:, None]  # (S before, S)
    best, came = cost[0], np.empty((link.size, len(late), change.size), dtype=np.intp)  # (K, S)
    for begin in range(0, link.size, _CHUNK):
        part = np.s_[begin : begin + _CHUNK, None, None, None]
        n = count.T[begin : begin + _CHUNK, :, None, None] + apart
        off = (progress[part] - n) / sigma[part]
        step = np.minimum(0.5 * off * off, WORST) + np.minimum(MISSED * np.abs(n - usual), WORST)
        step[n < fewest[part]] = IMPOSSIBLE
        for k, steps in enumerate(step, begin):
            total = best[:, :, None] + steps
            came[k] = total.argmin(axis=1)
            best = total.min(axis=1) + cost[k + 1]
    state, each = np.empty((link.size + 1, len(late)), dtype=np.intp), np.arange(len(late))
    state[-1] = best.argmin(axis=1)
    for k in range(link.size - 1, -1, -1):
        state[k] = came[k, each, state[k + 1]]
    lengths = np.diff(first, append=late.shape[1])
    return np.repeat(change[state], lengths, axis=0).T, best.min(axis=1)


def _delay_costs(late: Array, change: Array, first: Rows) -> Array:
    """(L+1, S) costs of rows that are late (F,) [ticks], summed from each row `first` (L+1,) on.

    change : (S,) by which their ticks differ. The earliest possible arrival is put where all rows
    together cost least, so that a shift of all of them gains nothing.
    """
    sample = late[:: 1 + late.size // SAMPLE]
    edge = min(EDGES, key=lambda edge: _exponential(sample - edge))
    mean = TOGETHER * max(float((sample - edge).mean()), LEAST_DELAY)
    rows = np.diff(first, append=late.size)[:, None]
    cost = (np.add.reduceat(late, first)[:, None] - rows * (edge + change)) / mean
    cost += rows * np.log(mean) / TOGETHER
    prompt = np.flatnonzero(late < edge + CHANGES)  # the others are late whatever their tick
    early = np.minimum(late[prompt, None] - edge - change, 0.0)
    early = 0.5 * (early / EARLY) ** 2 - early / mean
    piece = np.searchsorted(first, prompt, side="right") - 1
    cost += np.stack([np.bincount(piece, k, minlength=first.size) for k in early.T], axis=1)
    return np.asarray(cost)


def _exponential(delay: Array) -> float:
    """Cost of delays (K,) [ticks] with an exponential distribution of their own mean."""
    mean = max(float(delay.mean()), LEAST_DELAY)
    early = 0.5 * (np.minimum(delay, 0.0) / EARLY) ** 2
    return float((early + (np.maximum(delay, 0.0) / mean + np.log(mean)) / TOGETHER).sum())


def missed_ticks(late: Array, sure: Mask, block: int) -> Array:
    """(F,) ticks that the rows have beyond those that were counted.

    They are as many as none of the next rows contradicts by an arrival before its tick.
    late : (F,) [ticks] of the arrivals after the ticks that were counted.
    """
    from scipy.ndimage import minimum_filter1d  # noqa: PLC0415  slow to import, and rarely needed

    first = np.flatnonzero(np.concatenate(([True], ~sure)))
    blocks = np.append(late, np.full(-late.size % block, np.inf)).reshape(-1, block)
    least = np.minimum.accumulate(blocks[:, ::-1], axis=1)[:, ::-1]  # from a row to its block's end
    further = minimum_filter1d(least[:, 0], 2 * AHEAD, origin=-AHEAD, mode="nearest")
    ahead = further[np.minimum(first // block + 1, further.size - 1)]
    missed = np.floor(np.minimum(least.ravel()[first], ahead) + 0.5)
    return np.repeat(missed, np.diff(first, append=late.size))
