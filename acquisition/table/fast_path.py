"""Device tables without any fault, by pyarrow, which reads them as fast as pandas does.

Whatever is not plain (a torn or blank line, quotes, another encoding, a cell that is no number, a
last line without line end) makes this reader give nothing, and acquisition.table.table, which knows
what to do with it, reads the file from its first byte. So there is one place that repairs and
refuses, and clean files do not pay for it. pyarrow is as strict with numbers as that place but for
hexadecimal integers; both round to the nearest float64.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv

from acquisition.table.header import PREAMBLE, Header, Kind, Layout, read_header
from acquisition.table.text import Content, LogText, text_of
from cell.errors import LogError

FINE = 4e6  # a float64 below it resolves 1e-9
_TYPES = {"integer": pa.int64(), "text": pa.int64(), "decimal": pa.float64(), "float": pa.float64()}
_BLOCK = 1 << 19  # bytes parsed at a time


def clean_columns(
    content: Content, file: str, layout: Layout
) -> tuple[Header, dict[str, NDArray[Any]]] | None:
    """Header and wanted columns of a table of whose bytes none is out of place; None for others."""
    raw = content.raw
    head = _head(raw, file)
    if head is None or layout.decimal == "comma":
        return None
    try:
        header = read_header(head, layout)
    except LogError:
        return None
    if header.separator == " " or header.glued:
        return None
    columns = _columns(raw, _offset(raw, header.row), header)
    return None if columns is None else (header, columns)


def _head(raw: bytes, file: str) -> LogText | None:
    """The lines among which the header is looked for, if they and the file's end are plain."""
    first = raw[: _offset(raw, PREAMBLE + 2)]
    if not raw.endswith(b"\n") or not first.isascii():
        return None
    try:
        head = text_of(Content(first), file)
    except LogError:
        return None
    return head if not head.findings and len(head.lines) == first.count(b"\n") else None


def _offset(raw: bytes, line: int) -> int:
    """Where a line begins, counted from 0; the size of the file if it has fewer."""
    at = 0
    for _ in range(line):
        at = raw.find(b"\n", at) + 1
        if not at:
            return len(raw)
    return at


def _columns(raw: bytes, begin: int, header: Header) -> dict[str, NDArray[Any]] | None:
    """The wanted columns of the rows from byte `begin` on."""
    if _passes_unseen(raw, begin, header):
        return None
    fields = [f"f{k}" for k in range(len(header.names))]
    kinds = zip(header.positions, header.columns.values(), strict=True)
    types = {fields[position]: _TYPES[kind] for position, kind in kinds}
    read = csv.ReadOptions(use_threads=True, column_names=fields, block_size=_BLOCK)
    parse = csv.ParseOptions(delimiter=header.separator, quote_char=False, ignore_empty_lines=False)
    convert = csv.ConvertOptions(
        column_types=types, include_columns=list(types), null_values=[], strings_can_be_null=False
    )
    try:
        table = csv.read_csv(pa.BufferReader(pa.py_buffer(raw).slice(begin)), read, parse, convert)
    except pa.ArrowInvalid:
        return None
    # A CR alone ends a row too.
    if not table.num_rows or (b"\r" in raw and table.num_rows != raw.count(b"\n", begin)):
        return None
    columns = {
        name: _values(table[fields[position]])
        for name, position in zip(header.columns, header.positions, strict=True)
    }
    plain = all(_plain(columns[name], kind) for name, kind in header.columns.items())
    return columns if plain else None


def _values(column: pa.ChunkedArray) -> NDArray[Any]:
    """(N,) the numbers of a column; pyarrow's own conversion imports pandas."""
    dtype = np.int64 if column.type == pa.int64() else np.float64
    chunks = column.chunks
    return np.concatenate(
        [np.frombuffer(part.buffers()[1], dtype, len(part), 8 * part.offset) for part in chunks]
    )


def _passes_unseen(raw: bytes, begin: int, header: Header) -> bool:
    """Whether the rows may hold what pyarrow takes though it is not plain.

    Hexadecimal integers, and anything in columns that are not read.
    """
    integers = {"integer", "text"} & set(header.columns.values())
    if integers and (raw.find(b"x", begin) >= 0 or raw.find(b"X", begin) >= 0):
        return True
    unread = len(header.names) > len(header.columns)
    return unread and (b'"' in raw or b"\0" in raw or not raw.isascii())


def _plain(column: NDArray[Any], kind: Kind) -> bool:
    """Whether all numbers of a column (N,) are finite, and none has lost digits."""
    if column.dtype.kind == "i":
        return True
    lower, upper = float(column.min()), float(column.max())  # NaN if there is one
    return bool(np.isfinite(upper - lower)) and (kind != "decimal" or max(-lower, upper) <= FINE)
