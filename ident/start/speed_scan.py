"""All clock offsets at once: speeds of channels of one log against those of another.

Two recorders of one motion see speeds that differ by a gain, whatever the units, directions and
zeros of their channels: `v_a(t + lag) = gain v_b(t)`. At each lag the gain that fits best follows
from three sums over the overlap, which a few FFTs give for all lags. A pair's score is the overlap
times the log-likelihood gain over speeds of zero, mean of both directions: dwell against dwell
scores nothing, and neither does a long motion against a dwell.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from ident.start.lag_scan import LagScan, lag_sums

# Share of a channel's rms speed that another kind of recorder explains at best; floor of variances.
SPEED_SIGMA = 0.01


def scan_speeds(
    a: Array, b: Array, pairs: Sequence[tuple[int, int]], *, least: int, paired: bool
) -> LagScan:
    """Score of every lag; `t_a = lag * step + t_b` on the two even grids.

    a : (Na, Ca), b : (Nb, Cb) speeds, each channel over its rms. pairs : columns of a and b.
    least : samples that must overlap. paired : whether all pairs count; otherwise the best one of
    each column of a.
    """
    lags = np.arange(-(len(b) - 1), len(a))
    overlap = np.minimum(len(a), lags + len(b)) - np.maximum(0, lags)
    usable = overlap >= least
    best: dict[int, Array] = {}
    for number, (i, j) in enumerate(pairs):
        gain = _gain(a[:, i], b[:, j], np.maximum(overlap, 1))
        key = number if paired else i
        best[key] = np.maximum(best[key], gain) if key in best else gain
    score = overlap * np.asarray(sum(best.values()))
    score[~usable] = -np.inf
    return LagScan(lags, score, overlap)


def speed_correlation(a: Array, b: Array, lag: int, window: int) -> Array:
    """(Ca, Cb) correlation about zero of speeds a (Na, Ca) and b (Nb, Cb), at one lag [samples].

    window : samples. Clocks that drift apart agree at one lag for a while only, so the largest
    correlation of a window is given.
    """
    first, last = max(0, -lag), min(len(b), len(a) - lag)
    best = np.zeros((a.shape[1], b.shape[1]))
    for rows in np.array_split(np.arange(first, last), max(1, (last - first) // window)):
        of_a, of_b = a[rows + lag], b[rows]
        power = np.outer((of_a**2).sum(axis=0), (of_b**2).sum(axis=0))
        correlation = of_a.T @ of_b / np.sqrt(np.where(power > 0.0, power, 1.0))
        best = np.where(np.abs(correlation) > np.abs(best), correlation, best)
    return best


def likely_pairs(correlation: Array, least: float) -> list[tuple[int, int]]:
    """Columns of a and b that go together: strongest correlation first, each column once.

    correlation : (Ca, Cb). least : size of a correlation below which columns remain alone.
    """
    size, pairs = np.abs(correlation), list[tuple[int, int]]()
    while size.size and size.max() >= least:
        i, j = (int(k) for k in np.unravel_index(int(np.argmax(size)), size.shape))
        pairs.append((i, j))
        size[i], size[:, j] = -1.0, -1.0
    return sorted(pairs)


def _gain(a: Array, b: Array, overlap: NDArray[np.intp]) -> Array:
    """(L,) log-likelihood gain a sample of one pair at every lag."""
    product = lag_sums(b, a)
    power_a, power_b = lag_sums(np.ones_like(b), a * a), lag_sums(b * b, np.ones_like(a))
    both = power_a * power_b
    explained = np.where(both > 0.0, product * product / np.where(both > 0.0, both, 1.0), 0.0)
    left, floor = 1.0 - np.clip(explained, 0.0, 1.0), SPEED_SIGMA**2
    each = [
        np.log((power / overlap + floor) / (left * power / overlap + floor))
        for power in (np.maximum(power_a, 0.0), np.maximum(power_b, 0.0))
    ]
    return np.asarray(0.5 * (each[0] + each[1]))
