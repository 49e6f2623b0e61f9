"""Coarse clock offset of a recording of lengths, from the geometry of the nominal robot.

A length that varies little does not show when the robot moves, so the comparison of rest and motion
(acquisition.alignment) fails it; trilateration at every offset (ident.start.length_scan) does not.
"""

from __future__ import annotations

import numpy as np

from acquisition.alignment import CoarseAlignment
from acquisition.recording import Recording
from cell.clock import Clock
from cell.descriptions import Cell
from cell.errors import InputError, LogError
from cell.geometry import nominal_geometry
from ident.estimator.samples import overlap
from ident.recording_fit import Logs, smoothed
from ident.start.automatic import length_hypotheses

APART = 0.5  # [s] two offsets closer than this are one


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
