"""What a sweep's table says at a glance: how many runs failed and why, and the spread of the main figures at each grid point.

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

from ballbar.sweep.file import LABEL, Changes
from ballbar.sweep.part import FAILED
from ballbar.sweep.plan import Plan, point_of
from cell.arrays import Array

FIGURES = ("distance_mm_mrad", "tcp_mean_mm")  # those of a run that are summed up
MAX_POINTS = 40  # of the grid; more would hide the rest

_NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Failures:
    """Failed runs of a sweep."""

    count: int
    reason: (
        str  # the commonest but for the numbers in it, as one run gave it; empty without failures
    )
    of_reason: int  # runs that failed so


@dataclass(frozen=True, eq=False)
class GridPoint:
    """The runs of one point of the grid, draws and seeds together."""

    values: Changes
    runs: int
    failed: int
    figures: dict[
        str, Array
    ]  # (runs - failed,) in the unit of the figure's name, of each of FIGURES that the table has


def failures_of(table: Path) -> Failures:
    """How many runs failed, and the commonest reason."""
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
    figures = [name for name in FIGURES if name in file.schema_arrow.names]
    drawn = {key for axis in plan.axes if axis.section == "draw" for key in axis.rows[0]}
    groups = _groups(file, ["status", *figures], plan.cell_runs)
    for number, rows in zip(range(MAX_POINTS), groups, strict=False):
        done = rows.filter(pc.field("status") != FAILED)
        columns = {name: done[name].drop_null().to_numpy() for name in figures}
        values = point_of(plan, number * plan.cell_runs // plan.seeds)
        yield GridPoint(
            {key: value for key, value in values.items() if key not in drawn},
            len(rows),
            len(rows) - len(done),
            columns,
        )


def grid_keys(plan: Plan) -> list[str]:
    """Keys of the grid's values, `label` first."""
    keys = dict.fromkeys(
        key for axis in plan.axes if axis.section != "draw" for row in axis.rows for key in row
    )
    return sorted(keys, key=lambda key: key != LABEL)


def _groups(file: pq.ParquetFile, names: list[str], size: int) -> Iterator[pa.Table]:
    """Some columns, in tables of `size` rows; the number of rows is a multiple of it."""
    held: list[pa.RecordBatch] = []
    for batch in file.iter_batches(columns=names):
        rows = pa.Table.from_batches([*held, batch])
        while len(rows) >= size:
            yield rows.slice(0, size)
            rows = rows.slice(size)
        held = rows.to_batches()
