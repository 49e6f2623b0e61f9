"""Rows of the files: which of the rows taken are written, in what order, and to which file.

Every choice is made for every row taken, so that losing a row changes nothing for the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.schema import Strict
from sim.errors.clock_errors import DroppedRows, DuplicatedRows, LoggerRestart
from sim.logging.clocks import LogTimes
from sim.settings import ClockSettings
from sim.streams import stream

Rows = NDArray[np.int64]  # indices of rows taken, in the order of the file


class RowCounts(Strict):
    """Rows of one log."""

    taken: int
    dropped: int  # by chance, not by a restart
    duplicated: int


@dataclass(frozen=True, eq=False)
class LoggedRows:
    """Rows of both logs as they stand in the files."""

    robot: Rows
    ballbar: tuple[Rows, ...]  # of each file, oldest first
    counts: dict[str, RowCounts]


def logged_rows(times: LogTimes, clocks: ClockSettings, *, seed: int) -> LoggedRows:
    """The rows that a scenario's loggers write."""
    robot, bar = times.robot_true.size, times.bar_true.size
    lose = clocks.dropped_rows or DroppedRows(robot_probability=0.0, ballbar_probability=0.0)
    repeat = clocks.duplicated_rows or DuplicatedRows(
        robot_probability=0.0, ballbar_probability=0.0
    )
    lost = {
        "robot": chosen(robot, lose.robot_probability, stream(seed, "dropped_rows_robot")),
        "ballbar": chosen(bar, lose.ballbar_probability, stream(seed, "dropped_rows_ballbar")),
    }
    twice = {
        "robot": chosen(robot, repeat.robot_probability, stream(seed, "duplicated_rows_robot")),
        "ballbar": chosen(bar, repeat.ballbar_probability, stream(seed, "duplicated_rows_ballbar")),
    }
    files = {side: written(lost[side], twice[side]) for side in lost}
    return LoggedRows(
        robot=files["robot"],
        ballbar=parts(files["ballbar"], times.bar_true, clocks.restart),
        counts={
            side: RowCounts(
                taken=lost[side].size,
                dropped=int(lost[side].sum()),
                duplicated=int((twice[side] & ~lost[side]).sum()),
            )
            for side in lost
        },
    )


def chosen(rows: int, probability: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(rows,) whether each row is hit with that probability; never the first, as time counts from
    it.
    """
    hit = rng.random(rows) < probability
    hit[0] = False
    return hit


def written(lost: NDArray[np.bool_], twice: NDArray[np.bool_]) -> Rows:
    """Rows of the file in their order; lost, twice : (N,) masks of the rows taken."""
    return np.repeat(np.arange(lost.size), np.where(lost, 0, 1 + twice)).astype(np.int64)


def parts(rows: Rows, t: Array, restart: LoggerRestart | None) -> tuple[Rows, ...]:
    """Rows of each file, before and after a restart; t : (N,) [s] run time of the rows taken."""
    if restart is None:
        return (rows,)
    at = t[rows]
    return rows[at < restart.at_s], rows[at >= restart.at_s + restart.gap_s]
