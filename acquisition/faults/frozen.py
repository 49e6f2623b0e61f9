"""Frozen channels: one value, to the last digit, in successive rows in which there was motion.

A mechanism that stands repeats its values too, and so does a coarse sensor in slow motion. They
differ in how they begin and end: a mechanism slows down before it stands and sets off slowly, while
a frozen channel stops between two rows at full speed and jumps to where the motion has led
meanwhile. A run of equal values is frozen where

- it ends in a step far beyond those around it, and begins or ends at full speed; or
- it begins at full speed and ends at full speed the other way: a motion that comes back, which by
  the cubic with the places and speeds on both sides was elsewhere meanwhile; or
- it is the first or the last of the log, and begins or ends at full speed.

No step of a coarse sensor's grain is a jump, and where runs follow each other directly the logger
holds each value for some rows.

Torques and forces have no motion to be led by. Where they are noisy they repeat by chance only: of
R runs of equal values, of which a share p has more than one row, `R p^(n - 1)` have n rows or more.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.flags import RowFlag
from ballbar.acquisition.table.table import Table
from ballbar.cell.arrays import Array
from ballbar.cell.neighbours import Mask, Rows

SHORTEST = 5  # rows of a run; shorter ones are damaged values (faults.damaged_values)
OFF = 1e-4  # [rad], [m] from the motion; a joint that strikes in its backlash moves by less
JUMP = 3.0  # times the third largest step around: beside two other faults
EDGE = 5  # rows that show the speed on either side
ABRUPT = 0.6  # of the mean step there: the last one of a mechanism that stops is a fifth of it
GRAINS = 3.0  # steps of a coarse sensor
ROUNDING = 1e-6  # of a step: what the form of numbers changes of it
HELD = 3.0  # times as long as the run beside it: a value that is held as others are
ONWARD = 0.5  # of the way of a motor, noise included, that leads on: it moves
CHANCE = 1e-6  # runs as long as that by chance
ALTERNATING = 0.5  # of the sizes of changes: the sum of noise's, in ten rows, is an eighth
STRETCHES_SHOWN = 3


class _Runs(NamedTuple):
    """Runs of equal values of one channel, of two rows or more."""

    first: Rows  # (K,) row
    last: Rows  # (K,) row, in it

    @property
    def length(self) -> NDArray[np.intp]:
        return np.asarray(self.last - self.first + 1)

    def take(self, which: Mask) -> _Runs:
        return _Runs(self.first[which], self.last[which])


def with_frozen_motion_checked(
    table: Table, t: Array, scales: Mapping[str, float], words: float = 0.0
) -> Table:
    """The table with rows flagged and reported in which a channel that moves is frozen.

    t : (N,) [s]. scales : [rad] that a unit of each column is worth at the joint, or [m].
    words : values of a counter that wraps; 0 of columns that do not.
    """
    frozen = {}
    for name, scale in scales.items():
        values = table.columns[name]
        step = np.diff(values)
        if words:
            step = (step + words // 2) % words - words // 2
        step = step.astype(np.float64)  # of whole counts
        step *= scale
        frozen[name] = _frozen(t, step)
    return _remarked(table, frozen, "while the motion on both sides leads elsewhere")


def with_frozen_loads_checked(table: Table, moving: Mapping[str, str | None]) -> Table:
    """The table with rows flagged and reported in which a torque or force is frozen.

    moving : column of each load -> column that moves wherever the load has to change, if any.
    """
    frozen = {}
    for name, other in moving.items():
        step = np.diff(table.columns[name])
        runs = _runs(step)
        every = 1 + np.count_nonzero(step)  # those of a single row too
        share = max(1.0, float(runs.first.size)) / every
        chance = every * share ** (runs.length - 1.0)
        runs = runs.take((runs.length >= SHORTEST) & (chance < CHANCE))
        runs = runs.take(_noisy_beside(step, runs))
        if other is not None and runs.first.size:
            place = table.columns[other]
            way = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(place)))))
            moved = np.abs(place[runs.last] - place[runs.first])  # noise comes back
            way = way[runs.last] - way[runs.first]
            runs = runs.take((moved > 0.0) & (moved >= ONWARD * way))
        frozen[name] = runs
    return _remarked(table, frozen, "as its noise does by no chance")


def _noisy_beside(step: NDArray[Any], runs: _Runs) -> Mask:
    """(K,) whether the values before and behind a run scatter by more than their grain.

    Those without noise repeat wherever they come to rest or turn back. Their curvature keeps its
    sign; that of noise alternates.
    """
    change, noisy = np.diff(step), np.ones(runs.first.size, dtype=bool)
    smallest = GRAINS * _grain(step)
    for k, (first, last) in enumerate(zip(runs.first.tolist(), runs.last.tolist(), strict=True)):
        sides = change[max(0, first - 2 * EDGE) : max(0, first - 2)], change[last + 1 :][: 2 * EDGE]
        for side in (side for side in sides if side.size):
            size = np.abs(side)
            noisy[k] &= np.median(size) > smallest and abs(side.sum()) < ALTERNATING * size.sum()
    return noisy


def _runs(step: NDArray[Any]) -> _Runs:
    """The runs of equal values of two rows or more; step : (N-1,) from row to row."""
    edges = np.flatnonzero(np.diff(step == 0, prepend=False, append=False))
    return _Runs(edges[::2], edges[1::2])


def _frozen(t: Array, step: Array) -> _Runs:
    """The runs of equal values in which a channel is frozen; step : (N-1,) [rad] row to row."""
    runs = _runs(step)
    runs = runs.take((runs.length >= SHORTEST) & ~_held(runs))
    if not runs.first.size or not step.any():
        return runs.take(np.zeros(runs.first.size, dtype=bool))
    smallest = max(OFF, GRAINS * _grain(step))
    before, behind = _side(t, step, runs.first, -1), _side(t, step, runs.last, 1)
    duration = t[runs.last] - t[runs.first]
    jump = np.where(behind.exists, step[np.minimum(runs.last, step.size - 1)], 0.0)
    reach = duration * np.maximum(np.abs(before.speed), np.abs(behind.speed))
    far = (np.abs(jump) > smallest) & (before.abrupt | behind.abrupt)
    abrupt = before.abrupt & behind.abrupt & (before.speed * behind.speed < 0.0)
    # of the cubic through both ends, halfway, above the frozen value
    bridge = 0.5 * jump + 0.125 * duration * (before.speed - behind.speed)
    one_sided = (before.abrupt & ~behind.exists) | (behind.abrupt & ~before.exists)
    frozen = (abrupt & (np.abs(bridge) > smallest)) | (one_sided & (0.5 * reach > smallest))
    for k in np.flatnonzero(far & ~frozen):
        frozen[k] = abs(jump[k]) > JUMP * _step_around(step, runs.first[k], runs.last[k])
    return runs.take(frozen)


class _Side(NamedTuple):
    """The motion on one side of runs."""

    speed: Array  # (K,) [rad/s]
    abrupt: Mask  # (K,) whether the channel moves at this speed up to the run
    exists: Mask  # (K,) whether there are rows


def _side(t: Array, step: Array, row: Rows, direction: int) -> _Side:
    """The motion before the first rows of runs (direction -1), or behind their last ones.

    The step out of a frozen run is a jump: the speed behind is that of the rows after it.
    """
    inner = row if direction < 0 else row + 1  # row from which the side goes on
    outer = inner + direction * EDGE
    exists = (outer >= 0) & (outer < t.size)
    inner, outer = np.clip(inner, 0, t.size - 1), np.clip(outer, 0, t.size - 1)
    place = np.concatenate(([0.0], np.cumsum(step)))
    elapsed = np.where(exists, t[inner] - t[outer], 1.0)
    moved = np.where(exists, place[inner] - place[outer], 0.0)
    speed = moved / np.where(elapsed != 0.0, elapsed, 1.0)
    rows = inner - (direction < 0) + direction * np.arange(2 * EDGE)[:, None]
    steps = np.abs(step[np.clip(rows, 0, step.size - 1)])  # (2 EDGE, K), the closest first
    # The smallest difference between sizes, no step being one of them: where numbers have so many
    # significant digits, the grain grows with the angle.
    sizes = np.sort(np.concatenate((np.zeros_like(steps[:1]), steps)), axis=0)
    apart = np.diff(sizes, axis=0)
    grain = np.where(apart > ROUNDING * sizes[-1], apart, np.inf).min(axis=0)
    abrupt = exists & (steps[0] - grain > ABRUPT * np.abs(moved) / EDGE)
    return _Side(speed, abrupt, exists)


def _step_around(step: Array, first: int, last: int) -> float:
    """[rad] third largest step of the rows beside a run, whose own two steps do not count."""
    reach = 2 * EDGE
    around = np.abs(np.r_[step[max(0, first - reach) : first], step[last + 1 : last + 1 + reach]])
    return float(np.partition(around, -3)[-3]) if around.size >= EDGE else 0.0


def _held(runs: _Runs) -> Mask:
    """(K,) runs beside which another one follows directly that is nearly as long."""
    apart = np.concatenate(([True], runs.first[1:] > runs.last[:-1] + 1, [True]))
    length = np.concatenate(([0], runs.length, [0]))
    beside = np.maximum(np.where(apart[:-1], 0, length[:-2]), np.where(apart[1:], 0, length[2:]))
    return np.asarray(runs.length <= HELD * beside)


def _grain(step: NDArray[Any]) -> float:
    """Smallest step of a channel."""
    return float(np.abs(step[step != 0]).min(initial=np.inf))


def _remarked(table: Table, frozen: Mapping[str, _Runs], why: str) -> Table:
    """The table with frozen runs flagged and reported, columns that froze together in one finding.

    The first row of a run holds a true value.
    """
    together = defaultdict[tuple[int, int], list[str]](list)
    for name, runs in frozen.items():
        for first, last in zip(runs.first.tolist(), runs.last.tolist(), strict=True):
            together[first + 1, last].append(name)
    stretches = defaultdict[tuple[str, ...], list[tuple[int, int]]](list)
    for stretch, names in sorted(together.items()):
        stretches[tuple(names)].append(stretch)
    for columns, every in stretches.items():
        rows = np.unique(np.concatenate([np.arange(a, b + 1) for a, b in every]))
        lines = [f"{table.line[a]} to {table.line[b]}" for a, b in every[:STRETCHES_SHOWN]]
        more = f" and {len(every) - len(lines)} more stretches" * (len(every) > len(lines))
        single = len(columns) == 1
        sentence = (
            f"column{'s' * (not single)} {', '.join(columns)} repeat{'s' * single} one value in "
            f"lines {', '.join(lines)}{more}, {why}: frozen; rows left out."
        )
        table = table.remarked("frozen channel", sentence, rows=rows, flag=RowFlag.FROZEN)
    return table
