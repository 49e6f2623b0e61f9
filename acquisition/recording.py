"""A recording folder to clean angles and loads: every device file read by its dialect, each side on its own clock.

    recording.yaml -> dialects -> tables -> stamps in order -> counts or motor angles -> rad -> RobotLog, BallBarLog, ForceLog

Everything that was mended on the way stands in the import report; what cannot be mended is an error with file and line.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from acquisition.containers import read_file
from acquisition.dialect import Dialect, SourceName, load_dialect
from acquisition.encoders import encoder_angles, without_faults
from acquisition.layout import Layout
from acquisition.motors import gear_torques, joint_angles, moves
from acquisition.report import FileSummary, Finding, ImportReport
from acquisition.stamps import in_order, join, report_periods, seconds_from_first
from acquisition.table import Table
from cell.descriptions import Robot, load_robot
from cell.errors import DescriptionError, LogError
from cell.logs import BallBarLog, ForceLog, RobotLog
from cell.recording import EncoderFitting, EncoderName, RecordingFile, SourceFile, load_recording_file

MINIMUM_ROWS = 50  # the complete model has up to 43 identifiable directions (thesis Tables 3.2-3.4); fewer rows fix nothing

_DEVICES: dict[SourceName, str] = {"robot": "robot", "ballbar": "ballbar", "force": "force sensor"}


@dataclass(frozen=True, eq=False)
class Recording:
    """One recording, read."""

    description: RecordingFile
    robot_log: RobotLog
    ballbar_log: BallBarLog | None  # none for a sensor-less ball-bar
    force_log: ForceLog | None  # none without a force sensor
    report: ImportReport


@dataclass(frozen=True)
class _Side:
    """One side of the recording, and how its files are written."""

    folder: Path
    name: SourceName
    source: SourceFile
    dialect: Dialect
    layout: Layout
    status: dict[EncoderName, str]  # status column of each fitted encoder


@dataclass
class _Ledger:
    """What the report will say, while files are being read."""

    files: list[FileSummary]
    findings: list[Finding]


def read_recording(folder: Path) -> Recording:
    """Joint angles, encoder angles and logged loads of a recording folder, with the import report.

    Raises DescriptionError if recording.yaml is wrong or contradicts itself, LogError if a device file cannot be trusted.
    """
    if not folder.is_dir():
        raise DescriptionError(f"{folder}: no such folder. A recording is a folder with recording.yaml and the device files.")
    description = load_recording_file(folder)
    _check_encoders(folder, description)
    robot = load_robot(description.robot, relative_to=folder)
    ledger = _Ledger([], [])
    robot_log = _read_robot(folder, description.sources.robot, robot, ledger)
    ballbar_log = None
    if description.sources.ballbar is not None:
        ballbar_log = _read_ballbar(folder, description.sources.ballbar, description.encoders, ledger, robot_moves=moves(robot_log.q))
    force_log = None
    if description.sources.force is not None:
        force_log = _read_force(folder, description.sources.force, ledger)
    return Recording(description, robot_log, ballbar_log, force_log, ImportReport(tuple(ledger.files), tuple(ledger.findings)))


def _check_encoders(folder: Path, description: RecordingFile) -> None:
    place, fitted = folder / "recording.yaml", description.encoders
    if fitted and description.sources.ballbar is None:
        raise DescriptionError(
            f"{place}: encoders {', '.join(fitted)} are declared, but no sources.ballbar to read them from. "
            "Name its files, or write `encoders: {}` for a ball-bar without sensors."
        )
    if description.sources.ballbar is not None and not fitted:
        raise DescriptionError(f"{place}: sources.ballbar is given, but no encoder is declared. Declare those that are fitted.")
    columns = [encoder.column for encoder in fitted.values()]
    for column in columns:
        if columns.count(column) > 1:
            raise DescriptionError(f"{place}: encoders: column {column} is declared for {columns.count(column)} encoders.")


def _read_robot(folder: Path, source: SourceFile, robot: Robot, ledger: _Ledger) -> RobotLog:
    dialect = _dialect_of(folder, "robot", source)
    layout = Layout(
        separators=dialect.separators,
        required={dialect.time.column: dialect.time.type, **dict.fromkeys(dialect.motors, "float")},
        optional=dict.fromkeys(dialect.torques, "float"),
        together=dialect.torques,
    )
    table, t = _read_files(_Side(folder, "robot", source, dialect, layout, {}), ledger)
    return RobotLog(t, joint_angles(robot, table, t, dialect.motors, ledger.findings), gear_torques(robot, table, dialect.torques))


def _read_ballbar(
    folder: Path, source: SourceFile, encoders: dict[EncoderName, EncoderFitting], ledger: _Ledger, *, robot_moves: bool
) -> BallBarLog:
    dialect = _dialect_of(folder, "ballbar", source)
    fitted = dict(sorted(encoders.items()))
    status = {name: dialect.status[name] for name in fitted if name in dialect.status}
    layout = Layout(
        separators=dialect.separators,
        required={dialect.time.column: dialect.time.type, **{encoder.column: "integer" for encoder in fitted.values()}},
        optional=dict.fromkeys(status.values(), "integer"),
    )
    table, t = _read_files(_Side(folder, "ballbar", source, dialect, layout, status), ledger)
    angles = encoder_angles(table, t, fitted, robot_moves=robot_moves)
    return BallBarLog(t, angles, tuple(int(name[1]) for name in fitted))


def _read_force(folder: Path, source: SourceFile, ledger: _Ledger) -> ForceLog:
    dialect = _dialect_of(folder, "force", source)
    layout = Layout(
        separators=dialect.separators,
        required={dialect.time.column: dialect.time.type, **dict.fromkeys(dialect.wrench, "float")},
    )
    table, t = _read_files(_Side(folder, "force", source, dialect, layout, {}), ledger)
    return ForceLog(t, np.stack([table.columns[name] for name in dialect.wrench], axis=1))


def _dialect_of(folder: Path, side: SourceName, source: SourceFile) -> Dialect:
    place = f"{folder / 'recording.yaml'}: sources.{side}.dialect"
    try:
        dialect = load_dialect(source.dialect)
    except DescriptionError as error:
        raise DescriptionError(f"{place}: {error}") from None
    if dialect.source != side:
        raise DescriptionError(
            f"{place}: {source.dialect} describes logs of the {_DEVICES[dialect.source]}, not of the {_DEVICES[side]}. "
            "Are the files swapped?"
        )
    return dialect


def _read_files(side: _Side, ledger: _Ledger) -> tuple[Table, NDArray[np.float64]]:
    """All files of one side as one table, and (N,) [s] their time from its first row."""
    tables = [_read_file(side, file, ledger) for file in side.source.files]
    _refuse_differing(tables, side.layout.together)
    table = join(tables, side.dialect.time)
    if len(table) < MINIMUM_ROWS:
        raise LogError(f"{', '.join(table.files)}: {len(table)} usable rows; at least {MINIMUM_ROWS} are needed.")
    t = seconds_from_first(table.columns[side.dialect.time.column], side.dialect.time)
    report_periods(table, t, side.dialect.period_s, ledger.findings)
    return table, t


def _refuse_differing(tables: list[Table], together: tuple[str, ...]) -> None:
    """Columns that only some files have would be lost to all when they are joined."""
    without = [table.files[0] for table in tables if not table.columns.keys() >= set(together)]
    if without and len(without) < len(tables):
        raise LogError(
            f"{without[0]}: columns {', '.join(together)} missing, and other files of this source have them. "
            "Log them in every file, or remove them from all."
        )


def _read_file(side: _Side, file: str, ledger: _Ledger) -> Table:
    table, form = read_file(_inside(side.folder, file), file, side.dialect, side.layout, ledger.findings)
    table = without_faults(in_order(table, side.dialect.time, ledger.findings), side.status, ledger.findings)
    if not len(table):
        raise LogError(f"{file}: no usable row is left of {form.rows_read}; the encoders report faults throughout.")
    name, dialect = side.name, side.source.dialect
    ledger.files.append(FileSummary(file, name, dialect, form.encoding, form.separator, form.decimal, form.rows_read, len(table)))
    return table


def _inside(folder: Path, file: str) -> Path:
    """The path of a device file, which must lie inside the recording folder, links followed."""
    named = PureWindowsPath(file)  # splits at both kinds of slash
    try:
        inside = not named.anchor and ".." not in named.parts and (folder / file).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a link to itself, a NUL in the name
        inside = False
    if not inside:
        raise DescriptionError(
            f"{folder / 'recording.yaml'}: file {file!r} lies outside the recording folder. Move or copy it into the folder."
        )
    return folder / file
