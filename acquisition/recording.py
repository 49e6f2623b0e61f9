"""A recording folder to clean angles and loads: every source read by its dialect, on its own clock.

    recording.yaml -> dialects -> tables -> stamps in order -> counts or motor angles -> rad ->
    segments -> RobotLog, BallBarLog or LengthLog, ForceLog, TrackerLog

Each stage takes a table and gives a new one, with what it found. What was repaired on the way
stands in the import report; what cannot be repaired is an error with file and line.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.faults.damaged_values import damaged_values, load_scale
from acquisition.faults.encoders import (
    WORD,
    counter_scales,
    counter_words,
    encoder_angles,
    powered_up,
    refuse_standing,
    with_damaged,
    with_jumps_checked,
    with_status_checked,
)
from acquisition.faults.frozen import with_frozen_loads_checked, with_frozen_motion_checked
from acquisition.faults.jumps import find_jumps
from acquisition.faults.robot_angles import (
    Reading,
    RobotAngles,
    axis_speed_limits,
    gear_torques,
    moves,
    pop_angles_inplace,
    refuse_other_angles,
    with_limits_checked,
    within_reach,
    without_sentinels,
)
from acquisition.faults.segments import Segments, find_segments
from acquisition.flags import RowFlag, usable
from acquisition.report import FileSummary, ImportReport
from acquisition.sources import (
    ImportLog,
    LogRows,
    LogSource,
    ballbar_layout,
    dialect_of,
    force_layout,
    joined,
    length_layout,
    read_files,
    refuse_few,
    robot_layout,
    tracker_layout,
)
from acquisition.stamps.order import STAMP, seconds_from, with_periods_checked
from acquisition.table.table import Table
from cell.arrays import Array
from cell.descriptions import Robot
from cell.errors import DescriptionError, LogError
from cell.file_units import METRES
from cell.instrument import Instrument
from cell.load import load_instrument, load_robot
from cell.logs import BallBarLog, ForceLog, LengthLog, RobotLog, SourceName, TrackerLog
from cell.neighbours import Mask, Rows
from cell.recording import (
    EncoderFitting,
    EncoderName,
    LengthFile,
    RecordingFile,
    SourceFile,
    TrackerFile,
    load_recording_file,
)
from cell.rigid_fit import nominal_frames
from cell.selectors import require

REACH = 0.1  # of the stroke beyond its ends: data sheets state less than sensors show
# Rows of one log that a fit takes, for its memory: two hours at 250 Hz. Of eight hours at 248 Hz
# every fourth remains, 62 Hz, of a motion below 3 Hz.
MOST_ROWS = 2_000_000
# Factor between the extents of an LED's path and of the flange's; units differ by more, and an LED
# is no further from the flange than the flange moves
ALIKE_EXTENT, EXTENT_ROWS = 10.0, 500


@dataclass(frozen=True, eq=False)
class Recording:
    """One recording, read."""

    description: RecordingFile
    robot_log: RobotLog
    ballbar_log: BallBarLog | None  # none for a bar without encoders
    force_log: ForceLog | None  # none without a force sensor
    report: ImportReport
    rows: dict[SourceName, LogRows] = field(default_factory=dict)
    length_log: LengthLog | None = None  # of an instrument whose rod or wire is sensed
    tracker_log: TrackerLog | None = None  # none without an optical tracker


def read_recording(folder: Path) -> Recording:
    """Joint angles, encoder angles and logged loads of a recording folder, with the import report.

    Raises DescriptionError if recording.yaml is wrong or contradicts itself, LogError if a device
    file cannot be trusted.
    """
    if not folder.is_dir():
        raise DescriptionError(
            f"{folder}: no such folder. A recording is a folder with recording.yaml and the device "
            "files. Check the name."
        )
    description = load_recording_file(folder)
    _check_encoders(folder, description)
    robot = load_robot(description.robot, relative_to=folder)
    sources, imported = description.sources, dict[SourceName, ImportLog]()
    robot_log, imported["robot"] = read_robot(folder, sources.robot, robot)
    ballbar_log, length_log, force_log, tracker_log = None, None, None, None
    if sources.ballbar is not None:
        ballbar_log, imported["ballbar"] = read_ballbar(
            folder, sources.ballbar, description.encoders, robot_moves=moves(robot_log.q)
        )
    if sources.length is not None:
        instrument = load_instrument(description.instrument or "", relative_to=folder)
        length_log, imported["length"] = _read_length(folder, sources.length, instrument)
    if sources.force is not None:
        force_log, imported["force"] = read_force(folder, sources.force)
    if sources.tracker is not None:
        tracker_log, imported["tracker"] = _read_tracker(folder, sources.tracker, robot, robot_log)
    logs = imported.values()
    report = ImportReport(
        files=tuple(file for log in logs for file in log.files),
        findings=tuple(finding for log in logs for finding in log.findings),
    )
    rows = {name: log.rows for name, log in imported.items()}
    return Recording(
        description=description,
        robot_log=robot_log,
        ballbar_log=ballbar_log,
        force_log=force_log,
        report=report,
        rows=rows,
        length_log=length_log,
        tracker_log=tracker_log,
    )


def _check_encoders(folder: Path, description: RecordingFile) -> None:
    location, fitted = folder / "recording.yaml", description.encoders
    if fitted and description.sources.ballbar is None:
        raise DescriptionError(
            f"{location}: encoders {', '.join(fitted)} are declared, but no sources.ballbar to "
            f"read them from. Name its files, or write `encoders: {{}}` for a ball-bar without "
            "sensors."
        )
    if description.sources.ballbar is not None and not fitted:
        raise DescriptionError(
            f"{location}: sources.ballbar is given, but no encoder is declared. Declare those that "
            "are fitted."
        )
    columns = [encoder.column for encoder in fitted.values()]
    require(columns, f"{location}: encoders")
    for column in columns:
        if (count := columns.count(column)) > 1:
            raise DescriptionError(
                f"{location}: encoders: column {column} is declared for {count} encoders. Name the "
                "column of each."
            )


def read_robot(folder: Path, declared: SourceFile, robot: Robot) -> tuple[RobotLog, ImportLog]:
    """The robot's log of a recording, and what was found in its files."""
    dialect = dialect_of(folder, "robot", declared).for_axes(robot.joints)
    source = LogSource(folder, "robot", declared, dialect, robot_layout(declared, dialect))
    tables, summaries = read_files(source)
    table = joined([without_sentinels(table, dialect.angles) for table in tables])
    reading = Reading(dialect.angle_kind, dialect.angle_unit)
    t = _seconds(table)
    table = with_frozen_motion_checked(table, t, reading.scales(robot, dialect.angles))
    torques = [name for name in dialect.torque_columns if name in table.columns]
    moving = dict(zip(torques, dialect.angles, strict=False))
    table = with_frozen_loads_checked(table, moving)
    angles = pop_angles_inplace(robot, table, t, dialect.angles, reading)
    table, reset = _with_robot_jumps_checked(robot, table, angles)
    table, segments = find_segments(table, angles.joints, reset=reset)
    joints = [f"joint {k}" for k in range(1, robot.joints + 1)]
    table = _with_damaged_values_checked(table, segments, angles.joints, joints)
    table = with_limits_checked(table, angles)
    selected = _selected(table, segments)
    q = selected.of(angles.joints)
    del angles  # more than a fit takes of a log of hours
    used = _used(source, table, segments, selected, summaries)
    log = RobotLog(
        t=used.t,
        q=q,
        torque=gear_torques(robot, used.table, dialect),
        segment=selected.of(segments.segment),
        flags=used.table.flags,
    )
    return log, used.imported


def _with_robot_jumps_checked(
    robot: Robot, table: Table, angles: RobotAngles
) -> tuple[Table, Rows]:
    """The table with jumps of the angles flagged, and the rows from which they stay away.

    Raises LogError if the angles cannot be what they are declared to be.
    """
    rows = np.flatnonzero(usable(table.flags))
    judged = angles.take(rows)
    jumps = find_jumps(judged.t, judged.joints, axis_speed_limits(robot), judged.axes_step)
    table = with_damaged(table, rows[jumps.damaged])
    if jumps.fast.size or not (moves(angles.joints) and within_reach(angles)):
        refuse_other_angles(robot, table, angles)
    reset = rows[jumps.lasting]
    if not reset.size:
        return table, reset
    sentence = (
        "the angles jump here and do not come back: another start of the logger; a new segment."
    )
    table = table.remarked("angles jump", "warning", sentence, rows=reset)
    return table, reset[np.diff(angles.t)[reset - 1] > 0]  # where the clock goes on


def read_ballbar(
    folder: Path,
    declared: SourceFile,
    encoders: dict[EncoderName, EncoderFitting],
    *,
    robot_moves: bool,
) -> tuple[BallBarLog, ImportLog]:
    """The ball-bar's log of a recording, and what was found in its files.

    robot_moves : whether standing counters are a fault.
    """
    dialect = dialect_of(folder, "ballbar", declared)
    fitted = dict(sorted(encoders.items()))
    status = {name: dialect.status[name] for name in fitted if name in dialect.status}
    layout = ballbar_layout(declared, dialect, fitted)
    source = LogSource(folder, "ballbar", declared, dialect, layout, status)
    tables, summaries = read_files(source)
    table = joined([_with_some_usable(with_status_checked(table, status)) for table in tables])
    words = counter_words(table, fitted)
    table = with_frozen_motion_checked(table, _seconds(table), counter_scales(fitted), WORD)
    for encoder in fitted.values():
        table.columns.pop(encoder.column)  # now in `words`
    table = with_jumps_checked(table, _seconds(table), words, fitted)
    angles = encoder_angles(words, usable(table.flags), fitted)
    reset = np.flatnonzero(table.flags & np.uint32(RowFlag.PRESET))
    anew = partial(powered_up, words, fitted)
    table, segments = find_segments(table, angles, reset=reset, powered_up=anew)
    names = [f"encoder {name}" for name in fitted]
    table = _with_damaged_values_checked(table, segments, angles, names)
    refuse_standing(table, words, fitted, robot_moves=robot_moves)
    selected = _selected(table, segments)
    used = _used(source, table, segments, selected, summaries)
    log = BallBarLog(
        t=used.t,
        angles=selected.of(angles),
        joints=tuple(int(name[1]) for name in fitted),
        segment=selected.of(segments.segment),
        flags=used.table.flags,
    )
    return log, used.imported


def _with_some_usable(table: Table) -> Table:
    """The table itself; raises LogError if no row of it is usable."""
    if not usable(table.flags).any():
        raise LogError(
            f"{table.files[0]}: no usable row is left of {len(table)}; the encoders report faults "
            "throughout. Check their cables."
        )
    return table


def _read_length(
    folder: Path, declared: LengthFile, instrument: Instrument
) -> tuple[LengthLog, ImportLog]:
    """The log of a length sensor. Raises LogError if the instrument cannot be that long."""
    dialect = dialect_of(folder, "length", declared)
    source = LogSource(folder, "length", declared, dialect, length_layout(declared, dialect))
    tables, summaries = read_files(source)
    table = joined(tables)
    length = table.columns[declared.column] * METRES[declared.unit] + declared.zero_m
    scale = {declared.column: METRES[declared.unit]}
    table = with_frozen_motion_checked(table, _seconds(table), scale)
    table, segments = find_segments(table, length[:, None])
    table = _with_damaged_values_checked(table, segments, length[:, None], ["length"])
    selected = _selected(table, segments)
    used = _used(source, table, segments, selected, summaries)
    chosen = selected.of(length)
    margin = REACH * (instrument.upper - instrument.lower)
    outside = (chosen < instrument.lower - margin) | (chosen > instrument.upper + margin)
    if outside.any():
        row = int(np.argmax(outside))
        raise LogError(
            f"{used.table.location(row)}: a length of {chosen[row]:.6g} m, and {instrument.title} "
            f"reaches from {instrument.lower:g} to {instrument.upper:g} m. Is {declared.column} in "
            f"{declared.unit}, and zero at {declared.zero_m:g} m? Correct unit or zero_m of "
            "sources.length in recording.yaml."
        )
    log = LengthLog(used.t, chosen, selected.of(segments.segment), used.table.flags)
    return log, used.imported


def read_force(folder: Path, declared: SourceFile) -> tuple[ForceLog, ImportLog]:
    """The log of a force sensor of a recording, and what was found in its files."""
    dialect = dialect_of(folder, "force", declared)
    source = LogSource(folder, "force", declared, dialect, force_layout(declared, dialect))
    tables, summaries = read_files(source)
    table = joined(tables)
    table = with_frozen_loads_checked(table, dict.fromkeys(dialect.wrench))
    wrench = np.stack([table.columns[name] for name in dialect.wrench], axis=1)
    table, segments = find_segments(table, wrench)
    table = _with_damaged_values_checked(
        table, segments, wrench * load_scale(wrench), list(dialect.wrench)
    )
    selected = _selected(table, segments)
    used = _used(source, table, segments, selected, summaries)
    return ForceLog(used.t, selected.of(wrench)), used.imported


def _read_tracker(
    folder: Path, declared: TrackerFile, robot: Robot, robot_log: RobotLog
) -> tuple[TrackerLog, ImportLog]:
    """The log of an optical tracker. Raises LogError if the tool cannot move that far."""
    dialect = dialect_of(folder, "tracker", declared)
    source = LogSource(folder, "tracker", declared, dialect, tracker_layout(declared, dialect))
    tables, summaries = read_files(source)
    table = joined(tables)
    points = np.stack([table.columns[name] for name in dialect.point], axis=1)
    points *= METRES[declared.unit]
    hidden = (points == 0.0).all(axis=1)
    if hidden.any():
        sentence = "no point, or zeros: the LED was hidden; row left out."
        table = table.remarked("hidden LED", "repaired", sentence, rows=hidden)
        table = table.flagged(hidden, RowFlag.INVALID)
        refuse_few(table, int(np.count_nonzero(~hidden)))
    table, segments = find_segments(table, points)
    table = _with_damaged_values_checked(table, segments, points, ["x", "y", "z"])
    selected = _selected(table, segments)
    used = _used(source, table, segments, selected, summaries)
    chosen = selected.of(points)
    every = 1 + robot_log.t.size // EXTENT_ROWS
    flange = nominal_frames(robot, robot_log.q[::every]).tip.T
    seen, moved = (float(np.linalg.norm(p.std(axis=0))) for p in (chosen, flange))
    if not moved / ALIKE_EXTENT < seen < moved * ALIKE_EXTENT:
        raise LogError(
            f"{used.table.location(0)}: the points spread over {seen:.3g} m rms, and the flange "
            f"over {moved:.3g} m. Are the coordinates in {declared.unit}? Correct unit of "
            "sources.tracker in recording.yaml."
        )
    log = TrackerLog(used.t, chosen, declared.accuracy_m, selected.of(segments.segment))
    return log, used.imported


def _seconds(table: Table) -> Array:
    """(N,) [s] from the first row of a table."""
    return seconds_from(table.columns[STAMP], table.columns[STAMP][0])


def _with_damaged_values_checked(
    table: Table, segments: Segments, angles: Array, names: list[str]
) -> Table:
    """The table with values flagged and reported that their neighbours contradict.

    angles : (N, C) [rad] of the channels `names`.
    """
    valid = usable(table.flags)
    segment, stamps = _chosen(segments.segment, valid), _chosen(segments.stamps, valid)
    breaks = np.diff(segment, prepend=np.uint16(0)) != 0
    damaged = damaged_values(seconds_from(stamps, stamps[0]), _chosen(angles, valid), breaks)
    if not damaged.any():
        return table
    rows = np.flatnonzero(valid)
    channels = [names[k] for k in np.flatnonzero(damaged.any(axis=0))]
    return with_damaged(table, rows[damaged.any(axis=1)], channels)


@dataclass(frozen=True, eq=False)
class _Selected:
    """The rows of a source that a fit uses: all usable ones, or of a long log some of them."""

    usable: Rows  # (U,) indices among all rows
    every: int  # of the usable rows one in so many is used

    @property
    def rows(self) -> Rows:
        """(K,) indices among all rows."""
        return self.usable[:: self.every]

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        """(K, ...) the used ones of values (N, ...), write-protected so that logs share them."""
        chosen = np.ascontiguousarray(_chosen(values, self.rows))
        chosen.flags.writeable = False
        return chosen


def _selected(table: Table, segments: Segments) -> _Selected:
    """The rows that a fit uses; raises LogError if they are too few."""
    rows = np.flatnonzero(segments.used & usable(table.flags))
    refuse_few(table, rows.size)
    return _Selected(rows, -(-rows.size // MOST_ROWS))


@dataclass(frozen=True, eq=False)
class _Used:
    """What a log takes of the rows that are used, and what was read of the source."""

    table: Table
    t: Array  # (K,) [s] from the first of them
    imported: ImportLog


def _used(
    source: LogSource,
    table: Table,
    segments: Segments,
    selected: _Selected,
    summaries: list[FileSummary],
) -> _Used:
    """The used rows, once the times of all usable ones have been checked."""
    rows, every = selected.usable, selected.every
    t = seconds_from(_chosen(segments.stamps, rows), segments.stamps[rows[0]])
    chosen = with_periods_checked(table.take(rows), t, source.dialect.period_s)
    flags, used = table.flags.copy(), np.zeros(len(table), dtype=bool)
    flags[rows], used[selected.rows] = chosen.flags, True
    if every > 1:
        sentence = (
            f"{rows.size} usable rows, more than the {MOST_ROWS} that a fit takes: all were "
            f"checked, and one in {every} is used."
        )
        chosen = chosen.remarked("long log", "warning", sentence, count=1)
        t, chosen = t[::every], chosen.take(np.arange(0, rows.size, every))
    counts = dict(
        zip(table.files, np.bincount(chosen.file, minlength=len(table.files)), strict=True)
    )
    files = tuple(replace(file, rows_kept=int(counts[file.file])) for file in summaries)
    log_rows = LogRows(flags, segments.segment, used)
    return _Used(chosen, t, ImportLog(files, chosen.findings, log_rows))


def _chosen(values: NDArray[Any], rows: Rows | Mask) -> NDArray[Any]:
    """(K, ...) values (N, ...) at ascending rows (K,), or a mask; the values themselves if all."""
    every = rows.all() if rows.dtype == bool else rows.size == len(values)
    return values if every else values[rows]
