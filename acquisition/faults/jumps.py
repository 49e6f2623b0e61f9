"""Steps that no motion makes: off for a row or few, or elsewhere from a row on.

A step that would need more than the mechanism's greatest speed is a jump: back within LONGEST rows it was a damaged value, else
something happened (a counter was reset). Damage below that speed: acquisition.faults.damaged_values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Difference = Callable[
    [NDArray[Any], NDArray[Any]], Array
]  # (later, earlier) values of some rows -> [rad]

LONGEST = 3  # rows: damage that lasts longer is no damaged row
_BLOCK = 4096  # rows at a time, for the processor's cache
MANY = 0.01  # of the rows: so many jumps are no accidents but a wrong unit or encoder


@dataclass(frozen=True, eq=False)
class Jumps:
    """Too fast steps of a log."""

    damaged: NDArray[np.bool_]  # (N,) rows that are off for a moment
    elsewhere: NDArray[np.intp]  # (K,) first row of what stays away
    fast: NDArray[np.intp]  # (F,) all rows that come too fast
    speed: Array  # (F, C) [rad/s] of the steps to them

    def many(self) -> bool:
        """Whether there are too many to be accidents."""
        return self.fast.size > max(2 * LONGEST, MANY * self.damaged.size)


def straight_difference(later: NDArray[Any], earlier: NDArray[Any]) -> Array:
    """[rad] of values that are angles."""
    return np.asarray(later - earlier, dtype=np.float64)


def find_jumps(
    t: Array, values: NDArray[Any], fastest: Array, difference: Difference = straight_difference
) -> Jumps:
    """Steps of a log that are faster than possible.

    t : (N,) [s], may go back where the clock was set. values : (N, C). fastest : (C,) [rad/s].
    """
    step = np.diff(t)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    # A jittered stamp may follow closely: never divide by less than half the usual time between rows.
    shortest = np.maximum(step, 0.5 * usual)
    far = _far(values, 0.5 * usual * fastest, difference)  # few, if any, come as far as this
    speed = np.abs(difference(values[far], values[far - 1])) / shortest[far - 1][:, None]
    late = (speed > fastest).any(axis=1)
    fast, speed = far[late], speed[late]
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


def _far(values: NDArray[Any], limit: Array, difference: Difference) -> NDArray[np.intp]:
    """Rows that are further from the row before than `limit` (C,) [rad]."""
    found = [np.zeros(0, dtype=np.intp)]
    for row in range(1, len(values), _BLOCK):
        block = values[row - 1 : row + _BLOCK]
        steps = np.abs(difference(block[1:], block[:-1]))
        if (steps > limit).any():
            found.append(np.flatnonzero((steps > limit).any(axis=1)) + row)
    return np.concatenate(found)


def _back(
    t: Array, values: NDArray[Any], row: int, fastest: Array, usual: float, difference: Difference
) -> int | None:
    """First row at which all channels are where motion from before `row` may have led them."""
    jump = np.abs(difference(values[row : row + 1], values[row - 1 : row])[0])
    jumped = jump > fastest * max(float(t[row] - t[row - 1]), 0.5 * usual)
    for after in range(row + 1, min(row + LONGEST, t.size - 1) + 1):
        step = np.abs(difference(values[after : after + 1], values[row - 1 : row])[0])
        within = step < fastest * max(float(t[after] - t[row - 1]), 0.5 * usual)
        if within.all() and (step[jumped] < 0.5 * jump[jumped]).all():
            return after
    return None
