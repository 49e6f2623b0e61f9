"""Times of evenly taken rows between the steps of a coarse clock.

The stamps step by as much as a few rows take, or nearly. A stamp of a clock that steps by Q says
that the row was taken within one Q. Evenly taken rows lie on a line of time over row number, and
the line must pass within Q/2 of the middle of every step: after some hundred rows few lines do. The
one in the middle of the narrowest band around all stamps is taken. Where rows are missing or late,
or the clock was set, no line fits any more and the next one begins.

Accuracy: microseconds where the period of the rows and Q have no common divisor worth mentioning
(4.032 ms and 16 ms), half of that divisor where they have (2 ms for 4 ms and 16 ms), and a period
for a few rows beside missing ones.

Stamps show it themselves where rows lie the two multiples of a step apart that are next to their
mean, in the turns that a line gives, so that hardly a line ends (4 and 5 ms for 4.032 ms). Where
rows are lost now and then two distances come as well, in no such turns. `quantised: true` in
recording.yaml declares it; `false`, that stamps are as exact as they are written.

A shift common to all rows remains (a clock may show the beginning, the middle or the end of its
step); it is part of the clock offset.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice, pairwise

import numpy as np
from scipy.spatial import ConvexHull

from ballbar.acquisition.stamps.order import STAMP, amount
from ballbar.acquisition.table.table import Table
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError

ROOM = 1.1  # steps: what a line may leave, a tenth for the jitter of the rows themselves
# Rows between two gaps, on average; with fewer the rows were not taken evenly.
SHORTEST = 50
# Of stamps that show by themselves that they are coarse: the step as a share of the rows' distance,
# the share of distances that are one of two, how often the rarer comes at least, and how many of
# these may end a line. Where rows are lost at random every second or third ends one.
COARSE, TWO, FEW, ENDING = 0.01, 0.95, 20, 0.2
BETWEEN = 0.3  # steps: further from all of them lies no stamp of a clock that shows its steps
_FLAT = 1e-9  # steps


def spread(table: Table, declared: bool | None = None) -> Table:
    """The rows of one file at the times at which they were taken, as far as their stamps show.

    Rows of the logger's next start, and those behind a stamp that goes back, have a line of their
    own.

    declared : None where the stamps alone tell whether they are coarse.

    Raises LogError if the rows that are declared so were not taken evenly, or all stamps are the
    same.
    """
    stamps = table.columns[STAMP]
    rarer = 0 if declared else _rarer(table)
    if declared is False or (declared is None and rarer < FEW):
        return table
    step = _step(table)
    # Counted from the first row, a float64 of steps is exact to a nanosecond.
    shown = (stamps - stamps[0]) / step
    cuts = np.flatnonzero((np.diff(stamps) < 0) | table.begins[1:]) + 1
    every = _lines(shown, [0, *cuts.tolist(), stamps.size])
    most = stamps.size if declared else int(1 + cuts.size + ENDING * rarer)
    lines = list(islice(every, most))
    if next(every, None):
        return table
    if len(lines) > max(2 + cuts.size, stamps.size / SHORTEST):
        what = f"late or missing at {len(lines) - 1 - cuts.size} places within {stamps.size} rows."
        what = f"declared as quantised, but the rows do not come evenly: {what}"
        raise LogError.at(table.location(lines[1][0]), what, "Log a finer time.")
    longest = max(lines, key=lambda line: line[1] - line[0])
    period = _fitted(shown[slice(*longest)])[1]
    times = np.concatenate([_times(shown[first:stop], period) for first, stop in lines])
    for first, stop in lines[1:]:
        if first not in cuts:  # a row written twice takes no time
            times[first:stop] = np.maximum(times[first:stop], times[first - 1])
    moved = np.rint(times * step).astype(np.int64) + stamps[0]
    sentence = (
        f"stamps in steps of {amount(step * 1e-9)}, rows put evenly between them, "
        f"{amount(period * step * 1e-9)} apart, anew at {len(lines) - 1} places; the furthest is "
        f"moved by {amount(float(np.abs(moved - stamps).max()) * 1e-9)}."
    )
    table = table.remarked("quantised stamps", sentence, count=stamps.size)
    return replace(table, columns={**table.columns, STAMP: moved})


def _rarer(table: Table) -> int:
    """How often the rarer of two distances comes in which all rows lie; 0 where there are not two.

    They are the multiples of the clock's step next to the mean distance.
    """
    stamps = table.columns[STAMP]
    distances = np.diff(stamps)[~table.begins[1:]]
    if not (distances > 0).any():
        return 0
    steps = np.rint(distances / _step(table))
    usual = steps[np.abs(steps - np.median(steps)) <= 1.0]
    if not usual.size:  # distances of every kind
        return 0
    low = np.floor(usual.mean())
    shares = np.array([(steps == low).sum(), (steps == low + 1.0).sum()])
    fine = usual.mean() > 1.0 / COARSE
    return 0 if fine or shares.sum() < TWO * steps.size else int(shares.min())


def _step(table: Table) -> int:
    """[ns] by which the clock steps."""
    steps = np.diff(table.columns[STAMP])
    forward = steps[steps > 0]
    if not forward.size:
        what = "all rows have the same stamp."
        raise LogError.at(table.location(0), what, "Log the time at which they were taken.")
    exact = int(np.gcd.reduce(forward))
    if not (steps == 0).any():
        return exact
    # Where rows share stamps, the clock shows each of its steps, and nothing between two of them.
    coarse = int(np.median(forward))
    counts = forward / coarse
    return coarse if (np.abs(counts - np.rint(counts)) < BETWEEN).all() else exact


def _lines(shown: Array, parts: list[int]) -> Iterator[tuple[int, int]]:
    """First row of each line, and the row behind its last; shown (N,) [steps].

    parts : first rows of the parts that have lines of their own, and the number of rows.
    """
    for begin, stop in pairwise(parts):
        first = begin
        while first < stop:
            behind = _furthest(shown, first, stop)
            yield first, behind
            first = behind


def _furthest(shown: Array, first: int, stop: int) -> int:
    """The row up to which one line passes through all steps; shown (N,) [steps]."""
    good, tried = first + 1, min(first + 64, stop)
    while _fits(shown[first:tried]):
        good = tried
        if tried == stop:
            return stop
        tried = min(first + 2 * (tried - first), stop)
    while tried - good > 1:
        middle = (good + tried) // 2
        if _fits(shown[first:middle]):
            good = middle
        else:
            tried = middle
    return good


def _fits(shown: Array) -> bool:
    """Whether one line passes through all steps; shown (N,) [steps].

    The chord from the first to the last lies in every band around all of them.
    """
    left = shown - np.linspace(shown[0], shown[-1], shown.size)
    if np.abs(left).max() > ROOM:
        return False
    return bool(np.ptp(left) <= ROOM) or _fitted(shown)[2] <= ROOM


def _times(shown: Array, period: float) -> Array:
    """(N,) [steps] times of the rows of one line, whose stamps are shown (N,) [steps].

    They have the period [steps] of the log if that fits, else their own.
    """
    rows = np.arange(shown.size)
    left = shown - period * rows
    if np.ptp(left) <= ROOM:
        return np.asarray(0.5 * (left.min() + left.max()) + period * rows)
    start, own, _ = _fitted(shown)
    return start + np.asarray(own * rows)


def _fitted(shown: Array) -> tuple[float, float, float]:
    """Start, slope and height [steps] of the narrowest band over row number around shown (N,).

    Its start is that of its middle. One side of the band is an edge of the convex hull of the
    points, the other touches a corner.
    """
    rows = np.arange(shown.size, dtype=np.float64)
    slope = float(shown[-1] - shown[0]) / max(shown.size - 1, 1)
    left = shown - shown[0] - slope * rows
    if np.ptp(left) < _FLAT:
        return float(shown[0]), slope, 0.0
    corner = ConvexHull(np.stack((rows / rows[-1], left), axis=1)).vertices
    x, y = rows[corner], left[corner]
    run = np.roll(x, -1) - x
    edge = np.abs(run) > 0.5
    tilt = (np.roll(y, -1) - y)[edge] / run[edge]  # (E,)
    above = y - tilt[:, None] * x  # (E, V)
    best = int(np.argmin(np.ptp(above, axis=1)))
    middle = 0.5 * float(above[best].min() + above[best].max())
    return float(shown[0]) + middle, slope + float(tilt[best]), float(np.ptp(above[best]))
