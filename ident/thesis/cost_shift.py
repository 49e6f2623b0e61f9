"""Clock alignment by least cost (thesis sec. 5.2): the ball-bar's angles are shifted in time.

The thesis takes the nominal robot, matches the encoder offsets at a few points by the ball-bar's
inverse kinematics, moves the log to the least cost within 200 ms, and does so again (`nominal`).
What the geometry is wrong by decides where that minimum lies. Identifying and shifting in turns
(`identified`) converges, but the unknown that both share goes down only by a constant factor a
round. As a parameter of the same fit (ballbar.ident.estimator.unknowns) the clock has no such
limit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, CubicSpline
from scipy.optimize import minimize_scalar

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, bar_frames, robot_frames
from ballbar.cell.inverse import bar_angles
from ballbar.ident.estimator.closure import Closure
from ballbar.ident.thesis.cost_fit import CostFit, fit_cost
from ballbar.ident.thesis.costs import Cost
from ballbar.ident.thesis.names import ENCODERS_NEEDED, PRINTED_STOP, ShiftAt
from ballbar.ident.thesis.paired_samples import through_samples

# [s] "changing the synchronization more than 200 ms might not give good results" (thesis sec. 5.2)
REACH = 0.2
SETTLED = 1e-8  # [s] a hundredth of what the clock as parameter leaves
POINTS = 5  # "a few points equally spread along the path" (thesis sec. 5.2)


@dataclass(frozen=True, eq=False)
class ShiftedFit:
    """A fit after shifting one log."""

    fit: CostFit
    shift: float = 0.0  # [s] by which the ball-bar's angles are taken later
    last_move: float = 0.0  # [s] of it, by the last round


def fit_cost_with_shift(
    cost: Cost,
    start: Geometry,
    *,
    t: Array,
    q: Array,
    b: Array,
    parameters: Sequence[int] | NDArray[np.intp],
    rounds: int,
    at: ShiftAt = "identified",
    relative_stop: float = PRINTED_STOP,
) -> ShiftedFit:
    """Move the ball-bar's log to the least cost, `rounds` times; then identify.

    t : (N,) [s] even; q (N, 6), b (N, 5) [rad] as in ballbar.ident.thesis.cost_fit. Samples closer
    than
        REACH to either end are left out, so that a shifted log still has values.
    at : geometry of each move: identified before it, or `start` with matched encoder offsets.
    """
    bar = through_samples(t, b)
    inside = (t >= t[0] + REACH) & (t <= t[-1] - REACH)
    t, q = t[inside], q[inside]
    geometry, shift, move = start, 0.0, 0.0

    def fit() -> CostFit:
        later = bar.spline(t + shift)
        return fit_cost(
            cost, geometry, q=q, b=later, parameters=parameters, relative_stop=relative_stop
        )

    for _ in range(rounds):
        if at == "nominal":
            geometry = with_matched_offsets(start, q, bar.spline(t + shift), cost)
        else:
            geometry = fit().geometry
        moved = best_shift(cost, geometry, t, q, bar.spline)
        shift, move = moved, moved - shift
    return ShiftedFit(fit(), shift, move)


def with_matched_offsets(nominal: Geometry, q: Array, b: Array, cost: Cost) -> Geometry:
    """The nominal geometry with the encoder offsets that fit its robot best at POINTS samples.

    q (N, 6), b (N, 5) [rad] : angles as read. Offsets are the mean difference to the angles of an
    ideal ball-bar that holds the robot's tool, in the configuration in which they agree best: where
    offsets may be any, the angles as read do not tell it.
    """
    needed = ENCODERS_NEEDED[cost.name]
    rows = np.linspace(0, len(q) - 1, POINTS).round().astype(int)
    read = b[rows] + nominal.bar.theta
    poses = robot_frames(nominal, q[rows]).poses()
    means = []
    for b2, b4 in product((False, True), repeat=2):
        away = bar_angles(poses, nominal.origin, flipped=(b2, b4)) - read
        means.append(np.exp(1j * away).mean(axis=0))  # a mean of length 1 where all agree
    best = max(means, key=lambda mean: sum(abs(mean[j - 1]) for j in needed))
    return nominal.replaced(
        {f"btheta{j}": nominal[f"btheta{j}"] + float(np.angle(best[j - 1])) for j in needed}
    )


def best_shift(
    cost: Cost, geometry: Geometry, t: Array, q: Array, bar: BSpline | CubicSpline
) -> float:
    """[s] shift of the ball-bar's angles against the robot's of least cost at a given geometry.

    t (N,) [s], q (N, 6) [rad] : the robot's samples, all further than REACH from the ends of `bar`,
    the spline of the five angles.
    """
    cost_at = cost_of_shift(cost, geometry, t, q, bar)
    return float(
        minimize_scalar(
            cost_at, bounds=(-REACH, REACH), method="bounded", options={"xatol": SETTLED}
        ).x
    )


def cost_of_shift(
    cost: Cost, geometry: Geometry, t: Array, q: Array, bar: BSpline | CubicSpline
) -> Callable[[float], float]:
    """The sum of squares over the shift [s] of the ball-bar's angles (thesis Fig. 5.5).

    Arguments as of `best_shift`.
    """
    robot = robot_frames(geometry, q)

    def cost_at(shift: float) -> float:
        residual = cost.residual(
            Closure(geometry, robot, bar_frames(geometry, bar(t + shift)), np.empty((6, 0)))
        )
        return float(np.vdot(residual, residual))

    return cost_at
