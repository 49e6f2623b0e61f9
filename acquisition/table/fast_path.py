"""Device tables without any fault, by pyarrow, which reads them as fast as pandas does.

Whatever is not plain (a torn or blank line, quotes, another encoding, a cell that is no number)
makes this reader give nothing, and ballbar.acquisition.table.table, which knows
what to do with it, reads the file from its first byte. So there is one place that repairs and
refuses, and clean files do not pay for it. pyarrow is as strict with numbers as that place but for
hexadecimal integers; both round to the nearest float64.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv

from ballbar.acquisition.report import Finding
from ballbar.acquisition.table.header import FINE, PREAMBLE, Header, Layout, read_header
from ballbar.acquisition.table.text import LONGEST_LINE, Content, LogText, text_of, unterminated
from ballbar.cell.errors import LogError

_TYPES = {"integer": pa.int64(), "text": pa.int64(), "decimal": pa.float64(), "float": pa.float64()}
_BLOCK = 1 << 19  # bytes parsed at a time by one thread
_PART = 1 << 23  # bytes of the file held at a time


def clean_columns(
    source: BinaryIO, file: str, layout: Layout
) -> tuple[Header, dict[str, NDArray[Any]], tuple[Finding, ...]] | None:
    """Header, wanted columns and findings of a table whose bytes are in place; None for others.

    source : the file, which is read in parts, so that a log of hours is never held as text. A last
        line that was cut off is dropped. What is written to the file meanwhile is left unread.
    """
    size = source.seek(0, os.SEEK_END)
    head = _head(source, file)
    if head is None or layout.decimal == "comma":
        return None
    try:
        header = read_header(head, layout)
    except LogError:
        return None
    if header.separator == " " or header.glued:
        return None
    columns = _columns(source, header, size)
    if columns is None:
        return None
    rest = b"".join(_read(source, size))
    if not _plain_unread(rest) or b"\r" in rest:
        return None
    line = header.row + len(next(iter(columns.values()))) + 1
    return header, columns, (*([unterminated(file, line)] if rest else []), *header.findings)


def _head(source: BinaryIO, file: str) -> LogText | None:
    """The lines among which the header is looked for, if they are plain."""
    source.seek(0)
    lines = [source.readline(LONGEST_LINE) for _ in range(PREAMBLE + 2)]
    first = b"".join(lines)
    first = first[: first.rfind(b"\n") + 1]
    if not first.isascii() or max(map(len, lines)) == LONGEST_LINE:
        return None
    try:
        head = text_of(Content(first), file)
    except LogError:
        return None
    return head if not head.findings and len(head.lines) == first.count(b"\n") else None


def _columns(source: BinaryIO, header: Header, size: int) -> dict[str, NDArray[Any]] | None:
    """The wanted columns of the whole rows below the header; what follows them is left unread.

    size : of the file [bytes].
    """
    source.seek(0)
    before = b"".join(source.readline() for _ in range(header.row))
    if _unread(header) and not _plain_unread(before):
        return None
    begin = source.tell()
    total = sum(part.count(b"\n") for part in _read(source, size))
    source.seek(begin)
    columns = {
        name: np.empty(total, dtype=np.int64 if _TYPES[kind] == pa.int64() else np.float64)
        for name, kind in header.columns.items()
    }
    row, end = 0, begin
    for part in _parts(source, size):
        table = _parsed(part, header)
        if table is None:
            return None
        for values, position in zip(columns.values(), header.positions, strict=True):
            _put(values[row : row + table.num_rows], table[f"f{position}"])
        row += table.num_rows
        end += len(part)
    source.seek(end)
    for name, kind in header.columns.items():
        if columns[name].dtype.kind == "f" and row:
            lower, upper = (
                float(columns[name].min()),
                float(columns[name].max()),
            )  # NaN where one is
            if not np.isfinite(upper - lower) or (kind == "decimal" and max(-lower, upper) > FINE):
                return None  # not finite, or digits were lost
    return columns if row else None


def _read(source: BinaryIO, size: int) -> Iterator[bytes]:
    """Parts of a file from where it stands up to a size [bytes]."""
    while part := source.read(max(0, min(_PART, size - source.tell()))):
        yield part


def _parts(source: BinaryIO, size: int) -> Iterator[bytes]:
    """Whole lines of a file up to a size [bytes], or up to a line that is too long."""
    rest = b""
    for part in _read(source, size):
        end = part.rfind(b"\n") + 1
        if end:
            yield rest + part[:end]
            rest = part[end:]
        else:
            rest += part
            if len(rest) > LONGEST_LINE:
                yield rest  # parses as no row
                return


def _parsed(part: bytes, header: Header) -> pa.Table | None:
    """The wanted columns of some lines, named f0, f1, ... by position; None if not plain."""
    # What pyarrow takes though it is not plain: hexadecimal integers, anything in unread columns.
    integers = {"integer", "text"} & set(header.columns.values())
    if integers and (b"x" in part or b"X" in part):
        return None
    if _unread(header) and not _plain_unread(part):
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
        table = csv.read_csv(pa.BufferReader(part), read, parse, convert)
    except pa.ArrowInvalid:
        return None
    return table if table.num_rows == part.count(b"\n") else None  # a CR alone ends a row too


def _put(out: NDArray[Any], column: pa.ChunkedArray) -> None:
    """Copies the numbers of a column to `out` (N,); pyarrow's own conversion imports pandas."""
    row = 0
    for part in column.chunks:
        out[row : row + len(part)] = np.frombuffer(
            part.buffers()[1], out.dtype, len(part), 8 * part.offset
        )
        row += len(part)


def _unread(header: Header) -> bool:
    """Whether there are columns that are not read."""
    return len(header.names) > len(header.columns)


def _plain_unread(part: bytes) -> bool:
    return not (b'"' in part or b"\0" in part) and part.isascii()
