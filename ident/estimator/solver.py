"""Levenberg-Marquardt on the whitened normal equations, in effect Gauss-Newton.

Columns are scaled to unit norm and the damping starts at rounding level, so the first steps are full Gauss-Newton steps and
the damping grows only when one does not lower the cost. Weights and null space are frozen within an iteration, so a trial
step is judged by the cost it was made for. Stops when the *undamped* step predicts a negligible decrease: the damped one
is small after rejections whether or not the minimum is near. Many samples are preceded by a fit of a few of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from cell.chain import Array
from ident.estimator.iteration import Iteration, IterationCallback
from ident.estimator.problem import Estimate, Linearisation, Problem, linearise, moved, stepped

DAMPING_START = 1e-12
DAMPING_MAX = 1e6
MAX_ITERATIONS = 50
NEAR = 25.0  # five standard deviations each: the Jacobian at either end of such a step gives the same covariance
QUICK = 1e-2  # of the predicted decrease: a step that leaves less of it needs no new Jacobian for the next
COARSE_SAMPLES, COARSE_SHARE = (
    150,
    4,
)  # a fit of so many samples comes first, where there are so many times more


@dataclass(frozen=True, eq=False)
class Prior:
    """Gaussian knowledge of geometry parameters; infinite sigma means none."""

    mean: Array  # (P,) [m, rad]
    sigma: Array  # (P,) [m, rad]


@dataclass(frozen=True, eq=False)
class Fit:
    """The outcome of one minimisation."""

    parameters: NDArray[np.intp]  # (P,) indices into PARAMETERS
    final: Linearisation
    covariance: Array  # (P [+ 2], P [+ 2]) of the parameters, then offset and skew
    prior_cost: float
    iterations: int
    converged: bool

    @property
    def estimate(self) -> Estimate:
        return self.final.estimate

    @property
    def cost(self) -> float:
        """Chi-square of the data plus that of the prior."""
        return self.final.cost + self.prior_cost

    @property
    def dof(self) -> int:
        return int(self.final.residual.size - len(self.covariance))

    @property
    def chi2_per_dof(self) -> float:
        return self.final.cost / max(1, self.dof)


def solve(
    problem: Problem,
    start: Estimate,
    parameters: NDArray[np.intp],
    *,
    prior: Prior | None = None,
    negligible: float = 1e-4,
    max_iterations: int = MAX_ITERATIONS,
    on_iteration: IterationCallback | None = None,
) -> Fit:
    """Minimise the whitened loop closure over geometry parameters and clock.

    negligible : predicted decrease of the cost, in units of the cost per degree of freedom, that ends the search;
        1e-4 leaves the estimate a hundredth of its standard deviation from the minimum.
    on_iteration : is told of the start and of each iteration.
    """
    belief = prior or Prior(start.geometry.values[parameters], np.full(parameters.size, np.inf))
    coarse = 0
    if (thin := problem.times.size // COARSE_SAMPLES) >= COARSE_SHARE:
        near = _minimise(
            problem.thinned(thin),
            replace(start, bar=start.bar[::thin]),
            parameters,
            belief,
            1.0,
            max_iterations,
            np.inf,
            on_iteration,
        )
        if near.converged:
            start, coarse = (
                problem.start(near.estimate.geometry, near.estimate.clock),
                near.iterations,
            )
    fit = _minimise(
        problem, start, parameters, belief, negligible, max_iterations, NEAR, on_iteration
    )
    return replace(fit, iterations=fit.iterations + coarse)


def _minimise(
    problem: Problem,
    start: Estimate,
    parameters: NDArray[np.intp],
    belief: Prior,
    negligible: float,
    max_iterations: int,
    near: float,
    on_iteration: IterationCallback | None,
) -> Fit:
    """As `solve`; near : predicted decrease for each unknown below which a Jacobian holds as far as its step goes."""
    damping, iterations = DAMPING_START, 0
    now = linearise(problem, start, parameters)
    normal = _normal(now, belief)
    first = ahead = _predicted_decrease(now, normal, belief, parameters)
    while True:
        if on_iteration:
            on_iteration(_iteration(problem, now))
        unit = max(1.0, now.cost / max(1, now.residual.size - len(normal)))
        converged = ahead < negligible * unit
        if converged or iterations == max_iterations:
            break
        accepted, damping = _accepted_step(problem, now, belief, parameters, damping, normal)
        if accepted is None:
            break
        iterations += 1
        now, before, ahead = (
            accepted,
            ahead,
            _predicted_decrease(accepted, normal, belief, parameters),
        )
        if first > near * len(normal) * unit or ahead > max(negligible * unit, QUICK * before):
            now = linearise(problem, now.estimate, parameters)
            normal = _normal(now, belief)
            first = ahead = _predicted_decrease(now, normal, belief, parameters)
    return Fit(
        parameters,
        now,
        _inverse(normal),
        _prior_cost(now.estimate, belief, parameters),
        iterations,
        converged,
    )


def _iteration(problem: Problem, now: Linearisation) -> Iteration:
    here = now.estimate
    return Iteration(
        here.geometry,
        here.clock,
        problem.times,
        now.closure.error,
        now.cost / max(1, now.residual.size),
    )


def _predicted_decrease(
    now: Linearisation, normal: Array, belief: Prior, parameters: NDArray[np.intp]
) -> float:
    """What an undamped step would gain."""
    _, decrease = _step(normal, _gradient(now, belief, parameters), DAMPING_START)
    return decrease


def _normal(now: Linearisation, prior: Prior) -> Array:
    normal, k = now.jacobian @ now.jacobian.T, prior.sigma.size
    normal[np.arange(k), np.arange(k)] += prior.sigma**-2.0
    return normal


def _gradient(now: Linearisation, prior: Prior, parameters: NDArray[np.intp]) -> Array:
    gradient = now.jacobian @ now.residual
    gradient[: parameters.size] += (
        now.estimate.geometry.values[parameters] - prior.mean
    ) / prior.sigma**2
    return gradient


def _step(normal: Array, gradient: Array, damping: float) -> tuple[Array, float]:
    scale = _scale(normal)
    scaled = normal * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += damping
    step = -scale * cho_solve(cho_factor(scaled), scale * gradient)
    return step, float(-(gradient @ step))


def _accepted_step(
    problem: Problem,
    now: Linearisation,
    prior: Prior,
    parameters: NDArray[np.intp],
    damping: float,
    normal: Array,
) -> tuple[Linearisation | None, float]:
    """Where a step leads that lowers the cost, seen with the present Jacobian; and the damping for the next."""
    gradient = _gradient(now, prior, parameters)
    cost = now.cost + _prior_cost(now.estimate, prior, parameters)
    while damping <= DAMPING_MAX:
        step, _ = _step(normal, gradient, damping)
        trial = moved(
            problem, stepped(now.estimate, parameters, step, has_clock=problem.has_clock), now
        )
        if trial.cost + _prior_cost(trial.estimate, prior, parameters) < cost:
            return trial, max(DAMPING_START, damping * 0.01)
        damping = max(1e-6, damping * 10.0)
    return None, damping


def _prior_cost(estimate: Estimate, prior: Prior, parameters: NDArray[np.intp]) -> float:
    deviation = (estimate.geometry.values[parameters] - prior.mean) / prior.sigma
    return float(deviation @ deviation)


def _scale(normal: Array) -> Array:
    return 1.0 / np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))


def _inverse(normal: Array) -> Array:
    scale = _scale(normal)
    scaled = normal * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += DAMPING_START
    inverse = cho_solve(cho_factor(scaled), np.eye(scaled.shape[0]))
    return np.asarray(inverse * np.outer(scale, scale))
