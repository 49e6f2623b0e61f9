"""The device files of one side of a recording as one table: dialect, columns, stamps in ns and in order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from acquisition.flags import Flags
from acquisition.formats.dialect import Dialect, dialect_file, load_dialect
from acquisition.formats.registry import read_file
from acquisition.report import FileSummary, Finding
from acquisition.stamps.order import STAMP, in_order, in_sequence, join
from acquisition.stamps.quantised import spread
from acquisition.table.header import Kind, Layout
from acquisition.table.table import Table
from acquisition.times import TIME_FORMS, TimeCells, TimeForm, recognised, stamps_ns, words
from cell.errors import DescriptionError, LogError
from cell.recording import EncoderFitting, EncoderName, SourceFile, SourceName
from cell.schema_errors import nearest

MINIMUM_ROWS = 50  # the complete model has up to 43 identifiable directions (thesis Tables 3.2-3.4); fewer rows fix nothing
_DEVICES: dict[SourceName, str] = {"robot": "robot", "ballbar": "ballbar", "force": "force sensor"}


@dataclass(frozen=True, eq=False)
class LogRows:
    """Every row of one side that was read, also those that no fit uses."""

    t: NDArray[np.float64]  # (N,) [s] from the first row that is used
    flags: Flags  # (N,)
    segment: NDArray[np.uint16]  # (N,)
    used: NDArray[np.bool_]  # (N,) whether the row is in the log


@dataclass(frozen=True)
class Side:
    """One side of the recording, and how its files are written."""

    folder: Path
    name: SourceName
    source: SourceFile
    dialect: Dialect
    layout: Layout
    status: dict[EncoderName, str] = field(
        default_factory=dict
    )  # status column of each fitted encoder


@dataclass
class Ledger:
    """What the report will say, while files are being read."""

    files: list[FileSummary]
    findings: list[Finding]
    rows: dict[SourceName, LogRows] = field(default_factory=dict)


def robot_layout(source: SourceFile, dialect: Dialect) -> Layout:
    """The columns of a robot's log."""
    return _layout(
        source,
        dialect,
        _all(dialect.angles, "float"),
        _all(dialect.torque_columns, "float") | _sequence(dialect),
        dialect.torque_columns,
    )


def ballbar_layout(
    source: SourceFile, dialect: Dialect, fitted: dict[EncoderName, EncoderFitting]
) -> Layout:
    """The columns of a ball-bar's log."""
    status = [dialect.status[name] for name in fitted if name in dialect.status]
    counters = [encoder.column for encoder in fitted.values()]
    return _layout(
        source, dialect, _all(counters, "integer"), _all(status, "integer") | _sequence(dialect)
    )


def force_layout(source: SourceFile, dialect: Dialect) -> Layout:
    """The columns of a force sensor's log."""
    return _layout(source, dialect, _all(dialect.wrench, "float"), _sequence(dialect))


def _sequence(dialect: Dialect) -> dict[str, Kind]:
    return {} if dialect.sequence is None else {dialect.sequence: "integer"}


def _all(columns: Sequence[str], kind: Kind) -> dict[str, Kind]:
    return dict.fromkeys(columns, kind)


def _layout(
    source: SourceFile,
    dialect: Dialect,
    required: dict[str, Kind],
    optional: dict[str, Kind],
    together: tuple[str, ...] = (),
) -> Layout:
    time = dialect.time
    if time.column in required:
        raise DescriptionError(
            f"column {time.column} holds the time stamps; it cannot be an encoder's too."
        )
    stamps: Kind = "text" if time.type is None else "decimal" if time.type == "float" else "integer"
    return Layout(
        separators=dialect.separators,
        required={time.column: stamps, **required},
        optional=optional,
        together=together,
        instead={time.column: time.halves} if time.halves else {},
        names=source.columns,
        headerless=dialect.headerless,
        decimal=dialect.decimal,
    )


def dialect_of(folder: Path, side: SourceName, source: SourceFile) -> Dialect:
    """The dialect of one side: a shipped one, or a file of the recording folder.

    Raises DescriptionError if there is none, or it is of another side.
    """
    place = f"{folder / 'recording.yaml'}: sources.{side}"
    try:
        own = source.dialect.endswith(".yaml")
        dialect = (
            dialect_file(inside(folder, source.dialect)) if own else load_dialect(source.dialect)
        )
    except DescriptionError as error:
        raise DescriptionError(f"{place}.dialect: {error}") from None
    if dialect.source != side:
        raise DescriptionError(
            f"{place}.dialect: {source.dialect} describes logs of the {_DEVICES[dialect.source]}, not of the {_DEVICES[side]}. "
            "Are the files swapped?"
        )
    if source.time is not None and source.time not in TIME_FORMS:
        raise DescriptionError(
            f"{place}.time: unknown form of time {source.time!r}.{nearest(source.time, list(TIME_FORMS), noun='form')}"
        )
    return dialect


def read_files(side: Side, ledger: Ledger) -> list[Table]:
    """All files of one side, each with stamps in order."""
    tables = [_read_file(side, file, ledger) for file in side.source.files]
    _refuse_differing(tables, side.layout.together)
    return tables


def joined(tables: list[Table]) -> Table:
    """All files of one side as one table.

    Raises LogError if they overlap, or hold too few rows.
    """
    table = join(tables)
    if len(table) < MINIMUM_ROWS:
        raise LogError(
            f"{', '.join(table.files)}: {len(table)} usable rows; at least {MINIMUM_ROWS} are needed."
        )
    return table


def _refuse_differing(tables: list[Table], together: tuple[str, ...]) -> None:
    """Columns that only some files have would be lost to all when they are joined."""
    without = [table.files[0] for table in tables if not table.columns.keys() >= set(together)]
    if without and len(without) < len(tables):
        raise LogError(
            f"{without[0]}: columns {', '.join(together)} missing, and other files of this source have them. "
            "Log them in every file, or remove them from all."
        )


def _read_file(side: Side, file: str, ledger: Ledger) -> Table:
    findings = ledger.findings
    table, form = read_file(inside(side.folder, file), file, side.dialect, side.layout, findings)
    shown, column, table = _with_stamps(side, table, findings)
    table = in_sequence(table, side.dialect.sequence, findings)
    table = in_order(spread(table, findings) if side.source.quantised else table, findings)
    ledger.files.append(
        FileSummary(
            file, side.name, side.source.dialect, form.encoding, form.separator, form.decimal, form.rows_read, len(table),
            f"{column} in {words(shown)}",
        )
    )  # fmt: skip
    return table


def _with_stamps(side: Side, table: Table, findings: list[Finding]) -> tuple[TimeForm, str, Table]:
    """The table of one file with its stamps in ns, the form they were in and their column."""
    time, columns = side.dialect.time, dict(table.columns)
    if time.column in columns:
        column, cells = time.column, columns.pop(time.column)
    else:
        assert time.halves is not None
        low, high = time.halves
        column, cells = (
            f"{low} and {high}",
            _put_together(table, columns.pop(low), columns.pop(high), time.halves),
        )
    stamps = TimeCells(table.files[0], column, cells, table.line)
    form = time_form(side.name, side.source, side.dialect, stamps)
    columns[STAMP] = stamps_ns(stamps, form, findings)
    return (
        form,
        column,
        Table(columns, table.files, table.file, table.line, table.flags, table.begins),
    )


def _put_together(
    table: Table, low: NDArray[np.int64], high: NDArray[np.int64], names: tuple[str, str]
) -> NDArray[np.int64]:
    """(N,) 64-bit counts of their 32-bit halves."""
    for name, half, most in ((names[0], low, 2**32), (names[1], high, 2**31)):
        outside = np.flatnonzero((half < 0) | (half >= most))
        if outside.size:
            raise LogError(
                f"{table.place(outside[0])}: column {name}: {half[outside[0]]} is no half of a 64-bit time."
            )
    return np.asarray((high << 32) | low)


def time_form(
    name: SourceName, source: SourceFile, dialect: Dialect, stamps: TimeCells
) -> TimeForm:
    """The form of the stamps of one file: declared by the recording or by the dialect, or the one that they show.

    Raises LogError if they show none.
    """
    if source.time is not None:
        return next(form for form in TIME_FORMS if form == source.time)
    if not dialect.time.forms:
        return dialect.time.possible[0]
    shown = {
        recognised(str(stamps.cells[row]), dialect.time.forms)
        for row in {0, len(stamps.cells) // 2, len(stamps.cells) - 1}
    }
    shown.discard(None)
    if len(shown) == 1:
        return next(form for form in TIME_FORMS if form in shown)
    raise LogError(
        f"{stamps.place(0)}: the form of the time stamps does not show: of {'; '.join(words(form) for form in dialect.time.forms)} it is "
        f"{'more than one' if shown else 'none'}. Declare it in recording.yaml, such as `sources.{name}.time: ms`; "
        f"forms: {', '.join(TIME_FORMS)}."
    )


def inside(folder: Path, file: str) -> Path:
    """The path of a device file, which must lie inside the recording folder, links followed."""
    named = PureWindowsPath(file)  # splits at both kinds of slash
    try:
        inside = (
            not named.anchor
            and ".." not in named.parts
            and (folder / file).resolve().is_relative_to(folder.resolve())
        )
    except (OSError, RuntimeError, ValueError):  # a link to itself, a NUL in the name
        inside = False
    if not inside:
        raise DescriptionError(
            f"{folder / 'recording.yaml'}: file {file!r} lies outside the recording folder. Move or copy it into the folder."
        )
    return folder / file
