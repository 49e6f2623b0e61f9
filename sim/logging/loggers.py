"""Which of the rows that were taken stand in the files, in what order, and in which file.

Every choice is made for every row taken, so that losing one row changes nothing about the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.schema import Strict
from sim.errors.clock_errors import LoggerRestart
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
    """Rows of both logs as the files have them."""

    robot: Rows
    ballbar: tuple[Rows, ...]  # of each file, the oldest first
    counts: dict[str, RowCounts]


def logged_rows(times: LogTimes, clocks: ClockSettings, *, seed: int) -> LoggedRows:
    """The rows that a scenario's loggers write."""
    robot, bar = times.robot_true.size, times.bar_true.size
    dropped, duplicated = clocks.dropped_rows, clocks.duplicated_rows
    lost = {
        "robot": chosen(
            robot, dropped.robot_probability if dropped else 0.0, stream(seed, "dropped_rows_robot")
        ),
        "ballbar": chosen(
            bar,
            dropped.ballbar_probability if dropped else 0.0,
            stream(seed, "dropped_rows_ballbar"),
        ),
    }
    twice = {
        "robot": chosen(
            robot,
            duplicated.robot_probability if duplicated else 0.0,
            stream(seed, "duplicated_rows_robot"),
        ),
        "ballbar": chosen(
            bar,
            duplicated.ballbar_probability if duplicated else 0.0,
            stream(seed, "duplicated_rows_ballbar"),
        ),
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
    """(rows,) which rows an accident of that probability hits; never the first, from which time counts."""
    hit = rng.random(rows) < probability
    hit[0] = False
    return hit


def written(lost: NDArray[np.bool_], twice: NDArray[np.bool_]) -> Rows:
    """Rows of the file: (N,) masks of those lost and of those written twice."""
    return np.repeat(np.arange(lost.size), np.where(lost, 0, 1 + twice)).astype(np.int64)


def parts(rows: Rows, t: Array, restart: LoggerRestart | None) -> tuple[Rows, ...]:
    """The rows before and after a restart; t : (N,) [s] run time of the rows taken."""
    if restart is None:
        return (rows,)
    at = t[rows]
    return rows[at < restart.at_s], rows[at >= restart.at_s + restart.gap_s]
