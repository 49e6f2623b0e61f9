"""Summary of a sweep's table: failed runs and their reason, spread of the main results on the grid.

The table is read a few columns and rows at a time: a sweep may be larger than the memory.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ballbar.sweep.chunk import FAILED
from ballbar.sweep.file import LABEL, Changes
from ballbar.sweep.plan import Plan, point_of
from ballbar.sweep.table import regrouped
from cell.arrays import Array

MAIN_RESULTS = ("distance_mm_mrad", "tcp_mean_mm")  # the results of a run that are summarised
MAX_POINTS = 40  # points of the grid that are shown: a terminal's height

_NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Failures:
    """Failed runs of a sweep."""

    count: int
    reason: str  # the commonest one but for its numbers, as a run gave it; empty without failures
    of_reason: int  # runs that failed for this reason


@dataclass(frozen=True, eq=False)
class GridPoint:
    """The runs of one point of the grid, draws and seeds together."""

    values: Changes
    runs: int
    failed: int
    results: dict[str, Array]  # (runs - failed,) of each of MAIN_RESULTS in the table, unit in name


def failures_of(table: Path) -> Failures:
    """Number of failed runs in a table, and the commonest reason."""
    counts: Counter[str] = Counter()
    example: dict[str, str] = {}
    for rows in pq.ParquetFile(table).iter_batches(columns=["status", "reason"]):
        for status, reason in zip(*(column.to_pylist() for column in rows.columns), strict=True):
            if status == FAILED:
                kind = _NUMBER.sub("#", reason)
                counts[kind] += 1
                example.setdefault(kind, reason)
    if not counts:
        return Failures(0, "", 0)
    kind, of_reason = counts.most_common(1)[0]
    return Failures(counts.total(), example[kind], of_reason)


def grid_points(table: Path, plan: Plan) -> Iterator[GridPoint]:
    """The first MAX_POINTS points of the grid, in order."""
    file = pq.ParquetFile(table)
    names = [name for name in MAIN_RESULTS if name in file.schema_arrow.names]
    batches = file.iter_batches(columns=["status", *names])
    groups = regrouped((pa.Table.from_batches([b]) for b in batches), plan.grid_point_runs)
    for number, rows in zip(range(MAX_POINTS), groups, strict=False):
        done = rows.filter(pc.field("status") != FAILED)
        results = {name: done[name].drop_null().to_numpy() for name in names}
        point = point_of(plan, number * plan.grid_point_runs // plan.seeds)
        values = {key: value for key, value in point.items() if key not in plan.data.draw}
        yield GridPoint(values, len(rows), len(rows) - len(done), results)


def grid_keys(plan: Plan) -> list[str]:
    """Keys of the grid's values, `label` first."""
    grid = [axis for axis in plan.axes if axis.section != "draw"]
    keys = dict.fromkeys(key for axis in grid for row in axis.rows for key in row)
    return sorted(keys, key=lambda key: key != LABEL)
