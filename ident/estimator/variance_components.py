"""Variance components of the loop-closure error, by maximum likelihood.

Each component's variance is what makes the residuals most likely, given that the fit has absorbed
its share of the degrees of freedom (residuals are scaled up for it). Unmeasured joints have
unlimited variance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from cell.arrays import Array
from ident.estimator.closure import rod_jacobian
from ident.estimator.fit import Fit
from ident.estimator.model import Evaluation, noise_columns
from ident.estimator.noise import ExcessNoise
from ident.estimator.whitening import cholesky, covariance, solve_lower

LOWEST, HIGHEST = 1e-8, 3e-3  # [rad, m] below every noise of the logs; above every model error
UNMEASURED_SIGMA = 1.0  # [rad] of a joint without encoder: a twelfth of all turns, no knowledge
ROD_SIGMA_RANGE = 1e-8, 1e-3  # [m] from nothing to a rod that is no constraint any more
_EVALUATIONS = 160  # of the simplex: four components to 5 % take about a hundred


def rod_deviation(fit: Fit) -> float:
    """[m] standard deviation of the rod's length that makes the residuals of a fit most likely.

    One unknown and a rank-one update of the covariance, so no matrix is inverted again. The fit is
    of one recording; its own excess noise of the rod is taken out.
    """
    (point,) = fit.linear.evaluations
    weights = fit.model.weights(fit.x, point, replace(fit.excess, rod=0.0))
    residual, rod = weights(point.closure.error), weights(rod_jacobian(point.closure))
    projection, weight = (rod * residual).sum(axis=0), (rod * rod).sum(axis=0)
    optimum = minimize_scalar(
        _rod_deviance,
        bounds=(2.0 * float(np.log(ROD_SIGMA_RANGE[0])), 2.0 * float(np.log(ROD_SIGMA_RANGE[1]))),
        args=(projection, weight),
        method="bounded",
        options={"xatol": 1e-3},
    )
    return float(np.exp(0.5 * optimum.x))


def _rod_deviance(log_variance: float, projection: Array, weight: Array) -> float:
    """-2 log likelihood, up to a constant, of a variance of the rod's length."""
    gain = np.exp(log_variance) * weight
    return float((np.log1p(gain) - np.exp(log_variance) * projection**2 / (1.0 + gain)).sum())


def excess_noise(fit: Fit) -> ExcessNoise:
    """The four variance components of the residuals of a fit."""
    data = sum(r.size for r in fit.linear.residuals)
    share = np.sqrt(data / max(1, fit.degrees))
    points = fit.linear.evaluations
    uncertain = [fit.model.backlash_uncertainty(fit.x, point) for point in points]

    def deviance(logs: Array) -> float:
        excess = _components(logs)
        return sum(
            _deviance(point, share, excess, u) for point, u in zip(points, uncertain, strict=True)
        )

    e = fit.excess
    start = np.log(np.clip([e.gear, e.wrist, e.bar, e.rod], 1e-6, HIGHEST))
    simplex = np.vstack((start, start + 1.5 * np.eye(4)))
    optimum = minimize(
        deviance,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.5, "maxfev": _EVALUATIONS},
    )
    return _components(optimum.x)


def _components(logs: Array) -> ExcessNoise:
    values = np.exp(np.clip(logs, np.log(LOWEST), np.log(HIGHEST)))
    return ExcessNoise(*(float(v) for v in values))


def _deviance(
    point: Evaluation, share: float, excess: ExcessNoise, uncertain: Array | float
) -> float:
    """-2 log likelihood of one recording's loop-closure error times `share`."""
    spread = covariance(noise_columns(point, excess, uncertain))
    for column in point.unmeasured_columns * UNMEASURED_SIGMA:
        spread += column[:, None] * column[None]
    factor = cholesky(spread)
    white = solve_lower(factor, point.closure.error * share)
    return float((white * white).sum() + 2.0 * sum(np.log(factor[i, i]).sum() for i in range(6)))
