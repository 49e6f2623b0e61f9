"""A recording folder to clean angles and loads: every device file read by its dialect, each side on its own clock.

    recording.yaml -> dialects -> tables -> stamps in order -> counts or motor angles -> rad -> segments -> RobotLog, BallBarLog, ForceLog

Everything that was mended on the way stands in the import report; what cannot be mended is an error with file and line.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.faults.damaged_values import damaged_values
from acquisition.faults.encoders import (
    counter_words,
    encoder_angles,
    jump_flags,
    powered_up,
    refuse_standing,
    report_damaged,
    status_flags,
)
from acquisition.faults.jumps import find_jumps
from acquisition.faults.motors import (
    axis_speed_limits,
    gear_torques,
    moves,
    refuse_other_angles,
    report_limits,
    to_joints,
    within_reach,
    without_stand_ins,
)
from acquisition.faults.segments import Segments, find_segments
from acquisition.flags import Flags, RowFlag, usable
from acquisition.report import FileSummary, Finding, ImportReport, finding
from acquisition.sources import (
    MINIMUM_ROWS,
    Ledger,
    LogRows,
    Side,
    ballbar_layout,
    dialect_of,
    force_layout,
    joined,
    read_files,
    robot_layout,
)
from acquisition.stamps.order import STAMP, report_periods, seconds_from
from acquisition.table.selectors import require
from acquisition.table.table import Table
from cell.descriptions import Robot
from cell.errors import DescriptionError, LogError
from cell.load import load_robot
from cell.logs import BallBarLog, ForceLog, RobotLog
from cell.recording import (
    EncoderFitting,
    EncoderName,
    RecordingFile,
    SourceFile,
    SourceName,
    load_recording_file,
)
from cell.robot_angles import joints_to_axes


@dataclass(frozen=True, eq=False)
class Recording:
    """One recording, read."""

    description: RecordingFile
    robot_log: RobotLog
    ballbar_log: BallBarLog | None  # none for a sensor-less ball-bar
    force_log: ForceLog | None  # none without a force sensor
    report: ImportReport
    rows: dict[SourceName, LogRows] = field(default_factory=dict)


def read_recording(folder: Path) -> Recording:
    """Joint angles, encoder angles and logged loads of a recording folder, with the import report.

    Raises DescriptionError if recording.yaml is wrong or contradicts itself, LogError if a device file cannot be trusted.
    """
    if not folder.is_dir():
        raise DescriptionError(
            f"{folder}: no such folder. A recording is a folder with recording.yaml and the device files."
        )
    description = load_recording_file(folder)
    _check_encoders(folder, description)
    robot = load_robot(description.robot, relative_to=folder)
    ledger = Ledger([], [])
    robot_log = read_robot(folder, description.sources.robot, robot, ledger)
    ballbar_log = None
    if description.sources.ballbar is not None:
        ballbar_log = read_ballbar(
            folder,
            description.sources.ballbar,
            description.encoders,
            ledger,
            robot_moves=moves(robot_log.q),
        )
    force_log = None
    if description.sources.force is not None:
        force_log = _read_force(folder, description.sources.force, ledger)
    report = ImportReport(tuple(ledger.files), tuple(ledger.findings))
    return Recording(description, robot_log, ballbar_log, force_log, report, ledger.rows)


def _check_encoders(folder: Path, description: RecordingFile) -> None:
    place, fitted = folder / "recording.yaml", description.encoders
    if fitted and description.sources.ballbar is None:
        raise DescriptionError(
            f"{place}: encoders {', '.join(fitted)} are declared, but no sources.ballbar to read them from. "
            "Name its files, or write `encoders: {}` for a ball-bar without sensors."
        )
    if description.sources.ballbar is not None and not fitted:
        raise DescriptionError(
            f"{place}: sources.ballbar is given, but no encoder is declared. Declare those that are fitted."
        )
    columns = [encoder.column for encoder in fitted.values()]
    require(columns, f"{place}: encoders")
    for column in columns:
        if columns.count(column) > 1:
            raise DescriptionError(
                f"{place}: encoders: column {column} is declared for {columns.count(column)} encoders."
            )


def read_robot(folder: Path, source: SourceFile, robot: Robot, ledger: Ledger) -> RobotLog:
    """The robot's side of a recording."""
    dialect = dialect_of(folder, "robot", source)
    side = Side(folder, "robot", source, dialect, robot_layout(source, dialect))
    columns = dialect.angles
    tables = [
        without_stand_ins(table, columns, ledger.findings) for table in read_files(side, ledger)
    ]
    table = joined(tables)
    t = seconds_from(table.columns[STAMP], table.columns[STAMP][0])
    logged = np.stack(
        [table.columns[name] for name in columns]
    ).T  # column by column, as the checks go
    joints = to_joints(robot, logged, dialect.side, dialect.angle_unit)
    axes = joints_to_axes(robot, joints)
    jumps = find_jumps(t, axes, axis_speed_limits(robot))
    flags, findings = table.flags, ledger.findings
    if not jumps.many():
        flags[jumps.damaged] |= np.uint32(RowFlag.IMPLAUSIBLE)
    sound = usable(flags)
    if jumps.fast.size or not (moves(joints) and within_reach(robot, axes)):
        refuse_other_angles(
            robot,
            table,
            t,
            logged,
            joints,
            axes,
            side=dialect.side,
            unit=dialect.angle_unit,
            sound=sound,
        )
    report_damaged(table, np.flatnonzero(jumps.damaged), [], None, findings)
    if jumps.elsewhere.size:
        sentence = (
            "the angles jump here and do not come back: another start of the logger; a new segment."
        )
        findings.append(
            finding(
                "angles jump",
                "warning",
                table.files[0],
                sentence,
                lines=table.line[jumps.elsewhere],
            )
        )
    segments = find_segments(
        table, joints, usable(flags), findings, reset=_unrelated(t, jumps.elsewhere)
    )
    flags |= _damaged(
        table, segments, joints, usable(flags), [f"joint {k}" for k in range(1, 7)], findings
    )
    report_limits(robot, table, axes, usable(flags), findings)
    table, t, kept = _used(side, table, segments, flags, ledger)
    torque = gear_torques(robot, table, dialect.torque_columns)
    return RobotLog(
        t, np.ascontiguousarray(_chosen(joints, kept)), torque, segments.segment[kept], table.flags
    )


def _unrelated(t: NDArray[np.float64], rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """Rows at which angles jump while the clock goes on."""
    return rows[np.diff(t)[rows - 1] > 0] if rows.size else rows


def read_ballbar(
    folder: Path,
    source: SourceFile,
    encoders: dict[EncoderName, EncoderFitting],
    ledger: Ledger,
    *,
    robot_moves: bool,
) -> BallBarLog:
    """The ball-bar's side of a recording; robot_moves : whether standing counters are a fault."""
    dialect = dialect_of(folder, "ballbar", source)
    fitted = dict(sorted(encoders.items()))
    status = {name: dialect.status[name] for name in fitted if name in dialect.status}
    side = Side(folder, "ballbar", source, dialect, ballbar_layout(source, dialect, fitted), status)
    findings = ledger.findings
    tables, preset = read_files(side, ledger), []
    for table in tables:
        flags, rows = status_flags(table, status, findings)
        table.flags[:] |= flags
        preset.append(table.line[rows])
        if not usable(table.flags).any():
            raise LogError(
                f"{table.files[0]}: no usable row is left of {len(table)}; the encoders report faults throughout."
            )
    table = joined(tables)
    flags = table.flags
    t = seconds_from(table.columns[STAMP], table.columns[STAMP][0])
    cell_words = counter_words(table, fitted)
    jumped, reset = jump_flags(table, t, cell_words, usable(flags), fitted, findings)
    reset = np.unique(np.concatenate((reset, np.flatnonzero(flags & np.uint32(RowFlag.PRESET)))))
    flags |= jumped
    angles = encoder_angles(cell_words, usable(flags), fitted)
    on = partial(powered_up, cell_words, fitted)
    segments = find_segments(table, angles, usable(flags), findings, reset=reset, powered_up=on)
    flags |= _damaged(
        table, segments, angles, usable(flags), [f"encoder {name}" for name in fitted], findings
    )
    refuse_standing(table, cell_words, flags, fitted, robot_moves=robot_moves)
    table, t, kept = _used(side, table, segments, flags, ledger)
    return BallBarLog(
        t,
        np.ascontiguousarray(_chosen(angles, kept)),
        tuple(int(name[1]) for name in fitted),
        segments.segment[kept],
        table.flags,
    )


def _damaged(
    table: Table,
    segments: Segments,
    angles: NDArray[np.float64],
    sound: NDArray[np.bool_],
    names: list[str],
    findings: list[Finding],
) -> Flags:
    """(N,) flags of single values that their neighbours contradict."""
    rows, flags = np.flatnonzero(sound), np.zeros(len(table), dtype=np.uint32)
    segment, stamps = _chosen(segments.segment, rows), _chosen(segments.stamps, rows)
    breaks = np.diff(segment, prepend=np.uint16(0)) != 0
    found = damaged_values(seconds_from(stamps, stamps[0]), _chosen(angles, rows), breaks)
    if found.any():
        here, channels = np.nonzero(found)
        flags[rows[here]] |= np.uint32(RowFlag.IMPLAUSIBLE)
        report_damaged(table, rows[np.unique(here)], names, channels, findings)
    return flags


def _used(
    side: Side, table: Table, segments: Segments, flags: Flags, ledger: Ledger
) -> tuple[Table, NDArray[np.float64], NDArray[np.intp]]:
    """The rows that a fit uses, (K,) [s] their time from the first of them, and which they are."""
    used = segments.used & usable(flags)
    kept = np.flatnonzero(used)
    if kept.size < MINIMUM_ROWS:
        raise LogError(
            f"{', '.join(table.files)}: {kept.size} usable rows; at least {MINIMUM_ROWS} are needed."
        )
    t = seconds_from(segments.stamps, segments.stamps[kept[0]])
    timed = report_periods(
        table.take(kept), _chosen(t, kept), side.dialect.period_s, ledger.findings
    )
    flags[kept] |= timed
    ledger.rows[side.name] = LogRows(t, flags, segments.segment, used)
    for index, file in enumerate(table.files):
        place = next(
            k for k, one in enumerate(ledger.files) if one.file == file and one.source == side.name
        )
        ledger.files[place] = _replaced(ledger.files[place], int((table.file[kept] == index).sum()))
    table = Table(table.columns, table.files, table.file, table.line, flags, table.begins).take(
        kept
    )
    return table, _chosen(t, kept), kept


def _chosen(values: NDArray[Any], rows: NDArray[np.intp]) -> NDArray[Any]:
    """Some rows, in ascending order, of (N, ...) values."""
    return values if rows.size == len(values) else values[rows]


def _replaced(summary: FileSummary, kept: int) -> FileSummary:
    return FileSummary(**{**vars(summary), "rows_kept": kept})


def _read_force(folder: Path, source: SourceFile, ledger: Ledger) -> ForceLog:
    dialect = dialect_of(folder, "force", source)
    side = Side(folder, "force", source, dialect, force_layout(source, dialect))
    table = joined(read_files(side, ledger))
    wrench = np.stack([table.columns[name] for name in dialect.wrench], axis=1)
    segments = find_segments(table, wrench, usable(table.flags), ledger.findings)
    table, t, kept = _used(side, table, segments, table.flags, ledger)
    return ForceLog(t, wrench[kept])
