"""Two logs to paired samples as in thesis sec. 5.2, from the nominal geometry alone.

    moving average -> rough synchronisation by instants of standing -> encoder offsets matched at a
    few points -> outliers by cost -> shift of least cost, repeated

The clocks differ by a constant: the thesis shifts one log. What it left to the operator's eye is a
number here: the agreement of all instants of standing, and the cost of an outlier.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import correlate

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import BAR_ROWS, Geometry
from ballbar.cell.logs import BallBarLog, RobotLog
from ballbar.ident.estimator.closure import close_loop
from ballbar.ident.thesis.cost_shift import REACH, best_shift, with_matched_offsets
from ballbar.ident.thesis.costs import Cost, cost_named
from ballbar.ident.thesis.names import ENCODERS_NEEDED

PERIOD = 0.1  # [s] of the moving average of each log (thesis sec. 5.2)
STANDING = 1e-4  # [rad/s] of every joint of a log (thesis sec. 5.2)
STEP = 0.01  # [s] of the rough synchronisation, within +-100 ms (thesis sec. 5.2)
ROUNDS = 5  # of shifting, "repeating the process with more iterations" (thesis sec. 5.2)
# Cost of an outlier over the median: ten times the distance, since the clock is still off by what
# rough synchronisation leaves, which costs most where the motion is fast. The thesis prints no
# limit.
OUTLIER = 100.0


@dataclass(frozen=True, eq=False)
class PairedLogs:
    """Samples of both logs, and the nominal geometry with matched encoder offsets."""

    start: Geometry
    q: Array  # (N, J) [rad]
    b: Array  # (N, 5) [rad] as read; 0 at joints without encoder
    offset: float  # [s] robot time at the first row of the ball-bar's log


def pair_logs(
    cost: Cost, nominal: Geometry, robot: RobotLog, ballbar: BallBarLog, *, count: int
) -> PairedLogs:
    """At most `count` samples of both logs, evenly spread over the motion without its stops.

    nominal : robot and ball-bar by their drawings, the origin as it was measured. A cost without
    encoders has no least shift, and keeps the rough one.

    Raises ValueError where nothing of the motion lies in both logs.
    """
    q, read = moving_average(robot.t, robot.q), moving_average(ballbar.t, ballbar.angles)
    standing = is_standing(robot.t, q)
    offset = rough_offset(robot.t, standing, ballbar.t, is_standing(ballbar.t, read))
    later = robot.t - offset  # of the ball-bar's clock
    inside = (later >= ballbar.t[0] + REACH) & (later <= ballbar.t[-1] - REACH)
    rows = np.flatnonzero(inside & ~standing)
    if not rows.size:
        raise ValueError("the logs have no motion in common; check that they are of one run")
    rows = rows[np.linspace(0, rows.size - 1, min(count, rows.size)).round().astype(int)]
    angles = np.zeros((ballbar.t.size, BAR_ROWS))
    angles[:, [j - 1 for j in ballbar.joints]] = read
    bar, t, q = CubicSpline(ballbar.t, angles), later[rows], q[rows]
    start = with_matched_offsets(nominal, q, bar(t), cost)
    usual = _without_outliers(cost, start, q, bar(t))
    t, q, shift = t[usual], q[usual], 0.0
    for _ in range(ROUNDS if ENCODERS_NEEDED[cost.name] else 0):
        shift = best_shift(cost, start, t, q, bar)
        start = with_matched_offsets(nominal, q, bar(t + shift), cost)
    return PairedLogs(start, q, bar(t + shift), offset - shift)


def moving_average(t: Array, angles: Array, period: float = PERIOD) -> Array:
    """(N, K) [rad] mean of the rows within half a period before and after each row.

    t : (N,) [s] rising, even or not. angles : (N, K) [rad]. Towards the ends the window narrows
    evenly, so that no row is delayed.
    """
    half = np.minimum(0.5 * period, np.minimum(t - t[0], t[-1] - t))
    tolerance = 1e-6 * period  # of rounding: rows on the window's edge belong to it
    first = np.searchsorted(t, t - half - tolerance)
    last = np.searchsorted(t, t + half + tolerance)
    sums = np.concatenate((np.zeros((1, angles.shape[1])), np.cumsum(angles, axis=0)))
    return np.asarray((sums[last] - sums[first]) / (last - first)[:, None])


def is_standing(t: Array, angles: Array) -> NDArray[np.bool_]:
    """(N,) whether every joint is slower than STANDING; angles (N, K) [rad] at t (N,) [s]."""
    return np.asarray(np.abs(np.gradient(angles, t, axis=0)).max(axis=1) < STANDING)


def rough_offset(
    robot_t: Array, robot_standing: NDArray[np.bool_], bar_t: Array, bar_standing: NDArray[np.bool_]
) -> float:
    """[s] robot time less ball-bar time at which most instants of standing agree (Fig. 5.3).

    robot_t (N,), bar_t (M,) [s] with (N,) and (M,) whether all joints of the log stand still.
    """
    robot, bar = _even(robot_t, robot_standing), _even(bar_t, bar_standing)
    agreement = correlate(robot, bar)
    lag = int(np.argmax(agreement)) - (bar.size - 1)
    return float(robot_t[0] - bar_t[0]) + STEP * lag


def _even(t: Array, standing: NDArray[np.bool_]) -> Array:
    """Rows at every STEP, without their mean."""
    rows = np.interp(np.arange(t[0], t[-1], STEP), t, standing.astype(np.float64))
    return np.asarray(rows - rows.mean())


def _without_outliers(cost: Cost, geometry: Geometry, q: Array, b: Array) -> NDArray[np.bool_]:
    """(N,) whether a sample costs less than an outlier does."""
    components = cost_named(cost.name, "vector").residual(close_loop(geometry, q, b))
    each = (components**2).sum(axis=0)
    return np.asarray(each <= OUTLIER * np.median(each))
