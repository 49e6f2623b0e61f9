"""Measurements of a robot, whatever took them: folders, files, and arrays as given.

A recording is of a moving robot that a ball-bar or a length holds. Poses are those of a table, or
of a tracker that follows the robot.
"""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path

from ballbar.acquisition.pose_tables import PoseImport, import_poses
from ballbar.acquisition.recording import Recording
from ballbar.acquisition.report import Finding, ImportReport, finding
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import robot_geometry
from ballbar.cell.load import load_robot
from ballbar.cell.pose_file import PosesFile, load_poses_file
from ballbar.cell.poses import PoseTable
from ballbar.cell.recording import RecordingFile, SourceFile, Sources, load_recording_file
from ballbar.ident.recording_fit import Logs
from ballbar.ident.signals.smooth_log import motion_of
from ballbar.ident.signals.steps import LogStep
from ballbar.ident.start.followed import followed_table
from ballbar.recordings.check import holds_poses
from ballbar.recordings.read_with_causes import read_with_causes

Measured = Recording | PoseImport
Thing = str | PathLike[str] | Recording | PoseImport | PoseTable | Logs
_NOTHING_READ = ImportReport((), ())


def read(path: str | PathLike[str]) -> Measured:
    """The recording, or the poses, of a folder or of the file that describes it.

    path : folder with recording.yaml or poses.yaml, or one of these files; any other `.yaml` is one
        of poses. A table is read if a poses.yaml beside it describes it alone.

    Raises InputError for bad files and for a table that nothing describes, and StartError where
    the logs of robot and tracker cannot be brought together.
    """
    place = Path(path)
    if place.name == "recording.yaml":
        place = place.parent
    elif place.is_file() and place.suffix != ".yaml":
        described = place.parent / "poses.yaml"
        tables = load_poses_file(described).tables if described.exists() else ()
        if [file for table in tables for file in table.files] != [place.name]:
            what = "is a file of data, which does not say what its columns are."
            raise InputError.at(place, what, "Describe it with ballbar new, and name that folder.")
        place = described
    return poses_of(place) if gives_poses(place) else read_with_causes(place)


def measured(thing: Thing, cell: Cell | None = None) -> Measured:
    """The measurements that a path names, or arrays as if they were read.

    cell : in which logs that are given as arrays were taken. Raises as `read`, and InputError for
    such logs without cell.
    """
    if isinstance(thing, Recording | PoseImport):
        return thing
    if isinstance(thing, PoseTable):
        return PoseImport(_description_of_poses(thing), thing, _NOTHING_READ)
    if not isinstance(thing, Logs):
        return read(thing)
    if cell is None:
        remedy = "Give `cell`, such as load_cell('irb2400', 'lund_600', 'plate_250')."
        raise InputError(f"logs as arrays do not say what stands in the cell. {remedy}")
    description = _description_of(cell)
    logs = thing.robot, thing.ballbar, thing.force, _NOTHING_READ
    return Recording(
        description, *logs, length_log=thing.length, tracker_log=thing.tracker, name=thing.name
    )


def _description_of_poses(table: PoseTable) -> PosesFile:
    """The names of a table's robot and of the kind of its first instrument, without files."""
    kind = table.groups[0].measured
    return PosesFile.model_construct(
        schema_="ballbar-poses/1", kind="real", robot=table.robot.name, instrument=kind, tables=()
    )


def _description_of(cell: Cell) -> RecordingFile:
    """The descriptions of a cell by their names, without device files."""
    rigid = cell.ballbar.stroke is None
    return RecordingFile.model_construct(
        schema_="ballbar-recording/1",
        kind="real",
        robot=cell.robot.name,
        ballbar=cell.ballbar.name if rigid else None,
        instrument=None if rigid else cell.ballbar.name,
        plate=cell.plate.name,
        sources=Sources.model_construct(robot=SourceFile.model_construct(files=(), dialect="")),
    )


def gives_poses(path: Path) -> bool:
    """Whether poses alone are measured: those of a table, or by a tracker that follows the robot.

    Raises InputError for a folder whose recording.yaml is wrong.
    """
    if holds_poses(path):
        return True
    return (path / "recording.yaml").exists() and load_recording_file(path).followed


def poses_of(path: Path) -> PoseImport:
    """The poses of a folder or file; raises InputError for bad files, StartError where the logs of
    robot and tracker cannot be brought together.
    """
    if holds_poses(path):
        return import_poses(path)
    recording = read_with_causes(path)
    description, tracker = recording.description, recording.tracker_log
    assert tracker is not None, "a recording that gives poses has a tracker"
    robot = load_robot(description.robot, relative_to=path)
    if (axes := recording.robot_log.q.shape[1]) != robot.joints:
        what = f"the robot's log has {axes} joint angles, robot {robot.name} {robot.joints} axes."
        raise InputError.at(path, what, "Name the robot that was recorded.")
    log, name = recording.robot_log, path.resolve().name
    motion = motion_of(log, log.q)
    table = followed_table(name, robot, robot_geometry(robot), motion, tracker)
    findings = tuple(_step(description.sources.robot.files[0], step) for step in motion.steps)
    report = replace(recording.report, findings=(*recording.report.findings, *findings))
    return PoseImport(description, table, report, path / "recording.yaml")


def _step(file: str, step: LogStep) -> Finding:
    what = "the clock was set" if step.channel is None else f"joint {step.channel + 1} stepped"
    size = f"{step.size * 1e3:+.3g} {'ms' if step.channel is None else 'mrad'}"
    sentence = f"{what} by {size} between two rows at t = {step.time:.2f} s; taken out."
    return finding("step in the log", file, sentence, count=1)
