"""Covariance of a fit of poses that err together with their neighbours, by blocks of them."""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.observations import FollowedPoses
from ballbar.ident.estimator.regions import pose_regions
from ballbar.ident.estimator.uncertainty import (
    correlation_time,
    inflation_factors,
    variance_by_blocks,
)

BLOCKS = 32  # regions whose poses share what the model leaves over
CORRELATION_TIMES = 10.0  # of a block of time: its edges are a small part of it
FEWEST_BLOCKS, MOST_BLOCKS = 5, 200  # of time, in one log


def robust_covariance(fit: Fit) -> Array:
    """(P, P) covariance of the unknowns where neighbouring poses share what the model leaves over.

    Sums of the scores over blocks (sandwich form: White 1982), which are regions of joint space;
    of the variance that they show the deviation by chance of so many blocks is not counted. A
    region that is visited early and late averages over what a clock is seen by: for the clocks of
    what followed a moving robot the estimates without each block of time count too, as the few
    blocks that they are (variance of Student's distribution).
    """
    equations, layout = fit.linear, fit.model.unknowns
    blocks = pose_regions(fit.model.poses, BLOCKS)
    scores = np.concatenate(
        [
            np.einsum("pen,en->pn", jacobian, residual)
            for jacobian, residual in zip(fit.jacobians, equations.residuals, strict=True)
        ],
        axis=1,
    )
    sums = np.zeros((layout.count, blocks.max() + 1))
    np.add.at(sums.T, blocks, scores.T)
    inflation = inflation_factors(fit.covariance, scores @ scores.T, sums)
    chance = np.sqrt(2.0 / sums.shape[1])
    inflation = np.sqrt(np.maximum(1.0, inflation**2 - chance))
    prior = fit.covariance @ (fit.covariance / layout.sigma[:, None] ** 2)
    data = fit.covariance - prior
    inflation = np.maximum(inflation, _inflation_in_time(fit, np.diag(data)))
    robust = data * np.outer(inflation, inflation) + prior
    return np.asarray(0.5 * (robust + robust.T))


def _inflation_in_time(fit: Fit, white: Array) -> Array:
    """(P,) deviation of clocks by blocks of time over that of independent rows; 0 of all else.

    white : (P,) variances of independent rows, without what the priors tell.
    """
    block, out = 0.0, np.zeros(white.size)
    for part, residual in zip(fit.model.parts, fit.linear.residuals, strict=True):
        if isinstance(part, FollowedPoses) and part.size > 1:
            span = float(np.ptp(part.times))
            time = CORRELATION_TIMES * correlation_time(residual, part.times)
            block = max(block, float(np.clip(time, span / MOST_BLOCKS, span / FEWEST_BLOCKS)))
    if not block:
        return out
    variance, count = variance_by_blocks(fit, block)
    variance *= (count - 1.0) / max(1.0, count - 3.0)
    for clock in fit.model.unknowns.placed.clocks.values():
        out[clock] = np.sqrt(variance[clock] / np.maximum(white[clock], 1e-300))
    return out
