"""The trajectory of a scenario that repeats a recorded one."""

from __future__ import annotations

from pathlib import Path

from acquisition import read_recording
from cell.logs import RobotLog
from sim.settings import PathSettings


def recorded_log(path: PathSettings, folder: Path) -> RobotLog | None:
    """Robot log of the recording that a scenario's path repeats; None for every other kind of path.

    folder : folder of the scenario file, to which `path.recording` is relative.

    Raises InputError for a recording that cannot be read.
    """
    return read_recording(folder / path.recording).robot_log if path.kind == "recorded" else None
