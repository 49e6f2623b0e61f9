"""Rows of a sweep as Parquet and CSV: chunks of a few runs, and the table that they make.

Columns: sweep, scenario, version, run, point, seed, status (`done` or `failed`), reason, the varied
values by their dotted key (and `label`), then the results in the order in which runs first return
them. A result that a run does not return is null. The same rows give the same bytes: no times, no
names of machines, one writer setting.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import lru_cache, reduce
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from ballbar.sweep.chunk import Row
from cell.errors import InputError
from cell.extended_yaml import Value
from cell.files import written_whole
from cell.foreign_text import csv_text

# Rows of a row group, held in memory at once: 10 000 runs take the memory of 100.
GROUP_ROWS = 2_000

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


def chunk_bytes(rows: Sequence[Row], varied: Mapping[str, list[Value]]) -> bytes:
    """A chunk as a Parquet file.

    rows : one for each run, with the fixed columns, the varied ones and its results.
    varied : key -> values that give its column a type, the same in every chunk.
    """
    types = _FIXED | {key: _type_of(values) for key, values in varied.items()}
    arrays = {}
    for name in dict.fromkeys((*types, *(name for row in rows for name in row))):
        column = [row.get(name) for row in rows]
        kind = types[name] if name in types else _type_of(column)
        arrays[name] = pa.array([_as(kind, value) for value in column], kind)
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(arrays), sink, write_statistics=False)
    return bytes(sink.getvalue())


@lru_cache(maxsize=8)
def chunk_rows(chunk: Path) -> dict[int, Row]:
    """Number of a run -> its row, of a finished chunk; results that a run has not are left out.

    Raises InputError when the chunk cannot be read.
    """
    rows = _opened(chunk).read(use_threads=False).to_pylist()
    return {row["run"]: {k: v for k, v in row.items() if v is not None} for row in rows}


def write_table(chunks: Sequence[Path], files: Mapping[str, Path]) -> None:
    """Streams all chunks, in order, into the table's files; each appears complete or not at all.

    files : path of `parquet` and of `csv`. Raises InputError when a chunk cannot be read.
    """
    schema = _schema(chunks)
    with ExitStack() as stack:
        aside = {kind: stack.enter_context(written_whole(path)) for kind, path in files.items()}
        parquet = stack.enter_context(pq.ParquetWriter(aside["parquet"], schema))
        csv = stack.enter_context(pa_csv.CSVWriter(aside["csv"], schema))
        rows = (_in_schema(_opened(chunk).read(use_threads=False), schema) for chunk in chunks)
        for group in regrouped(rows, GROUP_ROWS):
            parquet.write_table(group)
            harmless = group  # text that no spreadsheet runs
            for i, field in enumerate(schema):
                if pa.types.is_string(field.type):
                    cells = [t if t is None else csv_text(t) for t in group[i].to_pylist()]
                    harmless = harmless.set_column(i, field, pa.array(cells, field.type))
            csv.write_table(harmless)


def _schema(chunks: Iterable[Path]) -> pa.Schema:
    """Every column of the chunks, in order of first appearance, with a type for all its values."""
    types: dict[str, pa.DataType] = {}
    for chunk in chunks:
        for field in _opened(chunk).schema_arrow:
            types[field.name] = _common(types.get(field.name, pa.null()), field.type)
    return pa.schema(
        [(name, pa.float64() if pa.types.is_null(kind) else kind) for name, kind in types.items()]
    )


def regrouped(tables: Iterable[pa.Table], size: int) -> Iterator[pa.Table]:
    """The same rows in tables of `size` rows; the last one may have fewer."""
    waiting: list[pa.Table] = []
    for table in tables:
        waiting.append(table)
        while sum(map(len, waiting)) >= size:
            rows = pa.concat_tables(waiting)
            yield rows.slice(0, size).combine_chunks()
            waiting = [rows.slice(size)]
    if sum(map(len, waiting)):
        yield pa.concat_tables(waiting).combine_chunks()


def _in_schema(rows: pa.Table, schema: pa.Schema) -> pa.Table:
    columns = [
        rows[field.name].cast(field.type)
        if field.name in rows.column_names
        else pa.nulls(len(rows), field.type)
        for field in schema
    ]
    return pa.table(columns, schema=schema)


def _opened(chunk: Path) -> pq.ParquetFile:
    try:
        return pq.ParquetFile(chunk)
    except (OSError, pa.ArrowInvalid) as error:
        raise InputError(
            f"{chunk}: cannot be read: {error}. Delete this file and run the sweep again; only its "
            "runs are repeated."
        ) from None


def _type_of(values: Iterable[Value]) -> pa.DataType:
    """The narrowest type for all values: truth values, whole numbers, numbers, or text.

    Lists and mappings are text.
    """
    types = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), type(None): pa.null()}
    return reduce(_common, (types.get(type(value), pa.string()) for value in values), pa.null())


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
