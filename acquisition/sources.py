"""The device files of one source of a recording as one table, with stamps in ns and in order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.faults.publishers import refuse_two_publishers
from ballbar.acquisition.flags import Flags
from ballbar.acquisition.formats.registry import read_file
from ballbar.acquisition.report import FileSummary, Finding
from ballbar.acquisition.stamps.arrival import of_one_source, with_source_times
from ballbar.acquisition.stamps.order import STAMP, in_order, in_sequence, join, without_strays
from ballbar.acquisition.stamps.quantised import spread
from ballbar.acquisition.table.header import Kind, Layout
from ballbar.acquisition.table.table import Table
from ballbar.acquisition.times import (
    TimeCells,
    checked_form,
    day_of,
    form_shown,
    popped_stamps,
    stamps_ns,
    words,
)
from ballbar.cell.dialect import Dialect, TimeForm, dialect_file, load_dialect
from ballbar.cell.errors import DescriptionError, LogError, UnfinishedLogError
from ballbar.cell.foreign_files import repeated
from ballbar.cell.logs import SourceName
from ballbar.cell.neighbours import Mask
from ballbar.cell.recording import EncoderFitting, EncoderName, LengthFile, SourceFile, TrackerFile

# The complete model has up to 43 identifiable directions (thesis Tables 3.2-3.4); fewer rows fix
# nothing.
MINIMUM_ROWS = 50
_DEVICES: dict[SourceName, str] = {
    "robot": "robot",
    "ballbar": "ballbar",
    "length": "length sensor",
    "force": "force sensor",
    "tracker": "optical tracker",
}


Fitted = Mapping[EncoderName, EncoderFitting]


@dataclass(frozen=True, eq=False)
class LogRows:
    """Every row of one source that was read, also those that no fit uses."""

    flags: Flags  # (N,)
    segment: NDArray[np.uint16]  # (N,)
    used: Mask  # (N,) whether the row is in the log


@dataclass(frozen=True, eq=False)
class ImportLog:
    """The outcome of reading one source."""

    files: tuple[FileSummary, ...]
    findings: tuple[Finding, ...]
    rows: LogRows


@dataclass(frozen=True)
class LogSource:
    """One source of a recording, and how its files are written."""

    folder: Path
    name: SourceName
    declared: SourceFile
    dialect: Dialect
    layout: Layout


def log_source(
    folder: Path,
    name: SourceName,
    declared: SourceFile,
    *,
    axes: int | None = None,
    encoders: Fitted | None = None,
) -> LogSource:
    """One source of a recording; axes : of the robot whose log it is, encoders : the ball-bar's.

    Raises DescriptionError if there is no such dialect, or it does not fit the source.
    """
    dialect = _dialect(folder, name, declared)
    if axes is not None:
        dialect = dialect.for_axes(axes)
    return LogSource(folder, name, declared, dialect, layout_of(declared, dialect, encoders or {}))


def layout_of(source: SourceFile, dialect: Dialect, encoders: Fitted | None = None) -> Layout:
    """The columns of a log; encoders : those of a ball-bar, by name."""
    time, fitted = dialect.time, encoders or {}
    required: dict[str, Kind] = {}
    optional: dict[str, Kind] = dict.fromkeys(dialect.torque_columns, "float")
    turns = source.rotation if isinstance(source, TrackerFile) else None
    target_turns = turns.columns if turns else ()
    match dialect.source:
        case "robot":
            required = dict.fromkeys(dialect.angles, "float")
        case "ballbar":
            required = dict.fromkeys((encoder.column for encoder in fitted.values()), "integer")
            status = (dialect.status[name] for name in fitted if name in dialect.status)
            optional = dict.fromkeys(status, "integer")
        case "length" if isinstance(source, LengthFile):
            required = {source.column: "float"}
        case "force":
            required = dict.fromkeys(dialect.wrench, "float")
        case "tracker" if isinstance(source, TrackerFile):
            required = dict.fromkeys((*dialect.point, *target_turns), "float")
    signal, stamped = tuple(required), time.columns
    if twice := [name for name in stamped if name in required]:
        raise DescriptionError(
            f"column {twice[0]} holds the time stamps; it cannot be an encoder's too. "
            "Name another one for the encoder."
        )
    if dialect.sequence is not None:
        optional[dialect.sequence] = "integer"
    stamps: Kind = "text" if time.type is None else "decimal" if time.type == "float" else "integer"
    if time.nanoseconds is not None:  # whole numbers, which some loggers write as 1720702091.0
        stamps = "float"
    return Layout(
        separators=dialect.separators,
        required={**dict.fromkeys(stamped, stamps), **required},
        optional=optional,
        together=dialect.torque_columns,
        instead={time.column: time.halves} if time.halves else {},
        names=source.columns,
        headerless=dialect.headerless,
        decimal=dialect.decimal,
        all_empty=(*dialect.point, *target_turns),  # a hidden target has no coordinates
        signal=signal,
        damaged_rows=source.damaged_rows,
    )


def _dialect(folder: Path, name: SourceName, source: SourceFile) -> Dialect:
    """The dialect of one source: a shipped one, or a file of the recording folder.

    Raises DescriptionError if there is none, or it is of another source.
    """
    location = f"{folder / 'recording.yaml'}: sources.{name}"
    try:
        if source.dialect.endswith(".yaml"):
            dialect = dialect_file(inside(folder, source.dialect))
        else:
            dialect = load_dialect(source.dialect)
    except DescriptionError as error:
        raise DescriptionError(f"{location}.dialect: {error}") from None
    if dialect.source != name:
        devices = f"{_DEVICES[dialect.source]}, not of the {_DEVICES[name]}. Are the files swapped?"
        what, remedy = f"{source.dialect} describes logs of the {devices}", "Exchange them, or name"
        raise DescriptionError.at(f"{location}.dialect", what, f"{remedy} another dialect.")
    if source.time is not None:
        checked_form(source.time, f"{location}.time")
    return dialect


@dataclass(frozen=True, eq=False)
class SourceFiles:
    """The files of one source, each a table with stamps in order."""

    source: LogSource
    tables: list[Table]
    summaries: list[FileSummary]

    def joined(self) -> Table:
        """All files as one table. Raises LogError if they overlap, or hold too few rows."""
        table = join(self.tables)
        refuse_few(table, len(table))
        return table


def read_files(source: LogSource) -> SourceFiles:
    """All files of one source.

    Raises LogError for columns that only some files have: joining would lose them to all.
    """
    if twice := repeated(source.folder, source.declared.files):
        what = f"sources.{source.name}.files: {twice[0]!r} and {twice[1]!r} are one file."
        raise DescriptionError.at(source.folder / "recording.yaml", what, "Name it once.")
    read = [_read_file(source, file) for file in source.declared.files]
    tables, together = [table for table, _ in read], source.layout.together
    without = [table.files[0] for table in tables if not table.columns.keys() >= set(together)]
    if without and len(without) < len(tables):
        what = f"columns {', '.join(together)} missing, and other files of this source have them."
        raise LogError.at(without[0], what, "Log them in every file, or remove them from all.")
    return SourceFiles(source, tables, [summary for _, summary in read])


def refuse_few(table: Table, rows: int) -> None:
    """Raises LogError if so many rows of a table are too few for a fit."""
    if rows < MINIMUM_ROWS:
        files = ", ".join(table.files)
        what = f"{rows} usable rows; at least {MINIMUM_ROWS} are needed."
        raise UnfinishedLogError.at(files, what, "Log a longer run, or at a higher rate.")


def _read_file(source: LogSource, file: str) -> tuple[Table, FileSummary]:
    table, form = read_file(inside(source.folder, file), file, source.dialect, source.layout)
    table, time = with_stamps(source, table)
    table = in_sequence(table, source.dialect.sequence)
    angles = {"robot": source.dialect.angle_unit, "ballbar": "counts"}
    unit = getattr(source.declared, "unit", angles.get(source.name, ""))
    raw, table = table, spread(table, source.declared.quantised)
    if source.declared.quantised is None:
        table = with_source_times(without_strays(table), source.layout.signal)
    if not of_one_source(table):  # bursts of one source are no pairs of two
        refuse_two_publishers(raw, source.layout.signal, unit)
    table = in_order(table)
    summary = FileSummary(
        file=file,
        source=source.name,
        dialect=source.declared.dialect,
        rows_kept=len(table),
        time=time,
        day=day_of(table.columns[STAMP]),
        **asdict(form),
    )
    return table, summary


def with_stamps(source: LogSource, table: Table) -> tuple[Table, str]:
    """The table of one file with its stamps in ns, and a text of their column and form."""
    time, columns = source.dialect.time, dict(table.columns)
    if time.column not in columns and time.halves is not None:
        column = " and ".join(time.halves)
        cells: NDArray[Any] = np.zeros(len(table), dtype=np.int64)
        for k, name in enumerate(time.halves):  # the lower 32 bits, then the upper
            half = columns.pop(name)
            outside = np.flatnonzero((half < 0) | (half >= 2 ** (32 - k)))
            if outside.size:
                what = f"column {name}: {half[outside[0]]} is no half of a 64-bit time."
                raise LogError.at(table.location(outside[0]), what, "Log both halves as UDINT.")
            cells |= half << (32 * k)
        stamps = TimeCells(table.files[0], column, cells, table.line)
    else:
        stamps = popped_stamps(columns, time.columns, table.files[0], table.line)
    form = time_form(source, stamps)
    columns[STAMP], findings = stamps_ns(stamps, form)
    table = replace(table, columns=columns, findings=(*table.findings, *findings))
    return table, f"{stamps.column} in {words(form)}"


def time_form(source: LogSource, stamps: TimeCells) -> TimeForm:
    """The form of the stamps of one file: declared by recording or dialect, or the one they show.

    Raises LogError if they show none.
    """
    if source.declared.time is not None:
        return checked_form(source.declared.time, source.name)
    time = source.dialect.time
    declare = f"in recording.yaml, such as `sources.{source.name}.time: ms`"
    return form_shown(stamps, time.forms, declare) if time.forms else time.possible[0]


def inside(folder: Path, file: str) -> Path:
    """The path of a device file, which must lie inside the recording folder, links followed."""
    named = PureWindowsPath(file)  # splits at both kinds of slash
    try:
        relative = not named.anchor and ".." not in named.parts
        within = relative and (folder / file).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a link to itself, a NUL in the name
        within = False
    if not within:
        raise DescriptionError(
            f"{folder / 'recording.yaml'}: file {file!r} lies outside the recording folder. Move "
            "or copy it into the folder."
        )
    return folder / file
