"""Which instants of two logs enter the fit: evenly spread over the part where both logs exist and the robot moves."""

from __future__ import annotations

import numpy as np

from cell.chain import Array
from cell.clock import Clock
from ident.signals.smooth_log import SmoothLog

MARGIN = 0.3  # [s] inside both logs, so that the clock may still move during the fit
REST_KEPT = 1.0  # [s] of standstill kept at either end: the stop and the start carry the clock
MOVING = 1e-3  # [rad/s] joint speed above which the robot counts as moving (thesis sec. 5.2 uses 1e-4 on noise-free plots)


def overlap(robot: SmoothLog, bar: SmoothLog | None, clock: Clock) -> tuple[float, float]:
    """Start and end [s], on the ball-bar clock, of the stretch that both logs cover (empty: end before start)."""
    if bar is None:
        return robot.start, robot.end
    first, last = clock.ballbar_time(robot.start), clock.ballbar_time(robot.end)
    return max(bar.start, first), min(bar.end, last)


def sample_times(robot: SmoothLog, bar: SmoothLog | None, clock: Clock, count: int) -> Array:
    """(N,) [s] at most `count` instants on the ball-bar clock (the robot's without encoders), gaps left out.

    Raises ValueError when the logs share nothing, or nothing moves in what they share.
    """
    first, last = overlap(robot, bar, clock)
    first, last = first + MARGIN, last - MARGIN
    if last <= first:
        raise ValueError("the two logs do not overlap")
    grid = np.linspace(first, last, max(200, int((last - first) / 0.05)))
    moving = np.flatnonzero(np.abs(robot.speed(clock.robot_time(grid))).max(axis=1) > MOVING)
    if moving.size == 0:
        raise ValueError("the robot stands still wherever the two logs overlap")
    first = max(first, float(grid[moving[0]]) - REST_KEPT)
    last = min(last, float(grid[moving[-1]]) + REST_KEPT)
    times = np.linspace(first, last, count)
    kept = robot.covers(clock.robot_time(times))
    if bar is not None:
        kept &= bar.covers(times)
    return np.asarray(times[kept])
