"""Values that no motion leads to: off for a row or few, or elsewhere from a row on.

Two tests. A step that would need more than the mechanism's greatest speed is a jump: back within LONGEST rows it was a
damaged value, else something happened (a counter was reset). Below that speed, a single value is damaged where the eight rows
around it lie on one cubic and it does not; a kink or a step in the motion leaves the eight on none, and nothing is concluded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Difference = Callable[[NDArray[Any], NDArray[Any]], Array]  # (later, earlier) values of some rows -> [rad]

LONGEST = 3  # rows: damage that lasts longer is no damaged row
MANY = 0.01  # of the rows: so many jumps are no accidents but a wrong unit or encoder
SMALLEST = 5e-5  # [rad] a value that deviates by less may stay: it is within a few times the noise of every sensor of the cell
FAR_OUT = 6.0  # standard deviations: of a million values of white noise 0.002 are further out
NORMAL_MEDIAN = 0.6745  # median of |x| over its standard deviation, for normal x
_NOTABLE = 3.5  # standard deviations by which two neighbours on either side must miss a value for it to be judged
_WINDOW = 9  # rows that judge one of them
_REACH = 15.0  # row periods: rows further apart than these say nothing of each other


@dataclass(frozen=True, eq=False)
class Jumps:
    """Too fast steps of a log."""

    damaged: NDArray[np.bool_]  # (N,) rows that are off for a moment
    elsewhere: NDArray[np.intp]  # (K,) first row of what stays away
    fast: NDArray[np.intp]  # (F,) all rows that come too fast
    speed: Array  # (N-1, C) [rad/s] of each step

    def many(self) -> bool:
        """Whether there are too many to be accidents."""
        return self.fast.size > max(2 * LONGEST, MANY * self.damaged.size)


def straight_difference(later: NDArray[Any], earlier: NDArray[Any]) -> Array:
    """[rad] of values that are angles."""
    return np.asarray(later - earlier, dtype=np.float64)


def find_jumps(t: Array, values: NDArray[Any], fastest: Array, difference: Difference = straight_difference) -> Jumps:
    """Steps of a log that are faster than possible.

    t : (N,) [s], may go back where the clock was set. values : (N, C). fastest : (C,) [rad/s].
    """
    step = np.diff(t)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    # A jittered stamp may follow closely: never divide by less than half the usual time between rows.
    speed = np.abs(difference(values[1:], values[:-1])) / np.maximum(step, 0.5 * usual)[:, None]
    fast = np.flatnonzero((speed > fastest).any(axis=1)) + 1
    damaged = np.zeros(t.size, dtype=bool)
    elsewhere: list[int] = []
    if fast.size > max(2 * LONGEST, MANY * t.size):
        return Jumps(damaged, fast[:0], fast, speed)
    done = 0
    for row in fast:
        if row < done:
            continue
        if row <= LONGEST:
            damaged[:row] = True
        elif t.size - row <= LONGEST:
            damaged[row:] = True
            break
        else:
            back = _back(t, values, int(row), fastest, usual, difference)
            if back is None:
                elsewhere.append(int(row))
            else:
                damaged[row:back] = True
                done = back + 1
    return Jumps(damaged, np.array(elsewhere, dtype=np.intp), fast, speed)


def _back(t: Array, values: NDArray[Any], row: int, fastest: Array, usual: float, difference: Difference) -> int | None:
    """First row at which all channels are where motion from before `row` may have led them."""
    jump = np.abs(difference(values[row : row + 1], values[row - 1 : row])[0])
    jumped = jump > fastest * max(float(t[row] - t[row - 1]), 0.5 * usual)
    for after in range(row + 1, min(row + LONGEST, t.size - 1) + 1):
        step = np.abs(difference(values[after : after + 1], values[row - 1 : row])[0])
        within = step < fastest * max(float(t[after] - t[row - 1]), 0.5 * usual)
        if within.all() and (step[jumped] < 0.5 * jump[jumped]).all():
            return after
    return None


def damaged_values(t: Array, values: Array, breaks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N, C) single values that their neighbours contradict.

    t : (N,) [s]. values : (N, C) [rad]. breaks : (N,) rows at which a new stretch begins; no neighbours across them.
    """
    out = np.zeros(values.shape, dtype=bool)
    firsts = np.flatnonzero(breaks | (np.arange(t.size) == 0))
    lasts = np.append(firsts[1:], t.size) - 1
    error, sigma = _four_row_errors(t, values) if t.size > _WINDOW else (out.astype(np.float64), np.zeros(values.shape[1]))
    longest = _REACH * float(np.median(np.diff(t))) if t.size > 1 else 0.0
    for row, channel in _candidates(error, sigma, firsts, lasts):
        stretch = int(np.searchsorted(firsts, row, side="right")) - 1
        begin = min(max(row - _WINDOW // 2, firsts[stretch]), lasts[stretch] - _WINDOW + 1)
        if begin < firsts[stretch] or not 0.0 < t[begin + _WINDOW - 1] - t[begin] < longest:
            continue
        beside = np.delete(np.arange(begin, begin + _WINDOW), row - begin)
        if not out[beside, channel].any() and _contradicted(t, values[:, channel], row, beside, float(sigma[channel])):
            out[row, channel] = True
    return out


def _candidates(error: Array, sigma: Array, firsts: NDArray[np.intp], lasts: NDArray[np.intp]) -> list[tuple[int, int]]:
    """Rows and channels to judge: what stands out, the largest first, since beside it its neighbours look damaged too; then all ends."""
    rows, channels = np.nonzero(error > np.maximum(_NOTABLE * sigma, 0.5 * SMALLEST))
    order = np.argsort(-error[rows, channels], kind="stable")
    ends = {int(row) for k in range(_WINDOW // 2) for row in (*(firsts + k), *(lasts - k)) if 0 <= row < error.shape[0]}
    return [(int(rows[k]), int(channels[k])) for k in order] + [(row, c) for row in sorted(ends) for c in range(error.shape[1])]


def _contradicted(t: Array, column: Array, row: int, beside: NDArray[np.intp], sigma: float) -> bool:
    powers = ((t[beside] - t[row]) / (t[beside[-1]] - t[beside[0]]))[:, None] ** np.arange(4)
    inverse = np.linalg.pinv(powers)
    coefficients = inverse @ column[beside]
    left = column[beside] - powers @ coefficients
    spread = float(np.sqrt((left @ left) / (beside.size - 4)))
    deviation = max(sigma, spread) * np.sqrt(1.0 + float(inverse[0] @ inverse[0]))
    return bool(abs(column[row] - coefficients[0]) > max(FAR_OUT * deviation, SMALLEST))


def _four_row_errors(t: Array, values: Array) -> tuple[Array, Array]:
    """(N, C) [rad] values less the cubic through two neighbours on either side, scaled to the noise of one value; (C,) that noise."""
    out = np.zeros(values.shape)
    times = [t[k : t.size - 4 + k] for k in range(5)]
    with np.errstate(divide="ignore", invalid="ignore"):  # across a clock that was set back two stamps may agree
        error, power = values[2:-2].copy(), np.ones(t.size - 4)
        for k in (0, 1, 3, 4):
            weight = np.ones(t.size - 4)
            for other in (0, 1, 3, 4):
                if other != k:
                    weight *= (times[2] - times[other]) / (times[k] - times[other])
            error -= weight[:, None] * values[k : t.size - 4 + k]
            power += weight * weight
        out[2:-2] = np.abs(np.nan_to_num(error / np.sqrt(power)[:, None]))
    return out, np.asarray(np.median(out, axis=0) / NORMAL_MEDIAN)
