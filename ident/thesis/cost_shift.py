"""Clock alignment by least cost (thesis sec. 5.2): the ball-bar's angles are shifted in time.

What the geometry is wrong by decides where that minimum lies, and the geometry was identified with
the clocks still apart. Identifying and shifting in turns converges, but the unknown that both share
goes down only by a constant factor a round. As a parameter of the same fit
(ident.estimator.unknowns) the clock has no such limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cell.arrays import Array
from cell.geometry import Geometry, bar_frames, robot_frames
from ident.estimator.closure import Closure
from ident.signals.smooth_log import SmoothLog
from ident.thesis.cost_fit import CostFit, fit_cost
from ident.thesis.costs import Cost
from ident.thesis.paired_samples import through_samples

# [s] "changing the synchronization more than 200 ms might not give good results" (thesis sec. 5.2)
REACH = 0.2
SETTLED = 1e-8  # [s] a hundredth of what the clock as parameter leaves


@dataclass(frozen=True, eq=False)
class ShiftedFit:
    """A fit after shifting one log."""

    fit: CostFit
    shift: float  # [s] by which the ball-bar's angles are taken later


def fit_cost_with_shift(
    cost: Cost,
    start: Geometry,
    *,
    t: Array,
    q: Array,
    b: Array,
    parameters: Sequence[int] | NDArray[np.intp],
    rounds: int,
    rod_sign: Array | None = None,
) -> ShiftedFit:
    """Identify, move the ball-bar's log to the least cost, `rounds` times; then identify once more.

    t : (N,) [s] even; q (N, 6), b (N, 5) [rad] and rod_sign (N,) as in ident.thesis.cost_fit.
        Samples closer than REACH to either end are left out, so that a shifted log still has
        values.
    """
    bar = through_samples(t, b)
    inside = (t >= t[0] + REACH) & (t <= t[-1] - REACH)
    t, q = t[inside], q[inside]
    sign = None if rod_sign is None else rod_sign[inside]
    geometry, shift = start, 0.0

    def fit() -> CostFit:
        later = bar.spline(t + shift)
        return fit_cost(cost, geometry, q=q, b=later, parameters=parameters, rod_sign=sign)

    for _ in range(rounds):
        geometry = fit().geometry
        shift = best_shift(cost, geometry, t, q, bar)
    return ShiftedFit(fit(), shift)


def best_shift(cost: Cost, geometry: Geometry, t: Array, q: Array, bar: SmoothLog) -> float:
    """[s] shift of the ball-bar's angles against the robot's of least cost at a given geometry.

    t (N,) [s], q (N, 6) [rad] : the robot's samples, all further than REACH from the ends of `bar`.
    """
    robot = robot_frames(geometry, q)

    def cost_at(shift: float) -> float:
        residual = cost.residual(
            Closure(geometry, robot, bar_frames(geometry, bar.spline(t + shift)), np.empty((6, 0)))
        )
        return float(np.vdot(residual, residual))

    return float(
        minimize_scalar(
            cost_at, bounds=(-REACH, REACH), method="bounded", options={"xatol": SETTLED}
        ).x
    )
