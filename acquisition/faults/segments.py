"""Segments of a log: stretches of one clock and one counter reference, and what can be used of them together.

A segment begins where the logger ran anew, where the clock was set, where a counter was reset, and after a pause. Two of
them can be used as one log if nothing of what joins them is lost:

- The clock was set back and the motion goes on: the rows behind are put one period after the last. What that is off by is
  at most a late row, and identification measures steps of the clock (ident.signals.steps, ident.estimator.events).
- The clock goes on, forth or after a pause, and so do the counters: nothing to be done. Whether a pause was one, or the clock
  jumped, is told by the motion, in identification.
- A counter was reset between two neighbouring rows: the motion on both sides tells by how much, in identification.

Elsewhere the time between them or the encoders' zeros are unknown: the longest part is used, and the others are reported.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.report import Finding, finding
from acquisition.stamps.order import GAP, STAMP, amount
from acquisition.table.table import Table
from acquisition.times import Stamps
from cell.errors import LogError

Array = NDArray[np.float64]

PAUSE = 0.5  # [s] without rows: a new segment
MOST = 50  # segments; a log of more has another fault
HELD = 5e-3  # [rad] by which a mechanism may go on between two rows beyond what its speed explains: its start or stop
STANDING = 2e-3  # [rad/s] below it the angles do not tell how much time has passed
_LOOK = 6  # rows on either side that tell its speed


@dataclass(frozen=True, eq=False)
class Segments:
    """The rows of a log, cut and joined."""

    stamps: Stamps  # (N,) [ns] continuous within each part
    segment: NDArray[np.uint16]  # (N,) number of the segment
    used: NDArray[np.bool_]  # (N,) rows of the part that is used


def find_segments(
    table: Table,
    angles: Array,
    sound: NDArray[np.bool_],
    findings: list[Finding],
    *,
    reset: NDArray[np.intp] = np.zeros(0, dtype=np.intp),  # noqa: B008
    powered_up: Any = None,
) -> Segments:
    """Segments of a log whose rows may be cut anywhere.

    angles : (N, C) [rad] as they go on across everything. sound : (N,) rows whose angles mean something.
    reset : rows at which a counter was preset or jumped. powered_up : of two rows, whether all counters started anew between them.
    Raises LogError for more segments than a log has.
    """
    stamps = table.columns[STAMP].copy()
    step = np.diff(stamps)
    period = float(np.median(step[step > 0])) if (step > 0).any() else 1e6
    pause = max(PAUSE * 1e9, GAP * period)
    boundary = table.begins.copy()
    boundary[1:] |= (step <= 0) | (step > pause)
    boundary[reset] = True
    boundary[0] = False
    rows = np.flatnonzero(boundary)
    if rows.size > MOST:
        raise LogError(
            f"{table.place(rows[0])}: the log falls into {rows.size + 1} segments, since stamps go back, rows are missing for more than "
            f"{PAUSE:g} s or counters jump. Is it a log of one run, and its clock the one that is declared?"
        )
    parts = np.zeros(stamps.size, dtype=np.int64)
    for row in rows:
        before, behind = _neighbours(sound, int(row))
        elapsed = float(stamps[row] - stamps[row - 1])
        place = [int(table.line[row])]
        file = table.files[table.file[row]]
        if elapsed <= 0:
            anew = bool(table.begins[row])
            if (
                before is not None
                and behind is not None
                and _goes_on(stamps, angles, sound, int(row), before, behind, period, anew=anew)
            ):
                stamps[row:] += round(period - elapsed)
                sentence = (
                    f"the clock was set back by {amount(-elapsed * 1e-9)} while the motion went on; the rows behind are put one period "
                    "after the last, and identification measures the rest."
                )
                findings.append(finding("clock set back", "repaired", file, sentence, lines=place))
            else:
                parts[row:] += 1
                sentence = f"the stamp goes back by {amount(-elapsed * 1e-9)} and the motion does not go on: the time between is unknown."
                findings.append(finding("logger restarted", "warning", file, sentence, lines=place))
        elif row in reset and elapsed > GAP * period:
            parts[row:] += 1
            sentence = f"a counter was reset while rows are missing for {amount(elapsed * 1e-9)}: its zero is another."
            findings.append(finding("counter reset", "warning", file, sentence, lines=place))
        elif (
            row not in reset
            and powered_up is not None
            and elapsed > pause
            and powered_up(before, behind)
        ):
            parts[row:] += 1
            sentence = f"all counters start near zero after {amount(elapsed * 1e-9)} without rows: switched off and on, their zeros are others."
            findings.append(finding("counter reset", "warning", file, sentence, lines=place))
        elif elapsed > pause:
            sentence = f"{amount(elapsed * 1e-9)} without rows: a pause, or the clock was set; a new segment."
            findings.append(finding("pause or clock jump", "warning", file, sentence, lines=place))
    segment = np.cumsum(boundary).astype(np.uint16)
    return Segments(stamps, segment, _longest(table, stamps, parts, findings))


def _neighbours(sound: NDArray[np.bool_], row: int) -> tuple[int | None, int | None]:
    """The last sound row before `row`, and the first from it on."""
    before, behind = np.flatnonzero(sound[:row]), np.flatnonzero(sound[row:])
    return (int(before[-1]) if before.size else None), (
        int(behind[0]) + row if behind.size else None
    )


def _goes_on(
    stamps: Stamps,
    angles: Array,
    sound: NDArray[np.bool_],
    row: int,
    before: int,
    behind: int,
    period: float,
    *,
    anew: bool,
) -> bool:
    """Whether the angles behind a boundary are where a few periods of motion lead; anew : the logger ran anew."""
    speed = np.zeros(angles.shape[1])
    for start, stop in ((max(0, row - _LOOK), row), (row, min(row + _LOOK, stamps.size))):
        rows = np.arange(start, stop)[sound[start:stop]]
        if rows.size > 1 and stamps[rows[-1]] > stamps[rows[0]]:
            speed = np.maximum(
                speed,
                np.abs(angles[rows[-1]] - angles[rows[0]])
                / float(stamps[rows[-1]] - stamps[rows[0]]),
            )
    apart = (GAP + behind - row + row - 1 - before) * period
    on = bool((np.abs(angles[behind] - angles[before]) <= HELD + 2.0 * speed * apart).all())
    standing = speed.max() * 1e9 < STANDING  # then any time may have passed
    return on and not (standing and (anew or stamps[row - 1] - stamps[row] > PAUSE * 1e9))


def _longest(
    table: Table, stamps: Stamps, parts: NDArray[np.int64], findings: list[Finding]
) -> NDArray[np.bool_]:
    """(N,) the rows of the longest part; the others are reported."""
    firsts = np.flatnonzero(np.diff(parts, prepend=-1))
    lasts = np.append(firsts[1:], parts.size) - 1
    chosen = int(np.argmax(stamps[lasts] - stamps[firsts]))
    for k, (first, last) in enumerate(zip(firsts, lasts, strict=True)):
        if k != chosen:
            sentence = (
                f"{last - first + 1} rows over {amount(float(stamps[last] - stamps[first]) * 1e-9)} are not used: they cannot be joined "
                f"to the longest part, which starts at {table.place(firsts[chosen])}. To use them, make a recording of their own."
            )
            file = table.files[table.file[first]]
            findings.append(
                finding(
                    "part not used",
                    "repaired",
                    file,
                    sentence,
                    lines=[int(table.line[first])],
                    count=int(last - first + 1),
                )
            )
    return np.asarray(parts == parts[firsts[chosen]])
