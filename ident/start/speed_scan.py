"""All clock offsets at once: speeds of channels of one log against those of another.

Two recorders of one motion see speeds that differ by a gain, whatever the units, directions and
zeros of their channels: `v_a(t + lag) = gain v_b(t)`. At each lag the gain that fits best follows
from three sums over the overlap, which a few FFTs give for all lags. Three channels that are a
vector in each log differ by a rotation too, `v_a(t + lag) = gain R v_b(t)`: what the best rotation
explains is the sum of the singular values of the (3, 3) correlation, the last one with the sign of
its determinant (Kabsch 1976). A pair's score is the overlap
times the log-likelihood gain over speeds of zero, mean of both directions: dwell against dwell
scores nothing, and neither does a long motion against a dwell.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.ident.start.lag_scan import LagScan, lag_sums

Columns = int | tuple[int, ...]  # of one channel, or of a vector

# Share of a channel's rms speed that another kind of recorder explains at best; floor of variances.
SPEED_SIGMA = 0.01


def scan_speeds(
    a: Array, b: Array, pairs: Sequence[tuple[Columns, Columns]], *, least: int, paired: bool
) -> LagScan:
    """Score of every lag; `t_a = lag * step + t_b` on the two even grids.

    a : (Na, Ca), b : (Nb, Cb) speeds, each channel over its rms [-]. pairs : columns of a and b,
    single ones or those of vectors.
    least : [samples] that must overlap. paired : whether all pairs count; otherwise the best one of
    each column of a.
    """
    lags = np.arange(-(len(b) - 1), len(a))
    overlap = np.minimum(len(a), lags + len(b)) - np.maximum(0, lags)
    usable = overlap >= least
    best: dict[Columns, Array] = {}
    for number, (i, j) in enumerate(pairs):
        of_a, of_b = (x[:, np.atleast_1d(c)] for x, c in ((a, i), (b, j)))
        gain = _gain(of_a, of_b, np.maximum(overlap, 1))
        key = number if paired else i
        best[key] = np.maximum(best[key], gain) if key in best else gain
    score = overlap * np.asarray(sum(best.values()))
    score[~usable] = -np.inf
    return LagScan(lags, score, overlap)


def speed_correlation(
    a: Array,
    b: Array,
    pairs: Sequence[tuple[Columns, Columns]],
    lag: int,
    *,
    window: int,
    mean_of: int = 1,
) -> Array:
    """(pairs,) size of the correlation about zero of speeds at one lag [samples].

    a, b, pairs : as in `scan_speeds`. window : [samples]. Clocks that drift apart agree at one lag
    for a while only, so the largest correlation of a window is given.
    mean_of : [samples]; the speeds and their moving means, in which noise is less, are compared.
    """
    if mean_of > 1:
        from scipy.ndimage import uniform_filter1d  # noqa: PLC0415  slow to import, and rarely needed

        mean = [uniform_filter1d(x, mean_of, axis=0) for x in (a, b)]
        averaged = speed_correlation(mean[0], mean[1], pairs, lag, window=window)
        return np.maximum(averaged, speed_correlation(a, b, pairs, lag, window=window))
    first, last = max(0, -lag), min(len(b), len(a) - lag)
    best = np.zeros(len(pairs))
    for rows in np.array_split(np.arange(first, last), max(1, (last - first) // window)):
        of_a, of_b = a[rows + lag], b[rows]
        power_a, power_b, product = (of_a**2).sum(axis=0), (of_b**2).sum(axis=0), of_a.T @ of_b
        for k, (i, j) in enumerate(pairs):
            own, other = np.atleast_1d(i), np.atleast_1d(j)
            power = max(float(power_a[own].sum() * power_b[other].sum()), np.finfo(float).tiny)
            best[k] = max(best[k], float(_explained(product[np.ix_(own, other)])) / np.sqrt(power))
    return best


def likely_pairs(correlation: Array, least: float) -> list[tuple[int, int]]:
    """Columns of a and b that go together: strongest correlation first, each column once.

    correlation : (Ca, Cb) [-]. least : its size [-] below which columns remain alone.
    """
    size, pairs = np.abs(correlation), list[tuple[int, int]]()
    while size.size and size.max() >= least:
        i, j = (int(k) for k in np.unravel_index(int(np.argmax(size)), size.shape))
        pairs.append((i, j))
        size[i], size[:, j] = -1.0, -1.0
    return sorted(pairs)


def _explained(product: Array) -> Array:
    """Largest trace of `R' product` (..., d, d) over rotations R, or over signs of one channel."""
    if product.shape[-1] == 1:
        return np.asarray(np.abs(product[..., 0, 0]))
    values = np.linalg.svd(product, compute_uv=False)
    return np.asarray(
        values[..., :2].sum(axis=-1) + np.sign(np.linalg.det(product)) * values[..., 2]
    )


def _gain(a: Array, b: Array, overlap: NDArray[np.intp]) -> Array:
    """(L,) log-likelihood gain a sample of one pair, a (Na, d) and b (Nb, d), at every lag."""
    products = [[lag_sums(y, x) for y in b.T] for x in a.T]
    product = _explained(np.moveaxis(np.array(products), 2, 0))
    power_a, power_b = (a * a).sum(axis=1), (b * b).sum(axis=1)
    power_a = lag_sums(np.ones_like(power_b), power_a)
    power_b = lag_sums(power_b, np.ones(len(a)))
    both = power_a * power_b
    explained = np.where(both > 0.0, product * product / np.where(both > 0.0, both, 1.0), 0.0)
    left, floor = 1.0 - np.clip(explained, 0.0, 1.0), SPEED_SIGMA**2
    each = [
        np.log((power / overlap + floor) / (left * power / overlap + floor))
        for power in (np.maximum(power_a, 0.0), np.maximum(power_b, 0.0))
    ]
    return np.asarray(0.5 * (each[0] + each[1]))
