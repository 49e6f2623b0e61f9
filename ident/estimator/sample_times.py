"""Instants at which a recording is sampled: spread evenly where both logs exist and it moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.signals.smooth_log import SmoothLog, smoothing

MARGIN = 0.3  # [s] inside both logs, so that the clock may still move during the fit
# [s] of the dwell at either end: where the motion starts and stops tells the clock
DWELL_KEPT = 1.0
STRETCH = 20.0  # [s] of close samples
MOVING = 1e-3  # [rad/s] of a moving joint (thesis sec. 5.2 uses 1e-4 on noise-free plots)
_GRID_STEP, _GRID_SIZE = 0.05, 200  # [s], instants at least, on which motion is looked for


def overlap(robot: SmoothLog, ballbar: SmoothLog | None, clock: Clock) -> tuple[float, float]:
    """Start and end [s] of the stretch that both logs cover; where there is none, end < start."""
    if ballbar is None:
        return robot.start, robot.end
    first, last = clock.ballbar_time(np.array([robot.start, robot.end]))
    return max(ballbar.start, float(first)), min(ballbar.end, float(last))


def sample_times(robot: SmoothLog, ballbar: SmoothLog | None, clock: Clock, count: int) -> Array:
    """(N,) [s] at most `count` evenly spread instants, those in gaps of either log left out.

    None are closer than the smoothing of the logs: those would share noise, and tell nothing new.

    Raises ValueError when the logs do not overlap, or nothing moves where they do.
    """
    first, last = overlap(robot, ballbar, clock)
    first, last = first + MARGIN, last - MARGIN
    if last <= first:
        raise ValueError("the two logs do not overlap")
    grid = np.linspace(first, last, max(_GRID_SIZE, int((last - first) / _GRID_STEP)))
    speed = np.abs(robot.speed(clock.robot_time(grid))).max(axis=1)
    moving = np.flatnonzero(speed > MOVING)
    if moving.size == 0:
        raise ValueError("the robot stands still wherever the two logs overlap")
    first = max(first, float(grid[moving[0]]) - DWELL_KEPT)
    last = min(last, float(grid[moving[-1]]) + DWELL_KEPT)
    apart = int((last - first) / smoothing(robot, ballbar)) + 1
    times = np.linspace(first, last, min(count, apart))
    return _covered(robot, ballbar, clock, times)


def close_times(samples: Samples, clock: Clock, spacing: float) -> Array:
    """(N,) [s] as many instants as the samples have, no farther apart than `spacing` [s].

    Where the samples are, they come in stretches of STRETCH seconds, spread evenly.
    """
    times = samples.times
    first, last = times[0], times[-1]
    if last - first <= spacing * times.size:
        return times
    count = max(2, round(times.size * spacing / STRETCH))
    begins = np.linspace(first, last - STRETCH, count)
    close = (begins[:, None] + np.arange(0.0, STRETCH, spacing)).ravel()
    return _covered(samples.robot, samples.ballbar, clock, close)


def _covered(robot: SmoothLog, ballbar: SmoothLog | None, clock: Clock, times: Array) -> Array:
    """The times out of (N,) [s] that lie in no gap of either log."""
    covered: NDArray[np.bool_] = robot.covers(clock.robot_time(times))
    if ballbar is not None:
        covered &= ballbar.covers(times)
    return np.asarray(times[covered])
