"""Replayed rows: a stretch of a log that holds the values of an earlier one, row for row.

A recorder that sends a buffer again gives old values new stamps. A robot that repeats its program
repeats commanded angles as well, but it never leaps: a stretch is replayed where all columns of
several rows repeat those of as many earlier rows, no two of them equal, and the first of them lies
further from the row before than those around it do.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ballbar.acquisition.flags import RowFlag
from ballbar.acquisition.table.table import Table
from ballbar.cell.arrays import Array
from ballbar.cell.neighbours import Rows

SHORTEST = 10  # rows that differ from each other; by chance as many never repeat
AROUND = 10  # rows on either side of where a stretch begins
LEAP = 3.0  # times the largest step of a column there
OFF = 1e-4  # [rad] of the joint
_SEED = 7


def with_replays_checked(table: Table, scales: Mapping[str, float], words: float = 0.0) -> Table:
    """The table with replayed rows flagged and reported.

    scales : [rad] that a unit of each column is worth at the joint. words : values of a counter
    that wraps; 0 of columns that do not.
    """
    values = np.stack([table.columns[name] for name in scales], axis=1)
    step = np.diff(values, axis=0)
    if words:
        step = (step + words // 2) % words - words // 2
    size = np.abs(step * np.array(list(scales.values())))
    for first, last, back in _repeated(values):
        if not _leaps(size, first):
            continue
        sentence = (
            f"lines {table.line[first]} to {table.line[last]} repeat lines "
            f"{table.line[first - back]} to {table.line[last - back]} in all columns, and the "
            "motion leaps where they begin: a buffer that was sent again; rows left out."
        )
        rows: Rows = np.arange(first, last + 1)
        table = table.remarked("replayed rows", sentence, rows=rows, flag=RowFlag.FROZEN)
    return table


def _repeated(values: Array) -> list[tuple[int, int, int]]:
    """First and last row, and how many rows ago they were, of stretches that repeat rows (N, C)."""
    words = np.ascontiguousarray(values, dtype=np.float64).view(np.uint64)
    odd = np.random.default_rng(_SEED).integers(2**63, size=words.shape[1], dtype=np.uint64) | 1
    # multiplicative hash of each row; a sort of whole rows takes ten times as long
    _, kind = np.unique(np.bitwise_xor.reduce(words * odd, axis=1), return_inverse=True)
    order = np.argsort(kind, kind="stable")
    ago = np.zeros(kind.size, dtype=np.intp)  # rows back to the last equal one, 0 without
    same = kind[order[1:]] == kind[order[:-1]]
    ago[order[1:][same]] = (order[1:] - order[:-1])[same]
    edges = np.flatnonzero(np.diff(ago)) + 1
    starts, ends = np.append(0, edges), np.append(edges, ago.size) - 1
    long = (ago[starts] > 0) & (ends - starts + 1 >= SHORTEST)
    return [
        (int(a), int(b), int(ago[a]))
        for a, b in zip(starts[long], ends[long], strict=True)
        if np.unique(kind[a : b + 1]).size >= SHORTEST
    ]


def _leaps(size: Array, first: int) -> bool:
    """Whether any column leaps to a row; size : (N-1, C) [rad] of all steps."""
    before, behind = size[max(0, first - 1 - AROUND) : first - 1], size[first : first + AROUND]
    around = np.concatenate((before, behind)).max(axis=0)
    return bool((size[first - 1] > np.maximum(OFF, LEAP * around)).any())
