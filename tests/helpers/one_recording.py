"""One recording as arrays to its identification, for tests of what the identifier does."""

from __future__ import annotations

from ballbar.cell.descriptions import Cell
from ballbar.cell.logs import BallBarLog, ForceLog, RobotLog
from ballbar.ident.identify import identify_together
from ballbar.ident.options import DEFAULTS, SILENT, FitOptions, Listener
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification


def identify(
    cell: Cell,
    robot_log: RobotLog,
    ballbar_log: BallBarLog | None,
    force_log: ForceLog | None = None,
    *,
    options: FitOptions = DEFAULTS,
    listener: Listener = SILENT,
) -> Identification:
    """The identification of one recording."""
    logs = Logs(robot_log, ballbar_log, force_log)
    return identify_together(cell, [logs], options=options, listener=listener)
