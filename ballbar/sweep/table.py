"""Rows of a sweep as Parquet and CSV: parts of a few runs, and the one table that they make.

Columns: sweep, scenario, version, run, point, seed, status (`done` or `failed`), reason, the varied values by their dotted
key (and `label`), then the figures in the order in which runs first return them. A figure that a run does not return is
null. The same rows give the same bytes: no times, no names of machines, one writer setting.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from ballbar.sweep.file import Value
from ballbar.sweep.part import Row
from cell.errors import InputError

GROUP_ROWS = 2_000  # rows of the table held in memory at once, and of one row group: the memory of 10 000 runs is that of 100

_FIXED = {
    "sweep": pa.string(),
    "scenario": pa.string(),
    "version": pa.string(),
    "run": pa.int64(),
    "point": pa.int64(),
    "seed": pa.int64(),
    "status": pa.string(),
    "reason": pa.string(),
}


def part_bytes(rows: Sequence[Row], varied: Mapping[str, list[Value]]) -> bytes:
    """A part as a Parquet file.

    rows : one a run, each with the fixed columns, the varied ones and its figures. varied : key -> values that give its
    column a type, the same in every part. Raises ValueError when a figure has the name of another column.
    """
    known = {**_FIXED, **{key: _type_of(values) for key, values in varied.items()}}
    figures = dict.fromkeys(name for row in rows for name in row if name not in known)
    arrays = {
        name: pa.array([_as(kind, row.get(name)) for row in rows], kind)
        for name, kind in known.items()
    }
    for name in figures:
        column = [row.get(name) for row in rows]
        kind = _type_of(column)
        arrays[name] = pa.array([_as(kind, value) for value in column], kind)
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(arrays), sink, write_statistics=False)
    return bytes(sink.getvalue())


def write_table(parts: Sequence[Path], files: Mapping[str, Path]) -> None:
    """Streams all parts, in order, into the table's files; each appears whole or not at all.

    files : `parquet` and `csv`. Raises InputError when a part cannot be read.
    """
    schema = table_schema(parts)
    with ExitStack() as stack:
        aside = {kind: stack.enter_context(_whole(path)) for kind, path in files.items()}
        parquet = stack.enter_context(pq.ParquetWriter(aside["parquet"], schema))
        csv = stack.enter_context(pa_csv.CSVWriter(aside["csv"], schema))
        for group in _groups(parts, schema):
            parquet.write_table(group)
            csv.write_table(group)


def table_schema(parts: Iterable[Path]) -> pa.Schema:
    """Every column that a part has, in the order of first appearance, with a type that holds all its values."""
    types: dict[str, pa.DataType] = {}
    for part in parts:
        for field in _opened(part).schema_arrow:
            types[field.name] = _common(types.get(field.name, pa.null()), field.type)
    return pa.schema(
        [(name, pa.float64() if pa.types.is_null(kind) else kind) for name, kind in types.items()]
    )


def _groups(parts: Iterable[Path], schema: pa.Schema) -> Iterator[pa.Table]:
    """Rows of all parts in their order, in tables of GROUP_ROWS rows but the last."""
    held: list[pa.Table] = []
    for part in parts:
        held.append(_in_schema(_opened(part).read(use_threads=False), schema))
        while sum(map(len, held)) >= GROUP_ROWS:
            rows = pa.concat_tables(held)
            yield rows.slice(0, GROUP_ROWS).combine_chunks()
            held = [rows.slice(GROUP_ROWS)]
    if sum(map(len, held)):
        yield pa.concat_tables(held).combine_chunks()


def _in_schema(rows: pa.Table, schema: pa.Schema) -> pa.Table:
    columns = [
        rows[field.name].cast(field.type)
        if field.name in rows.column_names
        else pa.nulls(len(rows), field.type)
        for field in schema
    ]
    return pa.table(columns, schema=schema)


def _opened(part: Path) -> pq.ParquetFile:
    try:
        return pq.ParquetFile(part)
    except (OSError, pa.ArrowInvalid) as error:
        raise InputError(
            f"{part}: cannot be read: {error}. Delete this file and run the sweep again; only its runs are repeated."
        ) from None


def _type_of(values: Iterable[Value]) -> pa.DataType:
    """The narrowest of truth values, whole numbers, numbers and text that holds all values; lists and mappings are text."""
    kind = pa.null()
    for value in values:
        kind = _common(kind, _type_of_one(value))
    return kind


def _type_of_one(value: Value) -> pa.DataType:
    if value is None:
        return pa.null()
    for python, kind in ((bool, pa.bool_()), (int, pa.int64()), (float, pa.float64())):
        if isinstance(value, python):
            return kind
    return pa.string()


def _common(one: pa.DataType, other: pa.DataType) -> pa.DataType:
    if one == other or pa.types.is_null(other):
        return one
    if pa.types.is_null(one):
        return other
    numbers = {pa.int64(), pa.float64()}
    return pa.float64() if {one, other} <= numbers else pa.string()


def _as(kind: pa.DataType, value: Value) -> Value:
    """A value as its column holds it: in a column of text, what is no text stands as it would in JSON."""
    if value is None or isinstance(value, str) or not pa.types.is_string(kind):
        return float(value) if pa.types.is_floating(kind) and value is not None else value
    return json.dumps(value)


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """A file beside `path` to write to; it takes its place at the end, and is gone if anything fails."""
    aside = path.with_name(f".{path.name}.part")
    try:
        yield aside
        with aside.open("rb") as file:
            os.fsync(file.fileno())
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)
