"""A recording folder read and its logs aligned, with what the whole cell knows.

Where the robot's angles are refused, the error begins with the cause. The reader knows the robot's
limits and asks what the angles may be. With its plate and its ball-bar the tool moves on a sphere,
and the encoders hold the rod's direction (ballbar.ident.causes): a unit, two columns or another
robot can be named.

A length that varies little does not show when the robot moves, so the comparison of rest and motion
(ballbar.acquisition.alignment) fails it; trilateration at every offset
(ballbar.ident.start.length_scan) does not.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ballbar.acquisition.alignment import CoarseAlignment, coarse_alignment
from ballbar.acquisition.faults.other_angles import OtherAnglesError
from ballbar.acquisition.faults.robot_angles import RobotAngles
from ballbar.acquisition.recording import Recording, read_ballbar, read_recording
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError, LogError
from ballbar.cell.geometry import nominal_geometry
from ballbar.cell.load import load_cell, load_measured_cell
from ballbar.cell.logs import RobotLog
from ballbar.cell.recording import load_recording_file
from ballbar.ident.causes import Causes, suspects
from ballbar.ident.estimator.sample_times import overlap
from ballbar.ident.recording_fit import Logs, smoothed
from ballbar.ident.start.automatic import length_hypotheses

APART = 0.5  # [s] two offsets closer than this are one


def read_with_causes(folder: Path) -> Recording:
    """The recording of a folder.

    Raises InputError as `acquisition.read_recording` does.
    """
    try:
        return read_recording(folder)
    except OtherAnglesError as error:
        causes = _causes(folder, error.angles)
        raise (LogError(causes.before(error.statement)) if causes else error) from None


def _causes(folder: Path, angles: RobotAngles) -> Causes | None:
    """Causes of angles that contradict the robot; None where the cell cannot be compared."""
    files = load_recording_file(folder)
    sources = files.sources
    if files.ballbar is None or sources.length is not None:
        return None
    try:
        cell = load_cell(files.robot, files.ballbar, files.plate, relative_to=folder)
        ballbar = None
        if sources.ballbar is not None:
            ballbar, _ = read_ballbar(folder, sources.ballbar, files.encoders, robot_moves=True)
    except InputError:  # of another file; the robot's log comes first
        return None
    latest = np.maximum.accumulate(angles.t)
    rows = np.flatnonzero(np.diff(latest, prepend=-np.inf) > 0.0)  # whose stamps go on
    logs = Logs(RobotLog(angles.t[rows], angles.joints[rows]), ballbar)
    hopeless = tuple(suspect for suspect in suspects(cell, logs) if suspect.hopeless)
    return Causes((folder.name,), (hopeless,))


def aligned(recording: Recording, folder: Path) -> CoarseAlignment | None:
    """The coarse clock offset, None without encoders.

    folder : of the recording, for the descriptions that it names.

    Raises LogError if the logs do not belong together.
    """
    if recording.length_log is not None:
        named = recording.description
        cell = load_measured_cell(named.robot, named.measured_by, named.plate, relative_to=folder)
        return length_alignment(recording, cell)
    bar = recording.ballbar_log
    return None if bar is None else coarse_alignment(recording.robot_log, bar)


def length_alignment(recording: Recording, cell: Cell) -> CoarseAlignment:
    """The offset at which the tool's path and the sensed length belong together.

    Raises LogError if there is none.
    """
    logs = Logs(recording.robot_log, None, length=recording.length_log)
    if recording.robot_log.q.shape[1] != cell.robot.joints:
        raise InputError(
            f"the robot's log has {recording.robot_log.q.shape[1]} joint angles, robot "
            f"{cell.robot.name} has {cell.robot.joints} axes. Name the robot that was recorded."
        )
    robot, length, _ = smoothed(logs, cell.ballbar.length)
    if length is None:
        raise LogError("the recording has no length log. Name it in recording.yaml.")
    nominal, zero_sigma = nominal_geometry(cell, np.zeros(3)), cell.ballbar.length_tolerance
    hypotheses = list(length_hypotheses(robot, length, nominal, zero_sigma))
    if not hypotheses:
        raise LogError(
            "robot and length log share too little motion at any clock offset. Are they of the "
            "same run? Log both in one run, or correct `time` of both in recording.yaml."
        )
    best = hypotheses[0]
    others = [h for h in hypotheses if abs(h.clock.offset - best.clock.offset) > APART]
    first, last = overlap(robot, length, Clock(best.clock.offset, 0.0))
    return CoarseAlignment(
        offset_s=best.clock.offset,
        score=best.score,
        overlap_s=last - first,
        runner_up_offset_s=others[0].clock.offset if others else None,
        runner_up_score=others[0].score if others else 0.0,
    )
