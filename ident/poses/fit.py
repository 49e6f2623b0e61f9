"""Robust maximum a posteriori fit of still poses: iteratively reweighted Gauss-Newton.

Weights of poses whose whitened residual is long fall as in Huber 1964; those very far off are left
out. What the model leaves unexplained is estimated along with it, as one variance of position and
one of rotation: with P unknowns of which the data determine p, the mean square of the residuals
times `n / (n - p)`. The priors of the robot's parameters and of the corrections' coefficients have
the tails of Student's distribution, so that a joint whose zero was lost is not held at its
catalogue value, nor the sag under a heavy tool near none (Lange, Little & Taylor 1989: both are
weights of an iteration).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.poses import KnownDistance
from ident.estimator.gauss_newton import Stop, inverse, minimise
from ident.estimator.whitening import Whitening
from ident.poses.model import Discrepancy, GroupPoint, PoseModel
from ident.poses.unknowns import PoseUnknowns

HUBER = 3.0  # of the root mean square of a pose's whitened residual (docs/real_robots)
GROSS = 10.0  # likewise: a pose further off is left out
MEDIAN = 0.9  # of the root mean square of three normal numbers
TAILS = 4.0  # degrees of freedom of the priors' Student distribution
ROUNDS = 15  # of new discrepancies and weights
SETTLED = 0.01  # relative change of the discrepancies that ends them
NEGLIGIBLE = 1e-3  # decrease of the cost that ends a search, per degree of freedom
START = Discrepancy(1e-3, 1e-3)  # before a residual is known
LEAST = Discrepancy(1e-7, 1e-7)  # [m], [rad]


@dataclass(frozen=True, eq=False)
class PoseEquations:
    """Normal equations at x, and what they were made of; costs include the prior."""

    x: Array  # (P,)
    points: tuple[GroupPoint, ...]
    weights: tuple[Whitening, ...]
    robust: tuple[Array, ...]  # (N,) square root of each pose's robust weight
    residuals: tuple[Array, ...]  # (E, N) each, whitened, robust weights included
    jacobians: tuple[Array, ...]  # (P, E, N) likewise
    normal: Array  # (P, P)
    gradient: Array  # (P,) of half the cost
    cost: float

    @property
    def equations(self) -> int:
        return sum(r.size for r in self.residuals)


@dataclass(frozen=True, eq=False)
class _Trial:
    x: Array
    cost: float


@dataclass(frozen=True, eq=False)
class PoseFit:
    """The outcome of a fit."""

    model: PoseModel
    equations: PoseEquations
    discrepancy: Discrepancy
    covariance: Array  # (P, P)
    iterations: int
    converged: bool

    @property
    def x(self) -> Array:
        """(P,) the estimate."""
        return self.equations.x

    @property
    def robust_weights(self) -> Array:
        """(N,) of every pose, 1 where it counts in full."""
        return np.concatenate(self.equations.robust) ** 2


@dataclass(frozen=True, eq=False)
class _Problem:
    """What `minimise` solves: weights as they are."""

    model: PoseModel
    x: Array
    discrepancy: Discrepancy
    robust: tuple[Array, ...]

    def start(self) -> PoseEquations:
        return pose_equations(self.model, self.x, self.discrepancy, self.robust)

    def trial(self, equations: PoseEquations, step: Array) -> _Trial:
        x = equations.x + step
        points = self.model.evaluate(x)
        total = _prior_cost(self.model, x)
        parts = zip(points, equations.weights, equations.robust, strict=True)
        total += sum(float(((w(p.closure.error) * r) ** 2).sum()) for p, w, r in parts)
        return _Trial(x, total)

    def accept(self, equations: PoseEquations, accepted: _Trial, iterations: int) -> PoseEquations:
        del equations, iterations  # weights stay, and nothing is reused
        return pose_equations(self.model, accepted.x, self.discrepancy, self.robust)

    def reuse(self, equations: PoseEquations, accepted: _Trial) -> PoseEquations:
        raise NotImplementedError  # no Jacobian is reused


def fit_poses(
    model: PoseModel,
    x: Array,
    discrepancy: Discrepancy = START,
    *,
    left_out: NDArray[np.intp] | None = None,
) -> PoseFit:
    """Fit the model from x (P,).

    left_out : poses, by their place in the table, that shall not count.
    """
    counting = np.ones(model.table.size)
    counting[[] if left_out is None else left_out] = 0.0
    counts = np.split(counting, np.cumsum([g.size for g in model.table.groups])[:-1])
    declared = model.unknowns
    robust = tuple(counts)
    iterations, converged = 0, False
    for _ in range(ROUNDS):
        minimum = minimise(
            _Problem(model, x, discrepancy, robust), Stop(decrease=NEGLIGIBLE), max_iterations=15
        )
        equations, x = minimum.equations, minimum.equations.x
        iterations += minimum.iterations
        before, discrepancy = discrepancy, unexplained(model, equations)
        robust = tuple(r * c for r, c in zip(robust_weights(equations), counts, strict=True))
        model = replace(model, unknowns=widened(declared, x))
        converged = minimum.converged or minimum.stuck
        if converged and _settled(before, discrepancy):
            break
    equations = pose_equations(model, x, discrepancy, robust)
    covariance = inverse(equations.normal)
    return PoseFit(
        model=model,
        equations=equations,
        discrepancy=discrepancy,
        covariance=covariance,
        iterations=iterations,
        converged=converged,
    )


def fit_unweighted(model: PoseModel, x: Array, discrepancy: Discrepancy) -> PoseEquations:
    """Normal equations at the minimum from x (P,), every pose in full, the discrepancy given."""
    robust = tuple(np.ones(group.size) for group in model.table.groups)
    problem = _Problem(model, x, discrepancy, robust)
    return minimise(problem, Stop(decrease=NEGLIGIBLE), max_iterations=15).equations


def pose_equations(
    model: PoseModel, x: Array, discrepancy: Discrepancy, robust: Sequence[Array]
) -> PoseEquations:
    """Normal equations at x (P,); robust : (N,) square root of the weight of each group's poses."""
    points = model.evaluate(x)
    weights = tuple(model.weights(point, discrepancy) for point in points)
    triples = tuple(zip(points, weights, robust, strict=True))
    residuals = tuple(w(p.closure.error) * r for p, w, r in triples)
    jacobians = tuple(model.jacobian(x, p, w) * r for p, w, r in triples)
    layout = model.unknowns
    normal, gradient = np.diag(layout.sigma**-2.0), (x - layout.mean) / layout.sigma**2
    for jacobian, residual in zip(jacobians, residuals, strict=True):
        flat = jacobian.reshape(layout.count, -1)
        normal += flat @ flat.T
        gradient += flat @ residual.reshape(-1)
    cost = _prior_cost(model, x) + sum(float((r * r).sum()) for r in residuals)
    for distance in model.table.distances:
        row, value, _ = _distance_row(model, x, distance)
        normal += np.outer(row, row)
        gradient += row * value
    return PoseEquations(
        x=x,
        points=points,
        weights=weights,
        robust=tuple(robust),
        residuals=residuals,
        jacobians=jacobians,
        normal=normal,
        gradient=gradient,
        cost=cost,
    )


def robust_weights(equations: PoseEquations) -> tuple[Array, ...]:
    """(N,) square root of Huber's weight of each group's poses, by the scale of all residuals."""
    lengths = whitened_lengths(equations)
    scale = max(1.0, median_scale(lengths))
    return tuple(
        np.sqrt(np.minimum(1.0, HUBER * scale / np.maximum(v, 1e-9))) * (v < GROSS * scale)
        for v in lengths
    )


def whitened_lengths(equations: PoseEquations) -> list[Array]:
    """(N,) root mean square of each pose's whitened residual, robust weights left out."""
    return [
        np.sqrt((weights(point.closure.error) ** 2).sum(axis=0) / len(weights.matrix))
        for point, weights in zip(equations.points, equations.weights, strict=True)
    ]


def median_scale(lengths: Sequence[Array]) -> float:
    """Scale of whitened lengths that a few wrong poses do not move: 1 for white noise."""
    return float(np.median(np.concatenate(lengths))) / MEDIAN


def widened(declared: PoseUnknowns, x: Array) -> PoseUnknowns:
    """The unknowns with the priors of parameters and coefficients in Student's distribution."""
    sigma, part = declared.sigma.copy(), declared.machine
    far = (x[part] - declared.mean[part]) / sigma[part]
    sigma[part] *= np.sqrt(np.maximum(1.0, (TAILS + far**2) / (TAILS + 1.0)))
    return replace(declared, sigma=sigma)


def unexplained(model: PoseModel, equations: PoseEquations) -> Discrepancy:
    """Position and rotation variance of the residual beyond what the sensors explain."""
    determined = float(
        model.unknowns.count
        - np.trace(inverse(equations.normal) / model.unknowns.sigma[:, None] ** 2)
    )
    spare = max(0.05, 1.0 - determined / equations.equations)
    position = rotation = 0.0
    count = turns = 0.0
    for point, weights, robust in zip(
        equations.points, equations.weights, equations.robust, strict=True
    ):
        weight = robust**2
        rows = len(weights.matrix)
        whole = point.group.measured == "pose"
        square = point.closure.error**2
        noise = (model.noise_columns(point) ** 2).sum(axis=0)  # (6, N)
        axes = min(3, rows)
        sensed = noise[:3].sum(axis=0)
        position += float((weight * (square[:3].sum(axis=0) / spare - sensed)).sum())
        count += axes * float(weight.sum())
        if whole:
            turned = square[3:].sum(axis=0) / spare - noise[3:].sum(axis=0)
            rotation += float((weight * turned).sum())
            turns += 3.0 * float(weight.sum())
    return Discrepancy(
        float(np.sqrt(max(position / count, LEAST.position**2))),
        float(np.sqrt(max(rotation / turns, LEAST.rotation**2))) if turns else 0.0,
    )


def _settled(before: Discrepancy, after: Discrepancy) -> bool:
    return abs(after.position - before.position) <= SETTLED * before.position and (
        abs(after.rotation - before.rotation) <= SETTLED * before.rotation
    )


def _distance_row(model: PoseModel, x: Array, known: KnownDistance) -> tuple[Array, float, float]:
    """Derivative (P,) and value of a known distance's residual, in its standard deviations."""
    layout, row = model.unknowns, np.zeros(model.unknowns.count)
    first, second = (layout.seat(x, seat).origin for seat in known.seats)
    apart = second - first
    length = float(np.linalg.norm(apart))
    row[layout.seats[known.seats[0]].start :][:3] = -apart / length / known.sigma
    row[layout.seats[known.seats[1]].start :][:3] = apart / length / known.sigma
    return row, (length - known.length) / known.sigma, length


def _prior_cost(model: PoseModel, x: Array) -> float:
    """Cost of the priors and of the known distances."""
    layout = model.unknowns
    cost = float((((x - layout.mean) / layout.sigma) ** 2).sum())
    for distance in model.table.distances:
        cost += _distance_row(model, x, distance)[1] ** 2
    return cost
