"""Noise that the logs do not show row by row, from the residual: variance components by maximum likelihood.

Sub-divisional error repeats ten times a degree and passes for encoder noise; what the model of gears and rod leaves over
passes for noise of its carrier. Each component's variance is what makes the residuals most likely, given that the fit has
eaten its share of degrees of freedom (residuals are scaled up for it). Joints without encoder have unlimited variance.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from cell.chain import Array
from ident.corrections.base import BAR, ROD
from ident.estimator.closure import cholesky, solve_lower
from ident.estimator.joint_fit import (
    ExcessNoise,
    JointFit,
    Model,
    backlash_uncertainty,
    covariances,
)

LOWEST = 1e-8  # [rad, m] below every noise of the logs
HIGHEST = 3e-3
FREE = 1.0  # [rad] of a joint without encoder


def estimate_excess(fit: JointFit) -> ExcessNoise:
    """The four components of the residuals of a fit."""
    model = fit.model
    data = sum(r.size for r in fit.linear.residuals)
    share = np.sqrt(data / max(1, fit.degrees))
    errors = [p.closure.error * share for p in fit.linear.points]
    uncertain = [backlash_uncertainty(model, fit.x, p) for p in fit.linear.points]

    def deviance(logs: Array) -> float:
        excess = _excess(logs)
        return sum(
            _deviance(model, fit, k, errors[k], uncertain[k], excess) for k in range(len(errors))
        )

    start = np.log(
        np.clip([fit.excess.gear, fit.excess.wrist, fit.excess.bar, fit.excess.rod], 1e-6, HIGHEST)
    )
    simplex = np.vstack((start, start + 1.5 * np.eye(4)))
    found = minimize(
        deviance,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.5, "maxfev": 160},
    )
    return _excess(found.x)


def _excess(logs: Array) -> ExcessNoise:
    values = np.exp(np.clip(logs, np.log(LOWEST), np.log(HIGHEST)))
    return ExcessNoise(*(float(v) for v in values))


def _deviance(
    model: Model, fit: JointFit, k: int, error: Array, uncertain: Array | float, excess: ExcessNoise
) -> float:
    """-2 log likelihood of one recording's mismatch."""
    track, columns = model.tracks[k], fit.linear.points[k].columns
    spread = covariances(track, columns, excess, uncertain)
    for j in track.free:
        column = columns[BAR:ROD][j] * FREE
        spread += column[:, None] * column[None]
    factor = cholesky(spread)
    white = solve_lower(factor, error)
    return float((white * white).sum() + 2.0 * sum(np.log(factor[i, i]).sum() for i in range(6)))
