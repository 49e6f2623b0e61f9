"""Device tables: text to columns of exact integers and floats, every bad cell with its location.

Integers (counters, time stamps) never pass through float: a float64 resolves today's time stamps to
128 ns only. Clean files are read at once (ballbar.acquisition.table.fast_path) where pyarrow is
installed, others line by line: numpy's loadtxt parses strictly (no underscores, no integer from
`1e5`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.flags import Flags, RowFlag
from ballbar.acquisition.report import Finding, finding
from ballbar.acquisition.table.header import FINE, Header, Kind, Layout, read_header
from ballbar.acquisition.table.rows import PlainRows, plain_rows
from ballbar.acquisition.table.text import (
    SEPARATORS,
    Content,
    LogText,
    open_filled,
    split_fields,
    text_of,
)
from ballbar.cell.errors import LogError, UnfinishedLogError

_FLOAT = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_NUMBER = {"integer": re.compile(r"[+-]?[0-9]+"), "float": _FLOAT, "decimal": _FLOAT}
_EMPTY = ("", "nan")  # a cell without a value
_DTYPE = {"integer": np.int64, "float": np.float64, "decimal": np.float64}


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one or several device files, each row with its location, and the findings."""

    columns: dict[str, NDArray[Any]]  # (N,) int64, float64 or text each
    files: tuple[str, ...]
    file: NDArray[np.int64]  # (N,) index into files
    line: NDArray[np.int64]  # (N,) line number, counted from 1
    flags: Flags = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))  # (N,) row flags
    # (N,) rows at which the logger started again
    begins: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        for name in ("flags", "begins"):
            values = getattr(self, name)
            if values.size != self.line.size:
                object.__setattr__(self, name, np.zeros(self.line.size, dtype=values.dtype))

    def __len__(self) -> int:
        return int(self.line.size)

    def location(self, row: int | np.integer) -> str:
        """`file:line` of a row."""
        return f"{self.files[self.file[row]]}:{self.line[row]}"

    def take(self, rows: NDArray[Any]) -> Table:
        """The chosen rows, by mask or index."""
        index = np.flatnonzero(rows) if rows.dtype == bool else rows
        if index.size == len(self) and (np.diff(index) == 1).all():
            return self  # all of them
        return replace(
            self,
            columns={name: values[index] for name, values in self.columns.items()},
            file=self.file[index],
            line=self.line[index],
            flags=self.flags[index],
            # Also where the row that began was left out.
            begins=np.diff(np.cumsum(self.begins)[index], prepend=0) > 0,
        )

    def flagged(self, rows: NDArray[Any], flag: RowFlag) -> Table:
        """The table with a flag set at some rows, by mask or index."""
        flags = self.flags.copy()
        flags[rows] |= np.uint32(flag)
        return replace(self, flags=flags)

    def remarked(
        self,
        kind: str,
        sentence: str,
        *,
        rows: NDArray[Any] | None = None,
        count: int | None = None,
        flag: RowFlag | None = None,
    ) -> Table:
        """The table with one finding more for each file that has some of the rows.

        rows : mask or indices; none for a finding about the first file as a whole.
        count : how often it was found; default the number of rows. flag : set at the rows.
        """
        if rows is None:
            entries = [finding(kind, self.files[0], sentence, count=count)]
        else:
            file, line = self.file[rows], self.line[rows]
            entries = [
                finding(kind, self.files[k], sentence, lines=line[file == k], count=count)
                for k in np.unique(file)
            ]
        table = replace(self, findings=(*self.findings, *entries))
        return table if flag is None or rows is None else table.flagged(rows, flag)


@dataclass(frozen=True)
class Form:
    """How the table of one file was written."""

    encoding: str
    separator: str
    decimal: str
    rows_read: int


def read_table(path: Path, file: str, layout: Layout) -> tuple[Table, Form]:
    """The wanted columns of one device file, and how they were written.

    file : the name that errors and findings give it.
    Raises LogError naming file, line and column if the table cannot be trusted.
    """
    clean = None
    with open_filled(path, file) as (source, unpacking):
        if find_spec("pyarrow"):
            from ballbar.acquisition.table.fast_path import clean_columns  # noqa: PLC0415

            clean = clean_columns(source, file, layout)
        if clean is None:
            source.seek(0)
            return text_table(text_of(Content(source.read(), unpacking), file), layout)
    header, columns, findings = clean
    rows = len(next(iter(columns.values())))
    line = np.arange(header.row + 1, header.row + 1 + rows, dtype=np.int64)
    findings = (*unpacking, *findings)
    table = Table(columns, (file,), np.zeros(rows, dtype=np.int64), line, findings=findings)
    return table, Form("utf-8", SEPARATORS[header.separator], "point", rows)


def text_table(text: LogText, layout: Layout) -> tuple[Table, Form]:
    """The wanted columns of a table, line by line; raises as `read_table`."""
    header = read_header(text, layout)
    rows = _with_zeros(signal_rows(text, header, layout), header, layout.all_empty)
    if layout.damaged_rows:
        rows = _without_damaged(rows, header, layout.damaged_rows)
    glued = text.number[header.row - 1] if header.glued else -1
    table = Table(
        columns=_parse(rows, header, layout.remedies.damaged),
        files=(text.file,),
        file=np.zeros(rows.number.size, dtype=np.int64),
        line=rows.number,
        flags=np.where(rows.number == glued, np.uint32(RowFlag.REPAIRED), np.uint32(0)),
        begins=rows.begins,
        findings=(*text.findings, *header.findings, *rows.findings),
    )
    rows_read = len(text.lines) - header.row + bool(header.glued)
    return table, Form(text.encoding, SEPARATORS[header.separator], rows.decimal, rows_read)


def signal_rows(text: LogText, header: Header, layout: Layout) -> PlainRows:
    """The complete rows of a text below its header, without those of other signals.

    Raises as `plain_rows` does, and UnfinishedLogError if there are none.
    """
    rows = plain_rows(text, header, layout)
    if not layout.signal:
        return rows
    positions = _positions(header, layout.signal)
    others = [k for k in range(rows.width) if k not in header.positions]

    def of_others(line: str) -> bool:
        first = line.split(rows.separator, positions[0] + 1)[positions[0]]
        if first.strip().lower() not in _EMPTY:
            return False
        cells = line.split(rows.separator)
        return not _any_filled(cells, positions) and _any_filled(cells, others)

    left_out = np.fromiter(map(of_others, rows.plain), dtype=bool, count=len(rows.plain))
    if left_out.all():
        what = f"no row has a value in {', '.join(header.names[k] for k in positions)}."
        remedy = "Name the columns of the signal, or record it too."
        raise UnfinishedLogError.at(rows.file, what, remedy)
    if not left_out.any():
        return rows
    sentence = f"they fill none of {', '.join(header.names[k] for k in positions)}; left out."
    lines = rows.number[left_out]
    return rows.take(np.flatnonzero(~left_out)).remarked(
        "rows of other signals", sentence, lines=lines
    )


def _positions(header: Header, columns: tuple[str, ...]) -> list[int]:
    """Field numbers, from 0, of wanted columns."""
    return [header.positions[list(header.columns).index(name)] for name in columns]


def _any_filled(cells: list[str], positions: list[int]) -> bool:
    return any(cells[k].strip().lower() not in _EMPTY for k in positions)


def _with_zeros(rows: PlainRows, header: Header, columns: tuple[str, ...]) -> PlainRows:
    """The rows with zeros in `columns` where all of them are empty."""
    if not columns:
        return rows
    positions = _positions(header, columns)

    def filled(line: str) -> str:
        cells = line.split(rows.separator)
        if _any_filled(cells, positions):
            return line
        for k in positions:
            cells[k] = "0"
        return rows.separator.join(cells)

    return replace(rows, plain=[filled(line) for line in rows.plain])


def _parse(rows: PlainRows, header: Header, remedy: str) -> dict[str, NDArray[Any]]:
    """The columns; text that holds nothing but whole numbers comes as such.

    remedy : of a cell that is no number.
    """
    wanted = header.columns
    kinds: dict[str, Kind] = {n: "integer" if k == "text" else k for n, k in wanted.items()}
    columns = _numbers(rows, header, kinds)
    if columns is None and "text" in wanted.values():
        columns = _numbers(rows, header, {n: k for n, k in wanted.items() if k != "text"})
    if columns is None:
        for row, number in enumerate(rows.number):
            if reason := _damage(rows, header, row):
                raise LogError(f"{rows.file}:{number}: {reason} {remedy}")
        raise LogError(f"{rows.file}: the table holds a cell that is no number. Export it again.")
    for name, position in zip(wanted, header.positions, strict=True):
        coarse = wanted[name] == "decimal" and np.abs(columns[name]).max() > FINE
        if name not in columns or coarse:
            split = (line.split(rows.separator, position + 1) for line in rows.plain)
            columns[name] = np.array([cells[position].strip() for cells in split], dtype=object)
    return columns


def _numbers(
    rows: PlainRows, header: Header, kinds: Mapping[str, Kind]
) -> dict[str, NDArray[Any]] | None:
    """Columns of numbers; None if some cell is none."""
    if not kinds:
        return {}
    position = dict(zip(header.columns, header.positions, strict=True))
    dtype = np.dtype([(f"f{i}", _DTYPE[kind]) for i, kind in enumerate(kinds.values())])
    positions = [position[name] for name in kinds]
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


def _without_damaged(rows: PlainRows, header: Header, limit: int) -> PlainRows:
    """The rows without those that hold a cell that is no number.

    Raises LogError where these are more than `limit`.
    """
    reasons = {
        row: reason for row in range(len(rows.lines)) if (reason := _damage(rows, header, row))
    }
    if not reasons:
        return rows
    damaged = np.array(list(reasons))
    first = f"{rows.file}:{rows.number[damaged[0]]}: {reasons[damaged[0]]}"
    if damaged.size > limit:
        raise LogError(
            f"{first} {damaged.size} rows are damaged so, and `damaged_rows` allows {limit}. "
            "Export the file again, or allow more."
        )
    whole = np.delete(np.arange(len(rows.lines)), damaged)
    if not whole.size:
        raise LogError(f"{first} No row is left. Export the file again.")
    sentence = f"{reasons[damaged[0]]} Left out, as `damaged_rows: {limit}` allows."
    lines = rows.number[damaged]
    return rows.take(whole).remarked("damaged row", sentence, lines=lines)


def _damage(rows: PlainRows, header: Header, row: int) -> str:
    """Column, cell and fault of the first wanted cell of a row that is no number; empty if none."""
    cells = split_fields(rows.plain[row], rows.separator)
    for (name, kind), position in zip(header.columns.items(), header.positions, strict=True):
        wrong = _wrong_number(cells[position], kind) if kind != "text" else ""
        if wrong:
            written = split_fields(rows.lines[row], rows.separator)[position]
            return f"column {name}: {written!r} {wrong}"
    return ""


def _wrong_number(cell: str, kind: str) -> str:
    """The fault of a cell as a clause; empty if there is none."""
    if not cell:
        return "is an empty cell; a number was expected."
    if _NUMBER[kind].fullmatch(cell):
        if kind == "integer" and (len(cell) > 20 or not -(2**63) <= int(cell) < 2**63):
            return "does not fit a 64-bit integer."
        return "" if np.isfinite(float(cell)) else "is beyond the largest number."
    if kind == "integer" and _FLOAT.fullmatch(cell):
        if "e" in cell.lower():
            lost = "a spreadsheet has rounded it and digits are lost"
            return f"is in exponent form: {lost}. Use the file as the logger wrote it."
        return "is not a whole number."
    return "is not a number."
