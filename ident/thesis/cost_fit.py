"""One of the thesis's cost functions, minimised over samples that are already on one clock.

The loop is that of the maximum-likelihood fit (ballbar.ident.estimator.gauss_newton). The vector
forms are stopped like that one, by what the undamped step still predicts; they take a handful of
iterations. The printed scalars (eqs. 2.2 to 2.4) vanish quadratically at the solution, so each step
only halves the error, however good the solver; they are stopped as a user of a library's
Levenberg-Marquardt would stop them, by relative decrease of cost and of step.

Where the sign of the rod's force is known, its compliance is one more unknown (thesis ch. 6): the
rod is `bd3 + sign * deviation` long, so its column is that of bd3 times the sign, and the residual
is linear in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, bar_frames, parameter_named, robot_frames
from ballbar.ident.estimator.closure import Closure
from ballbar.ident.estimator.dependencies import select
from ballbar.ident.estimator.gauss_newton import Marquardt, Stop, minimise
from ballbar.ident.estimator.thesis_names import BAR_PARAMETERS, thesis_parameters
from ballbar.ident.thesis.costs import ROD, Cost
from ballbar.ident.thesis.names import PRINTED_STOP, CostName, ParameterSet

# The vector forms end a hundredth of a standard deviation from the minimum
# (ballbar.ident.estimator.fit), or with a step of a thousandth of a nanometre.
VECTOR_STOP = Stop(decrease=1e-4, whitened=False, step=1e-12)
MAX_ITERATIONS = 500  # the thesis's limit (thesis sec. 5.3)


@dataclass(frozen=True, eq=False)
class CostFit:
    """The outcome of one minimisation."""

    geometry: Geometry
    parameters: NDArray[np.intp]  # (P,) indices into the table
    iterations: int  # accepted steps
    converged: bool
    cost: float  # sum of squared residuals: for a printed scalar, of its square
    rms: float  # of the residuals [of the cost's components; printed: of the scalar]
    rod_deviation: float  # [m] of the rod's length from bd3 where it is pulled; 0 unless requested


@dataclass(frozen=True, eq=False)
class _Point:
    """One value of the unknowns; its Jacobian is formed when it is asked for."""

    problem: _Problem
    x: Array  # (P [+ 1],) parameters, then the rod's deviation
    closure: Closure
    residual: Array  # (E, N)

    @property
    def cost(self) -> float:
        return float(np.vdot(self.residual, self.residual))

    @property
    def equations(self) -> int:
        return int(self.residual.size)


@dataclass(frozen=True, eq=False)
class _Linear(_Point):
    """A point with its normal equations."""

    normal: Array
    gradient: Array


@dataclass(frozen=True, eq=False)
class _Problem:
    """One cost over paired samples."""

    cost: Cost
    begin: Geometry
    q: Array  # (N, 6) [rad]
    b: Array  # (N, 5) [rad]
    parameters: NDArray[np.intp]  # (P,) indices into the table
    sign: Array | None  # (N,) of the rod's force, if its deviation is an unknown

    def at(self, x: Array) -> _Point:
        """The residual at x (P [+ 1],)."""
        values = self.begin.values.copy()
        values[self.parameters] = x[: self.parameters.size]
        closure = _closure(self.begin.with_values(values), self.q, self.b)
        residual = self.cost.residual(closure)
        if self.sign is not None:
            residual = residual + float(x[-1]) * self._rod_column(closure)
        return _Point(self, x, closure, residual)

    def linear(self, point: _Point) -> _Linear:
        """The point with its normal equations."""
        parameters = [self.begin.table.parameters[i] for i in self.parameters]
        columns = self.cost.jacobian(point.closure, parameters).reshape(len(parameters), -1)
        if self.sign is not None:
            columns = np.vstack((columns, self._rod_column(point.closure).reshape(-1)))
        gradient = columns @ point.residual.reshape(-1)
        return _Linear(self, point.x, point.closure, point.residual, columns @ columns.T, gradient)

    def start(self) -> _Linear:
        deviation = [] if self.sign is None else [0.0]
        point = self.at(np.append(self.begin.values[self.parameters], deviation))
        if not np.isfinite(point.cost):
            raise ValueError(
                "the cost of the start is not finite: an angle of the samples is missing"
            )
        return self.linear(point)

    def trial(self, equations: _Linear, step: Array) -> _Point:
        return self.at(equations.x + step)

    def accept(self, _equations: _Linear, accepted: _Point, _iterations: int) -> _Linear:
        return self.linear(accepted)

    def reuse(self, _equations: _Linear, accepted: _Point) -> _Linear:
        return self.linear(accepted)

    def _rod_column(self, closure: Closure) -> Array:
        return np.asarray(self.sign * self.cost.jacobian(closure, [parameter_named(ROD)])[0])


def fit_cost(
    cost: Cost,
    start: Geometry,
    *,
    q: Array,
    b: Array,
    parameters: Sequence[int] | NDArray[np.intp],
    rod_sign: Array | None = None,
    relative_stop: float = PRINTED_STOP,
    max_iterations: int = MAX_ITERATIONS,
) -> CostFit:
    """Minimise one cost over some parameters.

    q : (N, 6) [rad] logged robot angles. b : (N, 5) [rad] ball-bar angles as the encoders read. At
    joints that the cost does not need (ballbar.ident.thesis.costs.ENCODERS_NEEDED) any value
    serves, as long as the rows behind them have no lengths. parameters : (P,) indices into the
    table; the others stay as in `start`. rod_sign : (N,) sign of the rod's force, +1 pulled; its
    deviation from bd3 is then an unknown too. Of vector forms only. relative_stop : decrease of a
    printed scalar's cost, or size of a step, against their own size at which it ends.

    Raises ValueError when an angle is not finite, and for the sign of a printed scalar.
    """
    if rod_sign is not None and cost.form != "vector":
        raise ValueError(
            "the rod's deviation is linear in the signed components only, not in a printed scalar"
        )
    problem = _Problem(cost, start, q, b, np.asarray(parameters, dtype=np.intp), rod_sign)
    stop = VECTOR_STOP if cost.form == "vector" else Stop(relative=relative_stop)
    minimum = minimise(problem, stop, max_iterations=max_iterations, search=Marquardt())
    end = minimum.equations
    return CostFit(
        geometry=end.closure.geometry,
        parameters=problem.parameters,
        iterations=minimum.iterations,
        converged=minimum.converged
        or minimum.stuck,  # stuck: no step lowers the cost any more, rounding
        cost=end.cost,
        rms=float(np.sqrt(end.cost / end.equations)),
        rod_deviation=0.0 if rod_sign is None else float(end.x[-1]),
    )


def _closure(geometry: Geometry, q: Array, b: Array) -> Closure:
    """Both tool frames, without the rotation vector between them.

    No cost looks at it, and it would take a third of the time.
    """
    return Closure(geometry, robot_frames(geometry, q), bar_frames(geometry, b), np.empty((6, 0)))


def identifiable_by(
    cost: CostName, nominal: Geometry, q: Array, b: Array, *, choice: ParameterSet = "core"
) -> NDArray[np.intp]:
    """Indices into the table of what a cost determines, in order of priority (thesis sec. 3.3).

    Requested are those of `choice`; of these it selects what does not depend on those before, the
    plate last. q : (N, 6), b : (N, 5) [rad] angles at which the nominal loop closes.
    """
    table = nominal.table
    left_out = BAR_PARAMETERS if choice == "core" else ()
    names = [name for name in thesis_parameters(table) if name not in left_out]
    parameters = [table.parameters[table.index[name]] for name in names]
    columns = Cost(cost, "vector").jacobian(_closure(nominal, q, b), parameters)
    selected = select(columns.reshape(len(names), -1), names, nominal).selected
    return np.array([table.index[name] for name in selected])
