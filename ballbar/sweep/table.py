"""Rows of a sweep: chunks of a few runs as JSON, their table as Parquet and CSV, and its summary.

Columns: sweep, scenario, version, run, point, seed, status (`done` or `failed`), reason, the varied
values by their dotted key (and `label`), then the results in the order in which runs first return
them. A result that a run does not return is null. The same rows give the same bytes: no times, no
names of machines, one writer setting. Rows are written and read some at a time: a sweep may be
larger than the memory.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import reduce
from itertools import chain, islice
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.extended_yaml import Value
from ballbar.cell.files import written_whole
from ballbar.cell.foreign_text import csv_text
from ballbar.sweep.chunk import FAILED, Row
from ballbar.sweep.file import LABEL, Changes
from ballbar.sweep.plan import Plan, point_of

# Rows of a row group, held in memory at once: 10 000 runs take the memory of 100.
GROUP_ROWS = 2_000
MAIN_RESULTS = ("distance_mm_mrad", "tcp_mean_mm")  # the results of a run that are summarised
MAX_POINTS = 40  # points of the grid that are shown: a terminal's height

_FIXED = {
    **dict.fromkeys(("sweep", "scenario", "version"), pa.string()),
    **dict.fromkeys(("run", "point", "seed"), pa.int64()),
    **dict.fromkeys(("status", "reason"), pa.string()),
}
_TYPES = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), type(None): pa.null()}
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


def chunk_rows(chunk: Path) -> dict[int, Row]:
    """Number of a run -> its row, of a finished chunk.

    Raises InputError when the chunk cannot be read.
    """
    try:
        return {row["run"]: row for row in json.loads(chunk.read_bytes())}
    except (OSError, ValueError) as error:
        remedy = "Delete this file and run the sweep again; only its runs are repeated."
        raise InputError.at(chunk, f"cannot be read: {error}.", remedy) from None


def _column_types(
    chunks: Sequence[Path], varied: Mapping[str, list[Value]]
) -> dict[str, pa.DataType]:
    """Types of all columns: fixed ones, varied values, and results."""
    types = _FIXED | {key: reduce(_common, map(_type, v), pa.null()) for key, v in varied.items()}
    results: dict[str, pa.DataType] = {}
    for row in _rows(chunks):
        for name, value in row.items():
            if name not in types:
                results[name] = _common(results.get(name, pa.null()), _type(value))
    none = pa.float64()
    return types | {n: none if pa.types.is_null(kind) else kind for n, kind in results.items()}


def write_table(
    chunks: Sequence[Path], varied: Mapping[str, list[Value]], files: Mapping[str, Path]
) -> None:
    """Streams all chunks, in order, into the table's files; each appears complete or not at all.

    varied : key -> values that give its column a type. files : path of `parquet` and of `csv`.

    Raises InputError when a chunk cannot be read.
    """
    types = _column_types(chunks, varied)
    schema = pa.schema(list(types.items()))
    with ExitStack() as stack:
        aside = {kind: stack.enter_context(written_whole(path)) for kind, path in files.items()}
        parquet = stack.enter_context(pq.ParquetWriter(aside["parquet"], schema))
        csv = stack.enter_context(pa_csv.CSVWriter(aside["csv"], schema))
        rows = _rows(chunks)
        while group := list(islice(rows, GROUP_ROWS)):
            columns = {n: [_as(kind, row.get(n)) for row in group] for n, kind in types.items()}
            parquet.write_table(pa.table(columns, schema))
            for name, kind in types.items():  # text that no spreadsheet runs
                if pa.types.is_string(kind):
                    columns[name] = [t if t is None else csv_text(t) for t in columns[name]]
            csv.write_table(pa.table(columns, schema))


def _rows(chunks: Sequence[Path]) -> Iterator[Row]:
    return chain.from_iterable(chunk_rows(chunk).values() for chunk in chunks)


def _type(value: Value) -> pa.DataType:
    """Type of a truth value, whole number, number or text; lists and mappings are text."""
    return _TYPES.get(type(value), pa.string())


def _common(kind: pa.DataType, other: pa.DataType) -> pa.DataType:
    """The narrowest type for the values of two types."""
    if kind == other or pa.types.is_null(other):
        return kind
    if pa.types.is_null(kind):
        return other
    return pa.float64() if {kind, other} <= {pa.int64(), pa.float64()} else pa.string()


def _as(kind: pa.DataType, value: Value) -> Value:
    """A value as its column holds it; in a column of text, whatever is no text becomes JSON."""
    if value is None or isinstance(value, str) or not pa.types.is_string(kind):
        return float(value) if pa.types.is_floating(kind) and value is not None else value
    return json.dumps(value)


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
    file, size = pq.ParquetFile(table), plan.grid_point_runs
    names = [name for name in MAIN_RESULTS if name in file.schema_arrow.names]
    rows = file.read(columns=["status", *names])
    for first in range(0, min(plan.runs, MAX_POINTS * size), size):
        done = rows.slice(first, size).filter(pc.field("status") != FAILED)
        results = {name: done[name].drop_null().to_numpy() for name in names}
        point = point_of(plan, first // plan.seeds)
        values = {key: value for key, value in point.items() if key not in plan.data.draw}
        yield GridPoint(values, size, size - len(done), results)


def grid_keys(plan: Plan) -> list[str]:
    """Keys of the grid's values, `label` first."""
    grid = [axis for axis in plan.axes if axis.section != "draw"]
    keys = dict.fromkeys(key for axis in grid for row in axis.rows for key in row)
    return sorted(keys, key=lambda key: key != LABEL)
