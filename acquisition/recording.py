"""A recording folder to clean angles and loads: every source read by its dialect, on its own clock.

    recording.yaml -> dialects -> tables -> stamps in order -> counts or motor angles -> rad ->
    segments -> RobotLog, BallBarLog or LengthLog, ForceLog, TrackerLog

Each stage takes a table and gives a new one, with what it found. What was repaired on the way
stands in the import report; what cannot be repaired is an error with file and line.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from ballbar.acquisition.faults.damaged_values import load_scale
from ballbar.acquisition.faults.encoders import (
    WORD,
    counter_scales,
    counter_words,
    encoder_angles,
    powered_up,
    refuse_standing,
    with_jumps_checked,
    with_status_checked,
)
from ballbar.acquisition.faults.frozen import with_frozen_loads_checked, with_frozen_motion_checked
from ballbar.acquisition.faults.other_angles import with_angle_jumps_checked
from ballbar.acquisition.faults.replayed import with_replays_checked
from ballbar.acquisition.faults.robot_angles import (
    AngleReading,
    gear_torques,
    moves,
    pop_angles_inplace,
    with_limits_checked,
    without_sentinels,
)
from ballbar.acquisition.fit_rows import choose_rows, cut_rows, fit_rows, rows_in_time
from ballbar.acquisition.flags import RowFlag, usable
from ballbar.acquisition.measured_values import rotation
from ballbar.acquisition.report import ImportReport
from ballbar.acquisition.sources import (
    Fitted,
    ImportLog,
    LogRows,
    log_source,
    read_files,
    refuse_few,
)
from ballbar.acquisition.stamps.order import seconds
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import DescriptionError, InputError, LogError
from ballbar.cell.file_units import METRES, RADIANS
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.load import load_instrument, load_robot
from ballbar.cell.logs import BallBarLog, ForceLog, LengthLog, RobotLog, SourceName, TrackerLog
from ballbar.cell.recording import (
    LengthFile,
    RecordingFile,
    SourceFile,
    TrackerFile,
    load_recording_file,
)
from ballbar.cell.rigid_fit import nominal_frames
from ballbar.cell.selectors import require

LED_ACCURACY = 9.0e-5  # [m] along each axis (thesis sec. 5.3: Nikon K600)
REACH = 0.1  # of the stroke beyond its ends: data sheets state less than sensors show
# Factor between the extents of an LED's path and of the flange's; units differ by more, and an LED
# is no further from the flange than the flange moves
SIMILAR_EXTENT, EXTENT_ROWS = 10.0, 500
# [bytes] of a folder, an hour of text: what another process reads is in memory several times
LARGE = 100_000_000


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
    tracker_log: TrackerLog | None = None  # none where nothing follows a target
    folder: Path | None = None  # None of logs that no file describes
    name: str = ""  # of such logs


def require_folder(folder: Path) -> None:
    """Raises DescriptionError where there is no folder that could be a recording."""
    if not folder.is_dir():
        what = "no such folder. A recording is a folder with recording.yaml and the device files."
        raise DescriptionError.at(folder, what, "Check the name.")


def read_recording(folder: Path) -> Recording:
    """Joint angles, encoder angles and logged loads of a recording folder, with the import report.

    Raises DescriptionError if recording.yaml is wrong or contradicts itself, LogError if a device
    file cannot be trusted.
    """
    require_folder(folder)
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
        tracker_log, imported["tracker"] = _read_tracker(folder, description, robot, robot_log)
    report = ImportReport(
        files=tuple(file for log in imported.values() for file in log.files),
        findings=tuple(finding for log in imported.values() for finding in log.findings),
    )
    return Recording(
        description=description,
        robot_log=robot_log,
        ballbar_log=ballbar_log,
        force_log=force_log,
        report=report,
        rows={name: log.rows for name, log in imported.items()},
        length_log=length_log,
        tracker_log=tracker_log,
        folder=folder,
    )


def readable(paths: Sequence[Path]) -> list[Path | Recording]:
    """The recordings of folders that hold nothing else, are sound and not LARGE; the other paths as
    given.
    """
    out: list[Path | Recording] = [*paths]
    for k, path in enumerate(paths):
        if (path / "recording.yaml").exists() and not (path / "poses.yaml").exists():
            sizes = (file.stat().st_size for file in path.rglob("*") if file.is_file())
            with suppress(InputError, OSError):
                if sum(sizes) <= LARGE and not load_recording_file(path).followed:
                    out[k] = read_recording(path)
    return out


def _check_encoders(folder: Path, description: RecordingFile) -> None:
    location, fitted = folder / "recording.yaml", description.encoders
    if fitted and description.sources.ballbar is None:
        what = f"encoders {', '.join(fitted)} are declared, but no sources.ballbar."
        remedy = "Name its files, or write `encoders: {}` for a ball-bar without sensors."
        raise DescriptionError.at(location, what, remedy)
    if description.sources.ballbar is not None and not fitted:
        what = "sources.ballbar is given, but no encoder is declared."
        raise DescriptionError.at(location, what, "Declare those that are fitted.")
    columns = [encoder.column for encoder in fitted.values()]
    require(columns, f"{location}: encoders")
    for column in columns:
        if (count := columns.count(column)) > 1:
            what = f"encoders: column {column} is declared for {count} encoders."
            raise DescriptionError.at(location, what, "Name the column of each.")


def read_robot(folder: Path, declared: SourceFile, robot: Robot) -> tuple[RobotLog, ImportLog]:
    """The robot's log of a recording, and what was found in its files."""
    read = read_files(log_source(folder, "robot", declared, axes=robot.joints))
    dialect = read.source.dialect
    reading = AngleReading(dialect.angle_kind, dialect.angle_unit)
    tables = [without_sentinels(table, dialect.angles) for table in read.tables]
    table = replace(read, tables=tables).joined()
    t = seconds(table)
    scales = reading.scales(robot, dialect.angles)
    table = with_frozen_motion_checked(with_replays_checked(table, scales), t, scales)
    torques = [name for name in dialect.torque_columns if name in table.columns]
    table = with_frozen_loads_checked(table, dict(zip(torques, dialect.angles, strict=False)))
    angles = pop_angles_inplace(robot, table, t, dialect.angles, reading)
    table, reset = with_angle_jumps_checked(table, angles)
    names = [f"joint {k}" for k in range(1, robot.joints + 1)]
    table, segments = cut_rows(table, angles.joints, names, reset=reset)
    chosen = choose_rows(with_limits_checked(table, angles), segments)
    q = chosen.of(angles.joints)
    del angles  # more than a fit takes of a log of hours
    rows = rows_in_time(read, chosen, q)
    torque = gear_torques(robot, rows.table, dialect)
    log = RobotLog(rows.t, rows.values, torque, rows.segment, rows.table.flags)
    return log, rows.imported


def read_ballbar(
    folder: Path, declared: SourceFile, encoders: Fitted, *, robot_moves: bool
) -> tuple[BallBarLog, ImportLog]:
    """The ball-bar's log of a recording, and what was found in its files.

    robot_moves : whether standing counters are a fault.
    """
    fitted = dict(sorted(encoders.items()))
    read = read_files(log_source(folder, "ballbar", declared, encoders=fitted))
    status = {k: column for k, column in read.source.dialect.status.items() if k in fitted}
    tables = [with_status_checked(table, status) for table in read.tables]
    for table in tables:
        if not usable(table.flags).any():
            what = f"no usable row is left of {len(table)}; the encoders report faults throughout."
            raise LogError.at(table.files[0], what, "Check their cables.")
    table = replace(read, tables=tables).joined()
    words, t = counter_words(table, fitted), seconds(table)
    scales = counter_scales(fitted)
    table = with_replays_checked(table, scales, WORD)
    table = with_frozen_motion_checked(table, t, scales, WORD)
    for encoder in fitted.values():
        table.columns.pop(encoder.column)  # now in `words`
    table = with_jumps_checked(table, t, words, fitted)
    angles = encoder_angles(words, usable(table.flags), fitted)
    names = [f"encoder {name}" for name in fitted]
    reset = np.flatnonzero(table.flags & np.uint32(RowFlag.PRESET))
    restarted = partial(powered_up, words, fitted)
    table, segments = cut_rows(table, angles, names, reset=reset, powered_up=restarted)
    refuse_standing(table, words, fitted, robot_moves=robot_moves)
    chosen = choose_rows(table, segments)
    rows = rows_in_time(read, chosen, chosen.of(angles))
    joints = tuple(int(name[1]) for name in fitted)
    log = BallBarLog(rows.t, rows.values, joints, rows.segment, rows.table.flags)
    return log, rows.imported


def _read_length(
    folder: Path, declared: LengthFile, instrument: Instrument
) -> tuple[LengthLog, ImportLog]:
    """The log of a length sensor. Raises LogError if the instrument cannot be that long."""
    read = read_files(log_source(folder, "length", declared))
    table, unit = read.joined(), METRES[declared.unit]
    length = table.columns[declared.column] * unit + declared.zero_m
    table = with_frozen_motion_checked(table, seconds(table), {declared.column: unit})
    rows = fit_rows(read, table, length[:, None], ["length"])
    length, margin = rows.values[:, 0], REACH * (instrument.upper - instrument.lower)
    outside = (length < instrument.lower - margin) | (length > instrument.upper + margin)
    if outside.any():
        row = int(np.argmax(outside))
        what = f"a length of {length[row]:.6g} m, and {instrument.title} reaches from "
        what += f"{instrument.lower:g} to {instrument.upper:g} m."
        remedy = "Correct unit or zero_m of sources.length in recording.yaml."
        raise LogError.at(rows.table.location(row), what, remedy)
    return LengthLog(rows.t, length, rows.segment, rows.table.flags), rows.imported


def read_force(folder: Path, declared: SourceFile) -> tuple[ForceLog, ImportLog]:
    """The log of a force sensor of a recording, and what was found in its files."""
    read = read_files(log_source(folder, "force", declared))
    names = read.source.dialect.wrench
    table = with_frozen_loads_checked(read.joined(), dict.fromkeys(names))
    wrench = np.stack([table.columns[name] for name in names], axis=1)
    rows = fit_rows(read, table, wrench, names, scale=load_scale(wrench))
    return ForceLog(rows.t, rows.values), rows.imported


def _read_tracker(
    folder: Path, description: RecordingFile, robot: Robot, robot_log: RobotLog
) -> tuple[TrackerLog, ImportLog]:
    """The log of what follows a target. Raises LogError if the tool cannot move that far."""
    declared = description.sources.tracker
    assert declared is not None  # the caller's condition
    kind, stated = _target_of(folder, description, declared)
    read = read_files(log_source(folder, "tracker", declared))
    table = read.joined()
    names, unit = read.source.dialect.point, METRES[declared.unit]
    points = np.stack([table.columns[name] for name in names], axis=1) * unit
    table = with_frozen_motion_checked(table, seconds(table), dict.fromkeys(names, unit))
    hidden = (points == 0.0).all(axis=1)
    if hidden.any():
        sentence = "no point, or zeros: the target was hidden; row left out."
        table = table.remarked("hidden target", sentence, rows=hidden, flag=RowFlag.INVALID)
        refuse_few(table, int(np.count_nonzero(~hidden)))
    rows = fit_rows(read, table, points, ["x", "y", "z"])
    values = rows.values
    if turns := declared.rotation:
        raw = np.stack([rows.table.columns[name] for name in turns.columns], axis=1)
        rotated = rotation(turns.form, raw, RADIANS[turns.unit])
        values = np.hstack((values, rotated.as_rotvec()))
    flange = nominal_frames(robot, robot_log.q[:: 1 + robot_log.t.size // EXTENT_ROWS]).tip.T
    seen, travel = (float(np.linalg.norm(p.std(axis=0))) for p in (values[:, :3], flange))
    if not travel / SIMILAR_EXTENT < seen < travel * SIMILAR_EXTENT:
        what = f"the points spread over {seen:.3g} m rms, the flange over {travel:.3g} m."
        remedy = f"Are they in {declared.unit}? Correct unit of sources.tracker in recording.yaml."
        raise LogError.at(rows.table.location(0), what, remedy)
    sigma = np.full(values.shape, LED_ACCURACY) if stated is None else stated.sigma(values)
    if declared.accuracy_m is not None:
        sigma[:, :3] = declared.accuracy_m
    if declared.accuracy_rad is not None:
        sigma[:, 3:] = declared.accuracy_rad
    return TrackerLog(rows.t, values, sigma, kind, rows.segment), rows.imported


def _target_of(
    folder: Path, description: RecordingFile, declared: TrackerFile
) -> tuple[Literal["point", "pose"], Instrument | None]:
    """Quantity that is measured of the target, and the instrument; None beside a ball-bar.

    Raises DescriptionError where the instrument and the columns of the orientation do not fit.
    """
    kind: Literal["point", "pose"] = "point" if declared.rotation is None else "pose"
    where = f"{folder / 'recording.yaml'}: sources.tracker"
    if not description.followed:
        if kind == "pose" and declared.accuracy_rad is None:
            what = "the accuracy of the orientation is not stated."
            raise DescriptionError.at(where, what, "Give accuracy_rad.")
        return kind, None
    instrument = load_instrument(description.instrument or "", relative_to=folder)
    if instrument.measured != kind:
        what = f"instrument {instrument.name} measures a {instrument.measured}, and the columns "
        what += f"hold a {kind}."
        remedy = "Give `rotation` with a pose, and no other key than the point's without; "
        remedy += "instruments that follow a target are tracker_point and tracker_pose."
        raise DescriptionError.at(where, what, remedy)
    return kind, instrument
