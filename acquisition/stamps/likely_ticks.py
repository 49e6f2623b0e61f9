"""Most likely ticks of the rows between which the values alone do not tell them.

Delays are about exponential, those of neighbours are not independent, and hardly any row arrives
before its tick. Two rows have one tick only where the values say so: a source that was read while
it renewed its values. The sequence is found by dynamic programming (Viterbi 1967).
"""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.neighbours import Mask, Rows

CHANGES = 3  # ticks by which it may differ from that of the pass before
EARLY = 0.15  # [ticks] standard deviation of an arrival before its tick
TOGETHER, LEAST_DELAY = 4.0, 0.2  # rows that are late together; [ticks] of the usual delay
SIGMA, UNEVEN = 0.1, 0.3  # [ticks] of a link by its values, at least; where the speed changes
TORN, SEEN = 0.5, 0.25  # [ticks] of a link of two rows of one tick, and how well it has to be known
SCATTER = 1.4826  # standard deviation over the median of absolute values
WORST, MISSED = 12.0, 4.0  # cost of a link that its values contradict; of a tick that no row shows
WINDOW = 5  # links on either side, whose speeds show whether it changes
_CHUNK, _TINY = 4096, 1e-9


def links_sigma(values: Array, count: Array, sure: Mask, off: Array) -> Array:
    """(L,) [ticks] standard deviation of the progress of links that are not sure, by their values.

    values : (C, F). count, sure, off : (F-1,) of all links: ticks, whether these are sure, and how
    far the progress is from them. Where the speed changes within few rows, its mean about a
    link is not the speed in it.
    """
    link = np.flatnonzero(~sure)
    way = np.sqrt((np.diff(values) ** 2).sum(axis=0)) / np.maximum(1.0, count)
    scatter = SCATTER * float(np.median((off * way)[sure])) if sure.any() else 1.0
    sums = np.concatenate(([0.0], np.cumsum(way)))
    behind = sums[link] - sums[np.maximum(link - WINDOW, 0)]
    ahead = sums[np.minimum(link + 1 + WINDOW, way.size)] - sums[link + 1]
    uneven = np.abs(ahead - behind) / np.maximum(ahead + behind, _TINY)
    by_noise = scatter / np.maximum(way[link], _TINY)
    return np.asarray(np.sqrt(by_noise**2 + SIGMA**2 + (UNEVEN * uneven) ** 2))


def likeliest_ticks(late: Array, link: Rows, count: Array, progress: Array, sigma: Array) -> Array:
    """(F,) whole ticks by which rows most likely differ from what was counted (Viterbi 1967).

    Delays are about exponential, and neighbours late together; an arrival before its tick is hardly
    possible. Two rows have one tick only where the values say so.

    late : (F,) [ticks] of arrivals after the counted ticks. link : (L,) links that are not sure.
    count, progress, sigma : (L,) ticks of these as counted and by their values.
    """
    change = np.arange(-CHANGES, CHANGES + 1.0)
    delay = late[:, None] - change
    cost = np.where(delay < 0.0, 0.5 * (delay / EARLY) ** 2, 0.0)
    cost += np.maximum(delay, 0.0) / (TOGETHER * max(float(late.mean()), LEAST_DELAY))
    first = np.concatenate(([0], link + 1))
    cost = np.add.reduceat(cost, first, axis=0)  # (L+1, S) of the rows between two such links
    fewest = np.where((sigma < SEEN) & (progress < TORN), 0.0, 1.0)
    apart = change - change[:, None]  # (S before, S)
    best, came = cost[0], np.empty((link.size, change.size), dtype=np.intp)
    each = np.arange(change.size)
    for begin in range(0, link.size, _CHUNK):
        part = np.s_[begin : begin + _CHUNK, None, None]
        n = count[part] + apart
        off = (progress[part] - n) / sigma[part]
        step = np.minimum(0.5 * off * off, WORST) + MISSED * np.abs(n - 1.0)
        step[n < fewest[part]] = np.inf
        for k, steps in enumerate(step, begin):
            total = best[:, None] + steps
            came[k] = total.argmin(axis=0)
            best = total[came[k], each] + cost[k + 1]
    state = np.full(link.size + 1, best.argmin())
    for k in range(link.size - 1, -1, -1):
        state[k] = came[k, state[k + 1]]
    return np.repeat(change[state], np.diff(first, append=late.size))
