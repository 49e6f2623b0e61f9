"""Values that no motion leads to: off for a row or few, or elsewhere from a row on.

Two tests. A step that would need more than the mechanism's greatest speed is a jump: back within LONGEST rows it was a
damaged value, else something happened (a counter was reset). Below that speed, a single value is damaged where the six rows
around it lie on one cubic and it does not (at an end, the six next to it); a kink or a step in the motion leaves the six on
none, and nothing is concluded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Difference = Callable[[NDArray[Any], NDArray[Any]], Array]  # (later, earlier) values of some rows -> [rad]

LONGEST = 3  # rows: damage that lasts longer is no damaged row
MANY = 0.01  # of the rows: so many jumps are no accidents but a wrong unit or encoder
SMALLEST = 5e-5  # [rad] a value that deviates by less may stay: it is within a few times the noise of every sensor of the cell
FAR_OUT = 8.0  # standard deviations
NORMAL_MEDIAN = 0.6745  # median of |x| over its standard deviation, for normal x
_BESIDE = np.array([-3, -2, -1, 1, 2, 3])
_REACH = 10.0  # row periods: neighbours further away than these say nothing


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
    if t.size < 2 * _BESIDE.size:
        return out
    error, sigma = _four_row_errors(t, values)
    stretch = np.cumsum(breaks, dtype=np.intp)
    period = float(np.median(np.diff(t)))
    near = np.zeros(t.size, dtype=bool)
    near[3:-3] = (stretch[6:] == stretch[:-6]) & (t[6:] - t[:-6] < _REACH * period) & (t[6:] > t[:-6])
    rows, channels = np.nonzero((error > np.maximum(FAR_OUT * sigma, 0.5 * SMALLEST)) & near[:, None])
    order = np.argsort(-error[rows, channels], kind="stable")  # beside a large one its neighbours look damaged too
    for row, channel in zip(rows[order], channels[order], strict=True):
        beside = row + _BESIDE
        if not out[beside, channel].any() and _contradicted(t, values[:, channel], row, beside, float(sigma[channel])):
            out[row, channel] = True
    # Six rows on one side say less than three on either: stamps of whole milliseconds make steps outside them, seen as usual elsewhere.
    usual = np.maximum(sigma, np.quantile(error, 0.95, axis=0))
    for row, beside in _ends(stretch):
        if np.ptp(t[[row, *beside]]) < _REACH * period:
            for channel in range(values.shape[1]):
                if not out[beside, channel].any() and _contradicted(t, values[:, channel], row, beside, float(usual[channel])):
                    out[row, channel] = True
    return out


def _ends(stretch: NDArray[np.intp]) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """The first and last three rows of each stretch, and for each the six rows next to them inside."""
    bounds = np.flatnonzero(np.diff(stretch, prepend=stretch[0] - 1, append=stretch[-1] + 1))
    for start, stop in pairwise(bounds.tolist()):
        for k in range(3) if stop - start >= 9 else ():
            yield start + k, np.arange(start + 3, start + 9)
            yield stop - 1 - k, np.arange(stop - 9, stop - 3)


def _contradicted(t: Array, column: Array, row: int, beside: NDArray[np.intp], sigma: float) -> bool:
    scale = t[beside[-1]] - t[beside[0]]
    powers = ((t[beside] - t[row]) / scale)[:, None] ** np.arange(4)
    inverse = np.linalg.pinv(powers)
    coefficients = inverse @ column[beside]
    left = column[beside] - powers @ coefficients
    spread = float(np.sqrt((left @ left) / 2.0))  # six rows less four coefficients
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
