"""Steps that no motion makes: off for a few rows, or elsewhere from a row on.

A step that would need more than the mechanism's greatest speed is a jump: back within LONGEST rows
it was a damaged value, else something happened (a counter was reset). Damage below that speed:
ballbar.acquisition.faults.damaged_values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.neighbours import Mask, Rows

# (later, earlier) values of the same number of rows -> [rad] their differences
Difference = Callable[[NDArray[Any], NDArray[Any]], Array]

LONGEST = 3  # rows: a disturbance that lasts longer is no damaged row
MANY = 0.01  # of the rows: so many jumps are no accidents but a wrong unit or encoder
_BLOCK = 4096  # rows at a time, for the processor's cache


@dataclass(frozen=True, eq=False)
class Jumps:
    """Steps of a log that are faster than possible."""

    damaged: Mask  # (N,) rows that are off for a moment
    lasting: Rows  # (K,) first rows behind steps that do not come back
    fast: Rows  # (F,) all rows that come too fast
    speed: Array  # (F, C) [rad/s] of the steps to them

    def many(self) -> bool:
        """Whether there are too many to be accidents."""
        return self.fast.size > max(2 * LONGEST, MANY * self.damaged.size)


def find_jumps(t: Array, values: NDArray[Any], fastest: Array, difference: Difference) -> Jumps:
    """Steps of a log that are faster than possible.

    t : (N,) [s], may go back where the clock was set. values : (N, C). fastest : (C,) [rad/s].
    difference : gives the differences of values in rad, such as of counter words that wrap.
    """
    step = np.diff(t)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    # A jittered stamp may follow closely: never divide by less than half the usual time.
    shortest = np.maximum(step, 0.5 * usual)
    far = _far(values, 0.5 * usual * fastest, difference)  # few, if any, come as far as this
    speed = np.abs(difference(values[far], values[far - 1])) / shortest[far - 1][:, None]
    too_fast = (speed > fastest).any(axis=1)
    fast, speed = far[too_fast], speed[too_fast]
    damaged = np.zeros(t.size, dtype=bool)
    jumps = Jumps(damaged, fast[:0], fast, speed)
    if jumps.many():
        return jumps
    lasting: list[int] = []
    done = 0
    for row in fast:
        if row < done:
            continue
        if row <= LONGEST:
            damaged[:row] = True
        elif t.size - row <= LONGEST:
            damaged[row:] = True
            break
        elif (back := _back(t, values, int(row), fastest, usual, difference)) is None:
            lasting.append(int(row))
        else:
            damaged[row:back] = True
            done = back + 1
    return Jumps(damaged, np.array(lasting, dtype=np.intp), fast, speed)


def _far(values: NDArray[Any], limit: Array, difference: Difference) -> Rows:
    """Rows of values (N, C) that differ from the row before by more than `limit` (C,) [rad]."""
    rows = [np.zeros(0, dtype=np.intp)]
    for row in range(1, len(values), _BLOCK):
        block = values[row - 1 : row + _BLOCK]
        far = np.abs(difference(block[1:], block[:-1])) > limit
        if far.any():
            rows.append(np.flatnonzero(far.any(axis=1)) + row)
    return np.concatenate(rows)


def _back(
    t: Array, values: NDArray[Any], row: int, fastest: Array, usual: float, difference: Difference
) -> int | None:
    """First row at which all channels are where motion from before `row` may have led them."""

    def step_to(after: int) -> Array:
        return np.asarray(np.abs(difference(values[after : after + 1], values[row - 1 : row])[0]))

    def reach(after: int) -> Array:
        return np.asarray(fastest * max(float(t[after] - t[row - 1]), 0.5 * usual))

    jump = step_to(row)
    jumped = jump > reach(row)
    for after in range(row + 1, min(row + LONGEST, t.size - 1) + 1):
        step = step_to(after)
        if (step < reach(after)).all() and (step[jumped] < 0.5 * jump[jumped]).all():
            return after
    return None
