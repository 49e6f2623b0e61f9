"""Device tables: text to columns of exact integers and floats, every bad cell named by file, line and column.

Integers (counters, time stamps) never pass through float: a float64 resolves today's time stamps to 128 ns only.
Clean files are read at once (acquisition.table.fast_path), others line by line: numpy's loadtxt parses strictly (no underscores, no
integer from `1e5`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray

from acquisition.flags import Flags, RowFlag
from acquisition.report import Finding
from acquisition.table.fast_path import FINE, clean_columns
from acquisition.table.header import SEPARATORS, Header, Kind, Layout, read_header, split_fields
from acquisition.table.rows import PlainRows, plain_rows
from acquisition.table.text import read_filled, text_of
from cell.errors import LogError

_NUMBER = {
    "integer": re.compile(r"[+-]?[0-9]+"),
    "float": re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?"),
    "decimal": re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?"),
}
_DTYPE = {"integer": np.int64, "float": np.float64, "decimal": np.float64}


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one or several device files, each row with the place it came from."""

    columns: dict[str, NDArray[Any]]  # (N,) int64, float64 or text each
    files: tuple[str, ...]
    file: NDArray[np.int64]  # (N,) index into files
    line: NDArray[np.int64]  # (N,) line number, counted from 1
    flags: Flags = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))  # (N,) row flags
    begins: NDArray[np.bool_] = field(
        default_factory=lambda: np.zeros(0, dtype=bool)
    )  # (N,) rows from which the logger ran anew

    def __post_init__(self) -> None:
        for name in ("flags", "begins"):
            values = getattr(self, name)
            if values.size != self.line.size:
                object.__setattr__(self, name, np.zeros(self.line.size, dtype=values.dtype))

    def __len__(self) -> int:
        return int(self.line.size)

    def place(self, row: int | np.integer) -> str:
        """`file:line` of a row."""
        return f"{self.files[self.file[row]]}:{self.line[row]}"

    def take(self, rows: NDArray[Any]) -> Table:
        """The chosen rows, by mask or index."""
        index = np.flatnonzero(rows) if rows.dtype == bool else rows
        if index.size == len(self) and (np.diff(index) == 1).all():
            return self  # all of them
        begins = (
            np.diff(np.cumsum(self.begins)[index], prepend=0) > 0
        )  # also where the row that began was left out
        columns = {name: values[index] for name, values in self.columns.items()}
        return Table(
            columns, self.files, self.file[index], self.line[index], self.flags[index], begins
        )

    def cell_place(self, row: int | np.integer, column: str) -> str:
        """`file:line: column name` of a cell."""
        return f"{self.place(row)}: column {column}"


@dataclass(frozen=True)
class Form:
    """How the table of one file was written."""

    encoding: str
    separator: str
    decimal: str
    rows_read: int


def read_table(
    path: Path, file: str, layout: Layout, findings: list[Finding]
) -> tuple[Table, Form]:
    """The wanted columns of one device file; repairs and warnings are appended to `findings`.

    file : the name that errors and findings give it.
    Raises LogError naming file, line and column if the table cannot be trusted.
    """
    raw = read_filled(path, file, findings)
    clean = clean_columns(raw, file, layout, findings)
    if clean is not None:
        header, columns = clean
        line = np.arange(
            header.row + 1, header.row + 1 + len(next(iter(columns.values()))), dtype=np.int64
        )
        table = Table(columns, (file,), np.zeros(line.size, dtype=np.int64), line)
        return table, Form("utf-8", SEPARATORS[header.separator], "point", line.size)
    return _mended_table(raw, file, layout, findings)


def _mended_table(
    raw: bytes, file: str, layout: Layout, findings: list[Finding]
) -> tuple[Table, Form]:
    """The wanted columns of a file that is not clean, line by line."""
    text = text_of(raw, file, findings)
    header = read_header(text, layout, findings)
    rows = plain_rows(text, header, layout, findings)
    line = rows.number
    flags = np.where(rows.repaired, np.uint32(RowFlag.REPAIRED), np.uint32(0))
    table = Table(
        _parse(rows, header), (file,), np.zeros(line.size, dtype=np.int64), line, flags, rows.begins
    )
    return table, Form(
        text.encoding,
        SEPARATORS[header.separator],
        rows.decimal,
        len(text.lines) - header.row + bool(header.glued),
    )


def _parse(rows: PlainRows, header: Header) -> dict[str, NDArray[Any]]:
    """The columns; text that holds nothing but whole numbers comes as such."""
    kinds: dict[str, Kind] = {
        name: "integer" if kind == "text" else kind for name, kind in header.columns.items()
    }
    columns = _numbers(rows, header, kinds)
    if columns is None and "text" in header.columns.values():
        columns = _numbers(
            rows, header, {name: kind for name, kind in header.columns.items() if kind != "text"}
        )
    if columns is None:
        _refuse_cell(rows, header)
    for name, position in zip(header.columns, header.positions, strict=True):
        coarse = header.columns[name] == "decimal" and np.abs(columns[name]).max() > FINE
        if name not in columns or coarse:
            cells = [
                line.split(rows.separator, position + 1)[position].strip() for line in rows.plain
            ]
            columns[name] = np.array(cells, dtype=object)
    return columns


def _numbers(
    rows: PlainRows, header: Header, kinds: Mapping[str, Kind]
) -> dict[str, NDArray[Any]] | None:
    """Columns of numbers; None if some cell is none."""
    if not kinds:
        return {}
    where = dict(zip(header.columns, header.positions, strict=True))
    dtype = np.dtype([(f"f{i}", _DTYPE[kind]) for i, kind in enumerate(kinds.values())])
    positions = [where[name] for name in kinds]
    with catch_warnings():
        # Before numpy 2.4, 1.1E+18 becomes an integer through float64, with this warning.
        simplefilter("error", DeprecationWarning)
        try:
            values = np.loadtxt(
                rows.plain,
                dtype=dtype,
                delimiter=rows.separator,
                comments=None,
                usecols=positions,
                ndmin=1,
            )
        except ValueError:
            return None
    columns = {name: np.ascontiguousarray(values[f"f{i}"]) for i, name in enumerate(kinds)}
    return columns if all(np.isfinite(column).all() for column in columns.values()) else None


def _refuse_cell(rows: PlainRows, header: Header) -> NoReturn:
    for line, number, mended in zip(rows.lines, rows.number, rows.plain, strict=True):
        written, cells = split_fields(line, rows.separator), split_fields(mended, rows.separator)
        for (name, kind), position in zip(header.columns.items(), header.positions, strict=True):
            wrong = _wrong_number(cells[position], kind) if kind != "text" else ""
            if wrong:
                raise LogError(
                    f"{rows.file}:{number}: column {name}: {written[position]!r} {wrong}"
                )
    raise LogError(f"{rows.file}: the table holds a cell that is no number.")


def _wrong_number(cell: str, kind: str) -> str:
    """What is wrong with a cell, in words; empty if nothing is."""
    if not cell:
        return "is an empty cell; a number was expected."
    if _NUMBER[kind].fullmatch(cell):
        if kind == "integer" and (len(cell) > 20 or not -(2**63) <= int(cell) < 2**63):
            return "does not fit a 64-bit integer."
        return "" if np.isfinite(float(cell)) else "is beyond the largest number."
    if kind == "integer" and _NUMBER["float"].fullmatch(cell):
        if "e" in cell.lower():
            return "is in exponent form: a spreadsheet has rounded it and digits are lost. Use the file as the logger wrote it."
        return "is not a whole number."
    return "is not a number."
