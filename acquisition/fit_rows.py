"""The rows of one source of a recording that a fit uses, once all of them have been checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.faults.damaged_values import damaged_values, with_damaged
from ballbar.acquisition.faults.segments import PoweredUp, Segments, find_segments
from ballbar.acquisition.flags import usable
from ballbar.acquisition.sources import ImportLog, LogRows, SourceFiles, refuse_few
from ballbar.acquisition.stamps.order import seconds_from, with_periods_checked
from ballbar.acquisition.table.table import Table
from ballbar.cell.arrays import Array
from ballbar.cell.neighbours import Mask, Rows

# Rows of one log that a fit takes, for its memory: two hours at 250 Hz. Of eight hours at 248 Hz
# every fourth remains, 62 Hz, of a motion below 3 Hz.
MOST_ROWS = 2_000_000


@dataclass(frozen=True, eq=False)
class ChosenRows:
    """The rows of a table that a fit uses: all usable ones, or of a long log one in some."""

    table: Table
    segments: Segments
    usable: Rows  # (U,)
    every: int  # of the usable rows one in so many is used

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        """(K, ...) values (N, ...) at these rows, write-protected so that logs share them."""
        chosen = np.ascontiguousarray(_chosen(values, self.usable[:: self.every]))
        chosen.flags.writeable = False
        return chosen


@dataclass(frozen=True, eq=False)
class FitRows:
    """The rows of one source that a fit uses, and what was read of it."""

    table: Table
    t: Array  # (K,) [s] from the first of them
    values: Array  # (K, C)
    segment: NDArray[np.uint16]  # (K,)
    imported: ImportLog


def fit_rows(
    read: SourceFiles,
    table: Table,
    values: Array,
    names: Sequence[str],
    *,
    scale: Array | None = None,
) -> FitRows:
    """The rows of one source that a fit uses; values : (N, C) at the rows of the table.

    names, scale : as for `cut_rows`. Raises LogError if too few rows are usable.
    """
    chosen = choose_rows(*cut_rows(table, values, names, scale=scale))
    return rows_in_time(read, chosen, chosen.of(values))


def cut_rows(
    table: Table,
    values: Array,
    names: Sequence[str],
    *,
    scale: Array | None = None,
    reset: Rows | None = None,
    powered_up: PoweredUp | None = None,
) -> tuple[Table, Segments]:
    """The table with damaged values (N, C) and segments remarked, and the segments.

    names : (C,) of the channels. scale : (C,) [rad per unit] by which they are judged; none of
    angles. reset, powered_up : as for `find_segments`.
    """
    table, segments = find_segments(table, values, reset=reset, powered_up=powered_up)
    scaled = values if scale is None else values * scale
    return _with_damaged_values_checked(table, segments, scaled, names), segments


def choose_rows(table: Table, segments: Segments) -> ChosenRows:
    """The rows that a fit uses; raises LogError if they are too few."""
    rows = np.flatnonzero(segments.used & usable(table.flags))
    refuse_few(table, rows.size)
    return ChosenRows(table, segments, rows, -(-rows.size // MOST_ROWS))


def rows_in_time(read: SourceFiles, chosen: ChosenRows, values: Array) -> FitRows:
    """The chosen rows with their values (K, C), once the times of all usable ones are checked."""
    table, segments, rows, every = chosen.table, chosen.segments, chosen.usable, chosen.every
    t = seconds_from(_chosen(segments.stamps, rows), segments.stamps[rows[0]])
    used = with_periods_checked(table.take(rows), t, read.source.dialect.period_s)
    flags, in_log = table.flags.copy(), np.zeros(len(table), dtype=bool)
    flags[rows], in_log[rows[::every]] = used.flags, True
    if every > 1:
        sentence = f"{rows.size} usable rows: all were checked, and one in {every} is used."
        used = used.remarked("long log", sentence, count=1)
        t, used = t[::every], used.take(np.arange(0, rows.size, every))
    counts = np.bincount(used.file, minlength=len(table.files)).tolist()
    used_rows = dict(zip(table.files, counts, strict=True))
    files = tuple(replace(file, rows_kept=used_rows[file.file]) for file in read.summaries)
    imported = ImportLog(files, used.findings, LogRows(flags, segments.segment, in_log))
    return FitRows(used, t, values, chosen.of(segments.segment), imported)


def _with_damaged_values_checked(
    table: Table, segments: Segments, values: Array, names: Sequence[str]
) -> Table:
    """The table with values (N, C) flagged and reported that their neighbours contradict."""
    valid = usable(table.flags)
    segment, stamps, judged = (
        _chosen(v, valid) for v in (segments.segment, segments.stamps, values)
    )
    breaks = np.diff(segment, prepend=np.uint16(0)) != 0
    damaged = damaged_values(seconds_from(stamps, stamps[0]), judged, breaks)
    if not damaged.any():
        return table
    which = [names[k] for k in np.flatnonzero(damaged.any(axis=0)).tolist()]
    return with_damaged(table, np.flatnonzero(valid)[damaged.any(axis=1)], which)


def _chosen(values: NDArray[Any], rows: Rows | Mask) -> NDArray[Any]:
    """(K, ...) values (N, ...) at ascending rows (K,), or a mask; the values themselves if all."""
    every = rows.all() if rows.dtype == bool else rows.size == len(values)
    return values if every else values[rows]
