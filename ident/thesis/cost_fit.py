"""Levenberg-Marquardt for one of the thesis's cost functions, over samples of both logs that are already on one clock.

Damped normal equations with columns scaled to unit norm, as in ident.estimator.solver. The vector forms are stopped like that one, by what the
undamped step still promises; they take a handful of iterations. The printed scalars (eqs. 2.2-2.4) vanish quadratically at the
solution, so each step only halves the error, however good the solver; they are stopped as a user of a library's Levenberg-Marquardt
would stop them, by relative decrease of cost and of step.

Where the sign of the rod's force is known, how far the rod gives way under it is one more unknown (thesis ch. 6): the rod is
`bd3 + sign * deviation` long, so its column is that of bd3 times the sign, and the residual is linear in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from cell.chain import Array
from cell.geometry import INDEX, NAMES, PARAMETERS, Geometry, bar_frames, robot_frames
from ident.estimator.closure import Closure
from ident.estimator.dependencies import select
from ident.estimator.identifiability import candidates
from ident.thesis.costs import ENCODERS_NEEDED, ROD, Cost, CostName

DAMPING_START = 1e-12
DAMPING_MAX = 1e6
NEGLIGIBLE = 1e-4  # predicted decrease in units of the cost per degree of freedom: a hundredth of a standard deviation (ident.estimator.solver)
ROUNDING_STEP = 1e-12  # [m, rad] of an undamped step: a thousandth of a nanometre
RELATIVE_DECREASE = (
    1e-10  # of the cost, and of the step against the parameters: what stops the printed scalars
)
MAX_ITERATIONS = 500  # the thesis's limit (thesis sec. 5.3)


@dataclass(frozen=True, eq=False)
class CostFit:
    """The outcome of one minimisation."""

    geometry: Geometry
    parameters: NDArray[np.intp]  # (P,) indices into PARAMETERS
    iterations: int  # accepted steps
    converged: bool
    cost: float  # sum of squared residuals: for a printed scalar, of its square
    rms: float  # of the residuals [of the cost's components; printed: of the scalar]
    rod_deviation: (
        float  # [m] of the rod's length from bd3 where it is pulled; 0 unless it was asked for
    )


@dataclass(frozen=True, eq=False)
class _Problem:
    """What stays the same during one minimisation."""

    cost: Cost
    q: Array  # (N, 6) [rad]
    b: Array  # (N, 5) [rad]
    chosen: NDArray[np.intp]  # (P,) indices into PARAMETERS
    sign: Array | None  # (N,) of the rod's force, if its deviation is an unknown

    def point(self, geometry: Geometry, deviation: float) -> _Point:
        closure = _closure(geometry, self.q, self.b)
        point = _Point(geometry, deviation, closure, self.cost.residual(closure))
        return (
            point
            if self.sign is None
            else replace(point, residual=point.residual + deviation * self._rod_column(point))
        )

    def columns(self, here: _Point) -> Array:
        """(P, E * N), and a last row for the rod's deviation."""
        columns = self.cost.jacobian(here.closure, [PARAMETERS[i] for i in self.chosen]).reshape(
            self.chosen.size, -1
        )
        return (
            columns
            if self.sign is None
            else np.vstack((columns, self._rod_column(here).reshape(-1)))
        )

    def moved(self, here: _Point, step: Array) -> _Point:
        values = here.geometry.values.copy()
        values[self.chosen] += step[: self.chosen.size]
        return self.point(Geometry(values), here.deviation + float(step[self.chosen.size :].sum()))

    def _rod_column(self, here: _Point) -> Array:
        return np.asarray(self.sign * self.cost.jacobian(here.closure, [PARAMETERS[INDEX[ROD]]])[0])


@dataclass(frozen=True, eq=False)
class _Point:
    """One geometry, and how the samples look from there."""

    geometry: Geometry
    deviation: float  # [m] of the rod
    closure: Closure
    residual: Array  # (E, N)

    @property
    def cost(self) -> float:
        return float(np.vdot(self.residual, self.residual))


def fit_cost(
    cost: Cost,
    start: Geometry,
    q: Array,
    b: Array,
    parameters: Sequence[int] | NDArray[np.intp],
    *,
    rod_sign: Array | None = None,
    max_iterations: int = MAX_ITERATIONS,
) -> CostFit:
    """Minimise one cost over some parameters.

    q : (N, 6) [rad] logged robot angles; b : (N, 5) [rad] ball-bar angles as the encoders give them. At joints that the cost does not
        need (ident.thesis.costs.ENCODERS_NEEDED) any value does, as long as the rows behind have no lengths.
    parameters : (P,) indices into PARAMETERS; the others stay as in `start`.
    rod_sign : (N,) sign of the rod's force, +1 pulled; its deviation from bd3 is then an unknown too. Of vector forms only.

    Raises ValueError when an angle is not finite, and for the sign of a printed scalar.
    """
    if rod_sign is not None and cost.form != "vector":
        raise ValueError(
            "the rod's deviation is linear in the signed components only, not in a printed scalar"
        )
    problem = _Problem(cost, q, b, np.asarray(parameters, dtype=np.intp), rod_sign)
    here = problem.point(start, 0.0)
    if not np.isfinite(here.cost):
        raise ValueError("the cost of the start is not finite: an angle of the samples is missing")
    damping, iterations, converged = DAMPING_START, 0, False
    while not converged and iterations < max_iterations:
        columns = problem.columns(here)
        normal, gradient = columns @ columns.T, columns @ here.residual.reshape(-1)
        if _arrived(cost, here, normal, gradient):
            converged = True
            break
        there, step, damping = _accepted(problem, here, normal, gradient, damping)
        if there is None:  # no step lowers the cost any more: rounding
            converged = True
            break
        iterations += 1
        converged = cost.form == "thesis" and _stalled(here, there, step, problem.chosen)
        here = there
    rms = float(np.sqrt(here.cost / here.residual.size))
    return CostFit(
        here.geometry, problem.chosen, iterations, converged, here.cost, rms, here.deviation
    )


def _closure(geometry: Geometry, q: Array, b: Array) -> Closure:
    """Both tool frames; without the rotation vector between them, which no cost looks at and which takes a third of the time."""
    return Closure(geometry, robot_frames(geometry, q), bar_frames(geometry, b), np.empty((6, 0)))


def _arrived(cost: Cost, here: _Point, normal: Array, gradient: Array) -> bool:
    """Whether the undamped step promises nothing any more."""
    if cost.form == "thesis":
        return False
    step = _step(normal, gradient, DAMPING_START)
    unit = here.cost / max(1, here.residual.size - step.size)
    return bool(-(gradient @ step) < NEGLIGIBLE * unit or np.abs(step).max() < ROUNDING_STEP)


def _stalled(here: _Point, there: _Point, step: Array, chosen: NDArray[np.intp]) -> bool:
    small = float(np.linalg.norm(step)) <= RELATIVE_DECREASE * float(
        np.linalg.norm(there.geometry.values[chosen])
    )
    return small or here.cost - there.cost <= RELATIVE_DECREASE * here.cost


def _step(normal: Array, gradient: Array, damping: float) -> Array:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    scaled = normal * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += damping
    return np.asarray(-scale * cho_solve(cho_factor(scaled), scale * gradient))


def _accepted(
    problem: _Problem, here: _Point, normal: Array, gradient: Array, damping: float
) -> tuple[_Point | None, Array, float]:
    """The next point, the step to it and the damping after it; no point where no step lowers the cost."""
    step = np.zeros(gradient.size)
    while damping <= DAMPING_MAX:
        step = _step(normal, gradient, damping)
        there = problem.moved(here, step)
        if there.cost < here.cost:
            return there, step, max(DAMPING_START, damping * 0.01)
        damping = max(1e-6, damping * 10.0)
    return None, step, damping


def identifiable_by(cost: CostName, nominal: Geometry, q: Array, b: Array) -> NDArray[np.intp]:
    """The parameters that a cost determines, by the rule of thesis sec. 3.3: indices into PARAMETERS, in order of priority.

    Asked for are the zeros of the encoders that the cost needs, origin, robot and rod, never the plate; of these it keeps what does
    not depend on those before. q (N, 6), b (N, 5) [rad] : angles at which the nominal loop closes.
    """
    asked = candidates(ENCODERS_NEEDED[cost])
    columns = Cost(cost, "vector").jacobian(_closure(nominal, q, b), [PARAMETERS[i] for i in asked])
    kept = select(columns.reshape(asked.size, -1), [NAMES[i] for i in asked], nominal).kept
    return np.array([INDEX[name] for name in kept])
