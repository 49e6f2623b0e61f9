"""Single damaged values: their neighbours lie on one cubic, and they do not.

A value is looked at where it stands out of its two neighbours on either side, and judged by eight rows around it. A second damaged
value among the eight would spoil their cubic, so values that stand out close to each other are also judged two at a time. A kink or
a step in the motion leaves the eight on no cubic, and nothing is concluded.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

SMALLEST = 5e-5  # [rad] a value that deviates by less may stay: it is within a few times the noise of every sensor of the cell
FAR_OUT = 6.0  # standard deviations: of a million values of white noise 0.002 are further out
NORMAL_MEDIAN = 0.6745  # median of |x| over its standard deviation, for normal x
_NOTABLE = 3.5  # standard deviations by which two neighbours on either side must miss a value for it to be judged
_CLEAR = 5.0  # standard deviations that a million values of white noise do not reach
_BESIDE = 8  # rows that judge
_REACH = 15.0  # row periods: nine rows further apart than these say nothing of each other
_CLOSE = _BESIDE  # rows: two damaged values so close may spoil each other's cubic; at the end of a log all that judge are on one side
_MANY, _MANY_OF = (
    1000,
    0.02,
)  # values, and of all values: where more stand out, steps or grains stand out, not two that hide each other
_BLOCK = 8192  # rows at a time, for the processor's cache
_SAMPLE = 2000  # rows, whose median tells the noise to 3 %


class _Log(NamedTuple):
    """What is judged, and what it is judged by."""

    t: Array  # (N,) [s]
    values: Array  # (N, C) [rad]
    firsts: Rows  # (S,) first row of each stretch
    lasts: Rows  # (S,) last row of each
    sigma: Array  # (C,) [rad] noise
    longest: float  # [s] that nine rows may span


class _Places(NamedTuple):
    """Values that stand out."""

    row: Rows  # (K,)
    channel: Rows  # (K,)
    size: Array  # (K,) how far, in the noise of one value; 0 at the ends of a stretch, where all are judged


def damaged_values(t: Array, values: Array, breaks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N, C) single values that their neighbours contradict.

    t : (N,) [s]. values : (N, C) [rad]. breaks : (N,) rows at which a new stretch begins; no neighbours across them.
    """
    out = np.zeros(values.shape, dtype=bool)
    if t.size <= _BESIDE + 1:
        return out
    firsts = np.flatnonzero(breaks | (np.arange(t.size) == 0))
    lasts = np.append(firsts[1:], t.size) - 1
    log = _Log(t, values, firsts, lasts, _noise(t, values), _REACH * float(np.median(np.diff(t))))
    places = _notable(log)
    many = np.count_nonzero(places.size) > max(_MANY, _MANY_OF * values.size)
    for apart in range(
        1 if many else _CLOSE + 1
    ):  # each by itself, then two that stand 1, 2, ... rows apart
        sets = _sets(places, apart, log)
        if not sets.row.size:
            continue
        for some in np.array_split(np.arange(sets.row.size), sets.row.size // _BLOCK + 1):
            _mark(
                out,
                sets.row[some],
                sets.channel[some],
                _contradicted(log, sets.row[some], sets.channel[some], apart, None),
                apart,
            )
    for _ in range(_CLOSE):
        row, channel = _beside(out)
        if not row.size or not (found := _contradicted(log, row, channel, 0, out)[:, 0]).any():
            break
        out[row[found], channel[found]] = True
    return out


def _noise(t: Array, values: Array) -> Array:
    """(C,) [rad] white noise of each channel."""
    rows = np.arange(2, t.size - 2, 1 + (t.size - 4) // _SAMPLE)
    missed = _missed([t[rows + k - 2] for k in range(5)], [values[rows + k - 2] for k in range(5)])
    return np.asarray(np.median(np.nan_to_num(missed), axis=0) / NORMAL_MEDIAN)


def _missed(times: list[Array], values: list[Array]) -> Array:
    """(N, C) [rad] by how much the cubic through two neighbours on either side misses, scaled to the noise of one value.

    times, values : of five rows each, the middle one of which is judged.
    """
    to = [times[k] - times[2] for k in range(5)]
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # across a clock that was set back two stamps may agree
        error, power = values[2].copy(order="F"), np.ones(times[2].size)
        for k, a, b, c in ((0, 1, 3, 4), (1, 0, 3, 4), (3, 0, 1, 4), (4, 0, 1, 3)):
            weight = to[a] * to[b] * to[c]  # Lagrange's, of row k
            weight /= (to[a] - to[k]) * (to[b] - to[k]) * (to[c] - to[k])
            error -= weight[:, None] * values[k]
            power += weight * weight
        error /= np.sqrt(power)[:, None]
        return np.abs(error, out=error)


def _ends(firsts: Rows, lasts: Rows) -> Rows:
    """Rows at the ends of stretches, which have no two neighbours on either side, or few beside them."""
    near = np.arange(_BESIDE // 2)
    rows = np.concatenate(((firsts[:, None] + near).ravel(), (lasts[:, None] - near).ravel()))
    return np.unique(rows[(rows >= 0) & (rows <= lasts[-1])])


def _notable(log: _Log) -> _Places:
    """What stands out, the largest first, since beside it its neighbours look damaged too; then all ends."""
    t, values, ends = log.t, log.values, _ends(log.firsts, log.lasts)
    threshold = np.maximum(_NOTABLE * log.sigma, 0.5 * SMALLEST)
    rows, channels, sizes = [], [], []
    for begin in range(2, t.size - 2, _BLOCK):
        stop = min(begin + _BLOCK, t.size - 2)
        missed = _missed(
            [t[begin + k - 2 : stop + k - 2] for k in range(5)],
            [values[begin + k - 2 : stop + k - 2] for k in range(5)],
        )
        for k, column in enumerate(missed.T):
            notable = np.flatnonzero(column > threshold[k])
            rows.append(notable + begin)
            channels.append(np.full(notable.size, k))
            sizes.append(column[notable])
    count = values.shape[1]
    row = np.concatenate((*rows, np.repeat(ends, count)))
    channel = np.concatenate((*channels, np.tile(np.arange(count), ends.size)))
    size = np.concatenate((*sizes, np.zeros(ends.size * count)))
    order = np.argsort(-size, kind="stable")
    return _Places(row[order], channel[order], size[order])


def _sets(places: _Places, apart: int, log: _Log) -> _Places:
    """Places that are judged together with the value `apart` rows later, those first that stand out most.

    Both stand out, or one does so clearly: the other may be hidden by it.
    """
    if not apart:
        return places
    count = log.t.size
    known, index = np.unique(
        places.channel * count + places.row, return_index=True
    )  # of the same place the first, which has the size
    size = places.size[index]
    clear = size > np.maximum(_CLEAR * log.sigma, 0.5 * SMALLEST)[known // count]
    both = np.intersect1d(known, known - apart, assume_unique=True)
    pair = np.unique(np.concatenate((both, known[clear], known[clear] - apart)))
    pair = pair[(pair % count + apart < count) & (pair >= 0)]
    together = np.zeros(pair.size)
    for one in (pair, pair + apart):
        at = np.minimum(np.searchsorted(known, one), known.size - 1)
        together += np.where(known[at] == one, size[at], 0.0)
    order = np.argsort(-together, kind="stable")
    return _Places(pair[order] % count, pair[order] // count, together[order])


def _beside(damaged: NDArray[np.bool_]) -> tuple[Rows, Rows]:
    """Rows and channels of the values that a damaged value kept from being judged fairly."""
    if not damaged.any():
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    row, channel = np.nonzero(damaged)
    near = np.zeros_like(damaged)
    for k in range(-_BESIDE // 2, _BESIDE // 2 + 1):
        near[np.clip(row + k, 0, len(damaged) - 1), channel] = True
    rows, channels = np.nonzero(near & ~damaged)
    return rows, channels


def _contradicted(
    log: _Log, row: Rows, channel: Rows, apart: int, damaged: NDArray[np.bool_] | None
) -> NDArray[np.bool_]:
    """(K, 2) whether `row` and `row + apart` are both off the cubic through the rows beside them, and by more than may stay.

    damaged : (N, C) values that do not judge, if any are known; some more rows judge in their place.
    """
    t, firsts, lasts = log.t, log.firsts, log.lasts
    width = min(_BESIDE + 1 + (apart if damaged is None else _BESIDE // 2), t.size)
    stretch = np.searchsorted(firsts, row, side="right") - 1
    begin = np.minimum(
        np.maximum(row - (width - apart) // 2, firsts[stretch]), lasts[stretch] - width + 1
    )
    margin = (
        2 * (apart == 1)
    )  # the last two rows of a log may be the beginning of a motion; good rows between or behind them tell
    inside = (
        (begin >= firsts[stretch])
        & (row - margin >= firsts[stretch])
        & (row + apart + margin <= lasts[stretch])
    )
    window = np.clip(begin, 0, t.size - width)[:, None] + np.arange(width)  # (K, W)
    span = t[window[:, -1]] - t[window[:, 0]]
    inside &= (span > 0.0) & (span < log.longest * width / (_BESIDE + 1))
    judging = (window != row[:, None]) & (window != row[:, None] + apart)
    if damaged is not None:
        judging &= ~damaged[window, channel[:, None]]
        inside &= judging.sum(axis=1) >= _BESIDE
    x = (t[window] - t[row][:, None]) / np.where(span > 0.0, span, 1.0)[:, None]
    basis, full = _orthonormal(x[:, :, None] ** np.arange(4), judging.astype(np.float64))
    y = log.values[window, channel[:, None]]
    y = y - y[np.arange(len(y)), judging.argmax(axis=1)][:, None]
    left = y - np.einsum("kwp,kvp,kv->kw", basis, basis, y * judging)
    spread = np.sqrt((left * left * judging).sum(axis=1) / np.maximum(judging.sum(axis=1) - 4, 1))
    deviation = np.maximum(log.sigma[channel], spread)[:, None] * np.sqrt(
        1.0 + (basis * basis).sum(axis=2)
    )
    judged = np.clip((row - window[:, 0])[:, None] + (0, apart), 0, width - 1)  # (K, 2)
    off = np.take_along_axis(np.abs(left), judged, axis=1)
    far = (off > FAR_OUT * np.take_along_axis(deviation, judged, axis=1)).all(
        axis=1
    )  # both, or it is one of them alone
    return np.asarray((off > SMALLEST) & (far & inside & full)[:, None])


def _orthonormal(columns: Array, weight: Array) -> tuple[Array, NDArray[np.bool_]]:
    """(K, W, P) combinations of the columns (K, W, P) that are orthonormal over the rows of weight 1; (K,) whether there are P.

    At the rows of weight 0 they are the same combinations.
    """
    basis, full = columns.copy(), np.ones(len(columns), dtype=bool)
    for k in range(columns.shape[2]):
        for j in range(k):
            basis[:, :, k] -= (weight * basis[:, :, j] * basis[:, :, k]).sum(axis=1)[
                :, None
            ] * basis[:, :, j]
        norm = np.sqrt((weight * basis[:, :, k] ** 2).sum(axis=1))
        full &= norm > 1e-9  # else the stamps are too few, or all but the same
        basis[:, :, k] /= np.where(norm > 1e-9, norm, 1.0)[:, None]
    return basis, full


def _mark(
    out: NDArray[np.bool_], row: Rows, channel: Rows, found: NDArray[np.bool_], apart: int
) -> None:
    """Enters what is contradicted, unless something beside it has been: that may be why."""
    for k in np.flatnonzero(found.any(axis=1)):
        first, column = int(row[k]), int(channel[k])
        if not out[max(0, first - _BESIDE // 2) : first + apart + _BESIDE // 2 + 1, column].any():
            out[first, column] |= found[k, 0]
            out[first + apart, column] |= found[k, 1]
