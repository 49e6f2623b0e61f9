"""A recording folder read; where the robot's angles are refused, the error begins with the cause.

The reader knows the robot's limits and asks what the angles may be. The whole cell knows more: with
its plate and its ball-bar the tool moves on a sphere, and the encoders hold the rod's direction
(ident.causes). So a unit, two columns or another robot can be named.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from acquisition.faults.other_angles import OtherAnglesError
from acquisition.faults.robot_angles import RobotAngles
from acquisition.recording import Recording, read_ballbar, read_recording
from cell.errors import InputError, LogError
from cell.load import load_cell
from cell.logs import RobotLog
from cell.recording import load_recording_file
from ident.causes import Causes, suspects
from ident.recording_fit import Logs


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
    """What explains angles that contradict the robot; None where the cell cannot be compared."""
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
    logs = Logs(_forward(angles), ballbar)
    hopeless = tuple(suspect for suspect in suspects(cell, logs) if suspect.hopeless)
    return Causes((folder.name,), (hopeless,))


def _forward(angles: RobotAngles) -> RobotLog:
    """The rows whose stamps go on from those before."""
    latest = np.maximum.accumulate(angles.t)
    rows = np.flatnonzero(np.diff(latest, prepend=-np.inf) > 0.0)
    return RobotLog(angles.t[rows], angles.joints[rows])
