"""When each logger takes its samples, in true time and on its own clock.

The robot's clock runs true. `t_robot = offset + (1 + skew) * t_bar` with both counted from the first row of their log, so
the ball-bar's clock runs slow by 1 + skew and its log begins `offset` seconds after the robot's. The later of the two logs
begins LEAD seconds into the run; whatever the other recorded before is the mechanism at rest.

The ball-bar logger is the thesis's (sec. 4.6): a 5 ms task writes a line and waits for the file, 10 ms a sample, and 15 ms
when the write takes one cycle more. Its stamps are distributed-clock time: ns since 2000-01-01.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.chain import Array

ROBOT_PERIOD = 0.004032  # [s] Lund ExtCtrl interface (log_formats sec. D)
TASK_NS = 5_000_000  # [ns] PLC task
SAMPLE_TASKS = 2  # a line is written in one cycle and waited for in the next
LEAD = 0.5  # [s] after the start and before the end of the run
BAR_EPOCH_NS = 830_000_000_000_000_000  # [ns] a day in April 2026 in time since 2000
ROBOT_EPOCH = 1234.5  # [s] controller up-time at the first row


@dataclass(frozen=True, eq=False)
class LogTimes:
    """Instants of the rows of both logs."""

    robot_true: Array  # (N,) [s]
    robot_stamp: Array  # (N,) [s]
    bar_true: Array  # (M,) [s]
    bar_stamp: NDArray[np.int64]  # (M,) [ns]
    bar_task: NDArray[np.int64]  # (M,) PLC task cycles since the first row


def log_times(duration: float, *, offset: float, skew: float, overrun_probability: float, rng: np.random.Generator) -> LogTimes:
    """Rows of both logs for a run of `duration` seconds of true time."""
    robot_start = LEAD - max(0.0, offset)
    bar_start = LEAD + min(0.0, offset)
    end = duration - LEAD
    robot_stamp: Array = ROBOT_PERIOD * np.arange(int((end - robot_start) / ROBOT_PERIOD) + 1, dtype=np.float64)
    rows = int((end - bar_start) * 1e9 / (SAMPLE_TASKS * TASK_NS)) + 1
    tasks = SAMPLE_TASKS + (rng.random(rows) < overrun_probability)
    cycles = np.cumsum(tasks) - tasks[0]
    ticks = TASK_NS * cycles
    bar_true = bar_start + (1.0 + skew) * ticks * 1e-9
    inside = bar_true <= end
    return LogTimes(robot_start + robot_stamp, ROBOT_EPOCH + robot_stamp, bar_true[inside], BAR_EPOCH_NS + ticks[inside], cycles[inside])
