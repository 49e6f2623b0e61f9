"""Noise levels from the logs themselves, and how much the rod gives way from the residuals.

Encoder and robot noise come from the smoothing residual of each log (ident.signals.smooth_log). The rod's deviation from a constant
length cannot be seen in either log: it is the variance component along the rod that the whitened residual asks for, by
maximum likelihood (one unknown; rank-one update of the covariance, so no matrix is inverted again).
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar

from cell.chain import Array
from cell.geometry import BAR_ROWS
from ident.estimator.closure import rod_jacobian
from ident.estimator.problem import Estimate, NoiseModel, Problem
from ident.signals.smooth_log import SmoothLog

ROD_SIGMA_RANGE = (1e-8, 1e-3)  # [m] from nothing to a rod that is no constraint any more


def row_noise(
    robot: SmoothLog, bar: SmoothLog | None, joints: tuple[int, ...], *, rod: float
) -> NoiseModel:
    """Noise of one row of each log, with a given rod deviation [m]."""
    return NoiseModel(robot.noise, _per_joint(bar.noise if bar else None, joints), rod)


def noise_from_logs(
    robot: SmoothLog, bar: SmoothLog | None, joints: tuple[int, ...], *, spacing: float, rod: float
) -> NoiseModel:
    """Noise of samples `spacing` [s] apart, with a given rod deviation [m]."""
    return NoiseModel(
        robot.sample_sigma(spacing),
        _per_joint(bar.sample_sigma(spacing) if bar else None, joints),
        rod,
    )


def _per_joint(fitted: Array | None, joints: tuple[int, ...]) -> Array:
    encoder = np.zeros(BAR_ROWS)
    if fitted is not None:
        encoder[[j - 1 for j in joints]] = fitted
    return encoder


def rod_deviation(problem: Problem, estimate: Estimate) -> float:
    """[m] standard deviation of the rod length that makes the residuals most likely; `problem.noise.rod` must be 0."""
    closure = problem.closure(estimate)
    weights = problem.whitening(closure)
    residual, rod = weights(closure.error), weights(rod_jacobian(closure))
    projection, weight = (rod * residual).sum(axis=0), (rod * rod).sum(axis=0)
    low, high = (2.0 * float(np.log(s)) for s in ROD_SIGMA_RANGE)
    found = minimize_scalar(
        _deviance,
        bounds=(low, high),
        args=(projection, weight),
        method="bounded",
        options={"xatol": 1e-3},
    )
    return float(np.exp(0.5 * found.x))


def _deviance(log_variance: float, projection: Array, weight: Array) -> float:
    """-2 log likelihood, up to a constant, of a rod variance."""
    gain = np.exp(log_variance) * weight
    return float((np.log1p(gain) - np.exp(log_variance) * projection**2 / (1.0 + gain)).sum())
