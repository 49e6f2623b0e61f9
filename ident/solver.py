"""Levenberg-Marquardt on the whitened normal equations, in effect Gauss-Newton.

Columns are scaled to unit norm and the damping starts at rounding level, so the first steps are full Gauss-Newton steps and
the damping grows only when one does not lower the cost. Weights and null space are frozen within an iteration, so a trial
step is judged by the cost it was made for. Stops when the *undamped* step predicts a negligible decrease: the damped one
is small after rejections whether or not the minimum is near.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from cell.chain import Array
from ident.problem import Estimate, Linearisation, Problem, cost_at, linearise, stepped

DAMPING_START = 1e-12
DAMPING_MAX = 1e6
MAX_ITERATIONS = 50


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
) -> Fit:
    """Minimise the whitened loop closure over geometry parameters and clock.

    negligible : predicted decrease of the cost, in units of the cost per degree of freedom, that ends the search;
        1e-4 leaves the estimate a hundredth of its standard deviation from the minimum.
    """
    belief = prior or Prior(start.geometry.values[parameters], np.full(parameters.size, np.inf))
    damping = DAMPING_START
    now = linearise(problem, start, parameters)
    converged = False
    iterations = 0
    while True:
        normal, gradient = _normal_equations(now, belief, parameters)
        step, decrease = _step(normal, gradient, DAMPING_START)
        unit = max(1.0, now.cost / max(1, now.residual.size - step.size))
        converged = bool(decrease < negligible * unit)
        if converged or iterations == max_iterations:
            break
        iterations += 1
        accepted, damping = _accepted_step(problem, now, belief, parameters, damping, normal, gradient)
        if accepted is None:
            break
        now = linearise(problem, accepted, parameters)
    covariance = _inverse(normal)
    return Fit(parameters, now, covariance, _prior_cost(now.estimate, belief, parameters), iterations, converged)


def _normal_equations(now: Linearisation, prior: Prior, parameters: NDArray[np.intp]) -> tuple[Array, Array]:
    normal = now.jacobian @ now.jacobian.T
    gradient = now.jacobian @ now.residual
    weight = 1.0 / prior.sigma**2
    k = parameters.size
    normal[np.arange(k), np.arange(k)] += weight
    gradient[:k] += weight * (now.estimate.geometry.values[parameters] - prior.mean)
    return normal, gradient


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
    gradient: Array,
) -> tuple[Estimate | None, float]:
    cost = now.cost + _prior_cost(now.estimate, prior, parameters)
    while damping <= DAMPING_MAX:
        step, _ = _step(normal, gradient, damping)
        trial = stepped(now.estimate, parameters, step, has_clock=problem.has_clock)
        if cost_at(problem, trial, now.weights) + _prior_cost(trial, prior, parameters) < cost:
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
