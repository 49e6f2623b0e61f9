"""Segments of a log: stretches of one clock and one counter reference, and which can be joined.

A segment begins where the logger started again, where the clock was set, where a counter was reset,
and after a pause. Two of them can be used as one log if nothing of what joins them is lost:

- The clock was set back and the motion goes on: the rows after it are put one period after the
  last. That is off by a late row at most, and identification measures steps of the clock
  (ballbar.ident.signals.steps).
- The clock goes on, forth or after a pause, and so do the counters: nothing to be done. Whether a
  pause was one, or the clock jumped, is seen from the motion, in identification.
- A counter was reset between two neighbouring rows: the motion on both sides shows by how much, in
  identification.

Elsewhere the time between them or the encoder offsets are unknown: the longest part is used, and
the others are reported.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.flags import usable
from ballbar.acquisition.stamps.order import GAP, STAMP, amount
from ballbar.acquisition.table.table import Table
from ballbar.acquisition.times import Stamps
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError
from ballbar.cell.neighbours import Mask, Rows

# Whether all counters started again between two rows, each of which may be missing.
PoweredUp = Callable[[int | None, int | None], bool]

PAUSE = 0.5  # [s] without rows: a new segment
MOST = 50  # segments; a log of more has another fault
# [rad] by which a mechanism may move on between two rows beyond what its speed explains: its
# start or stop.
HELD = 5e-3
STANDING = 2e-3  # [rad/s] below it the angles do not show how much time has passed
_LOOK = 6  # rows on either side that show its speed


@dataclass(frozen=True, eq=False)
class Segments:
    """The rows of a log, cut and joined."""

    stamps: Stamps  # (N,) [ns] continuous within each part
    segment: NDArray[np.uint16]  # (N,) number of the segment
    used: Mask  # (N,) rows of the part that is used


@dataclass(frozen=True, eq=False)
class _Log:
    """The data by which boundaries between segments are judged."""

    angles: Array  # (N, C) [rad]
    valid: Mask  # (N,) rows whose angles mean something
    begins: Mask  # (N,) rows at which the logger started again
    reset: Rows  # rows at which a counter was preset or jumped
    powered_up: PoweredUp | None
    period: float  # [ns]
    pause: float  # [ns]


class _Boundary(NamedTuple):
    """An event between two rows."""

    kind: str  # empty for nothing that is reported
    sentence: str = ""
    separates: bool = False  # the rows behind cannot be used together with those before
    shift: int = 0  # [ns] to be added to the stamps behind


def find_segments(
    table: Table, angles: Array, *, reset: Rows | None = None, powered_up: PoweredUp | None = None
) -> tuple[Table, Segments]:
    """The table with findings about its segments, and the segments.

    angles : (N, C) [rad] as they go on across everything; those of rows with excluding flags do not
        count.
    reset : rows at which a counter was preset or jumped.
    Raises LogError for more segments than a log has.
    """
    stamps = table.columns[STAMP]
    step = np.diff(stamps)
    forward = np.sort(step[step > 0])  # a partition is slow where nearly all are equal
    middle = forward[(forward.size - 1) // 2 : forward.size // 2 + 1]
    period = float(middle.mean()) if forward.size else 1e6  # [ns]
    del forward  # of a log of hours
    pause = max(PAUSE * 1e9, GAP * period)
    reset = np.zeros(0, dtype=np.intp) if reset is None else reset
    boundary = table.begins.copy()
    boundary[1:] |= (step <= 0) | (step > pause)
    del step
    boundary[reset] = True
    boundary[0] = False
    rows = np.flatnonzero(boundary)
    if rows.size > MOST:
        what = f"the log falls into {rows.size + 1} segments: is it of one run, and of this clock?"
        remedy = "If not, cut it before this line, or correct `time` in recording.yaml."
        raise LogError.at(table.location(rows[0]), what, remedy)
    log = _Log(
        angles=angles,
        valid=usable(table.flags),
        begins=table.begins,
        reset=reset,
        powered_up=powered_up,
        period=period,
        pause=pause,
    )
    parts = np.zeros(stamps.size, dtype=np.int16)
    for row in rows:
        change = _boundary(log, stamps, int(row))
        parts[row:] += change.separates
        if change.shift:
            stamps = np.concatenate((stamps[:row], stamps[row:] + change.shift))
        if change.kind:
            at = np.array([row])
            table = table.remarked(change.kind, change.sentence, rows=at)
    segment = np.cumsum(boundary, dtype=np.uint16)
    table, used = _longest(table, stamps, parts)
    return table, Segments(stamps, segment, used)


def _boundary(log: _Log, stamps: Stamps, row: int) -> _Boundary:
    """The event between `row` and the row before; stamps (N,) [ns], joined up to there."""
    before = next((k for k in range(row - 1, -1, -1) if log.valid[k]), None)
    behind = next((k for k in range(row, stamps.size) if log.valid[k]), None)
    elapsed = float(stamps[row] - stamps[row - 1])
    duration = amount(abs(elapsed) * 1e-9)
    if elapsed <= 0:
        if before is not None and behind is not None and _goes_on(log, stamps, row, before, behind):
            sentence = f"the clock was set back by {duration} while the motion went on; joined on."
            shift = round(log.period - elapsed)
            return _Boundary("clock set back", sentence, shift=shift)
        sentence = f"the stamp goes back by {duration} and the motion does not go on."
        return _Boundary("logger restarted", sentence, separates=True)
    if row in log.reset:
        if elapsed <= GAP * log.period:
            return _Boundary("")
        sentence = f"a counter was reset while rows are missing for {duration}; its zero is new."
        return _Boundary("counter reset", sentence, separates=True)
    if elapsed <= log.pause:
        return _Boundary("")
    if log.powered_up is not None and log.powered_up(before, behind):
        sentence = f"all counters start near zero after {duration} without rows: switched off."
        return _Boundary("counter reset", sentence, separates=True)
    sentence = f"{duration} without rows: a pause, or the clock was set; a new segment."
    return _Boundary("pause or clock jump", sentence)


def _goes_on(log: _Log, stamps: Stamps, row: int, before: int, behind: int) -> bool:
    """Whether the angles behind a boundary are where a few periods of motion lead.

    before, behind : valid rows on either side. stamps : (N,) [ns].
    """
    angles, speed = log.angles, np.zeros(log.angles.shape[1])
    for start, stop in ((max(0, row - _LOOK), row), (row, min(row + _LOOK, stamps.size))):
        rows = np.arange(start, stop)[log.valid[start:stop]]
        if rows.size > 1 and stamps[rows[-1]] > stamps[rows[0]]:
            time = float(stamps[rows[-1]] - stamps[rows[0]])
            speed = np.maximum(speed, np.abs(angles[rows[-1]] - angles[rows[0]]) / time)
    apart = (GAP + behind - 1 - before) * log.period
    on = bool((np.abs(angles[behind] - angles[before]) <= HELD + 2.0 * speed * apart).all())
    standing = speed.max() * 1e9 < STANDING  # then any time may have passed
    far_back = stamps[row - 1] - stamps[row] > PAUSE * 1e9
    return on and not (standing and (bool(log.begins[row]) or far_back))


def _longest(table: Table, stamps: Stamps, parts: NDArray[np.int16]) -> tuple[Table, Mask]:
    """The table with findings about unused parts, and (N,) the rows of the longest part.

    stamps : (N,) [ns]. parts : (N,) number of the part of each row.
    """
    firsts = np.flatnonzero(np.diff(parts, prepend=np.int16(-1)))
    lasts = np.append(firsts[1:], parts.size) - 1
    chosen = int(np.argmax(stamps[lasts] - stamps[firsts]))
    for k, (first, last) in enumerate(zip(firsts, lasts, strict=True)):
        if k != chosen:
            count = int(last - first + 1)
            lasting = amount(float(stamps[last] - stamps[first]) * 1e-9)
            sentence = (
                f"{count} rows over {lasting} are not used: they cannot be joined to the longest "
                f"part, which starts at {table.location(firsts[chosen])}. To use them, make a "
                "recording of their own."
            )
            at = np.array([first])
            table = table.remarked("part not used", sentence, rows=at, count=count)
    return table, np.asarray(parts == parts[firsts[chosen]])
