"""Poses of a folder, whatever the robot did there: a table of still ones, or followed ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ballbar.acquisition.pose_tables import PoseImport, import_poses
from ballbar.acquisition.report import Finding, finding
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import robot_geometry
from ballbar.cell.load import load_robot
from ballbar.cell.pose_file import PosesFile, load_poses_file, pose_file_path
from ballbar.cell.recording import RecordingFile, load_recording_file
from ballbar.ident.signals.smooth_log import motion_of
from ballbar.ident.signals.steps import LogStep
from ballbar.ident.start.followed import followed_table
from ballbar.recordings.check import holds_poses
from ballbar.recordings.read_with_causes import read_with_causes


def gives_poses(path: Path) -> bool:
    """Whether poses alone are measured: those of a table, or by a tracker that follows the robot.

    Raises InputError for a folder whose recording.yaml is wrong.
    """
    if holds_poses(path):
        return True
    return (path / "recording.yaml").exists() and load_recording_file(path).followed


def description_of(path: Path) -> tuple[Path, PosesFile | RecordingFile]:
    """The file that describes poses, and its content. Raises DescriptionError where it is wrong."""
    if holds_poses(path):
        return pose_file_path(path), load_poses_file(pose_file_path(path))
    return path / "recording.yaml", load_recording_file(path)


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
