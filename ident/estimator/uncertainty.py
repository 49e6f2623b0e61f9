"""How far to trust a joint fit: covariance that stays honest when residuals are alike in time, observability, correlation.

The influence of one sample on the estimate is `H^-1 J_t' r_t`. Were the residuals white, their squares would add up to the
variance; where they are not, sums over blocks of a few seconds do (block sandwich; Newey & West 1987 for the idea, blocks
instead of lags). The ratio widens each unknown's deviation, so the correlations stay those of the normal equations, which a
sandwich of some tens of blocks could not give for a hundred unknowns. What the prior contributes is not widened.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.chain import Array
from ident.estimator.joint_fit import JointFit, Model, jacobian

BLOCK = (
    3.0  # [s] longer than residuals remember: the path's own motion and the knots of the tension
)
STRONG = 0.9  # correlation from which two unknowns are named together


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Of all unknowns of a fit."""

    covariance: Array  # (P, P)
    widening: Array  # (P,) factor on each standard deviation over that of white residuals
    information_gain: (
        Array  # (P,) share of the knowledge that is the data's, 0 to 1; the rest is the prior's
    )
    autocorrelation: float  # of neighbours in the whitened residual


def uncertainty(fit: JointFit) -> Uncertainty:
    """Honest covariance of a fit."""
    sigma, inflation = fit.model.unknowns.sigma, max(1.0, fit.chi2_per_dof)
    power, sums = _scores(fit)
    widening = _widening(fit.covariance, power, sums)
    prior = fit.covariance @ (fit.covariance / sigma[:, None] ** 2)
    data = fit.covariance - prior
    covariance = inflation * data * np.outer(widening, widening) + prior
    share = 1.0 - np.clip(np.diag(fit.covariance) / sigma**2, 0.0, 1.0)
    alike = [
        autocorrelation(r, t.times, t.smoothing)
        for r, t in zip(fit.linear.residuals, fit.model.tracks, strict=True)
    ]
    return Uncertainty(0.5 * (covariance + covariance.T), widening, share, float(np.mean(alike)))


def block_widening(covariance: Array, scores: Array, times: Array) -> Array:
    """(P,) at least 1: deviation from sums over blocks of time over that of independent samples.

    covariance : (P, P). scores : (P, N) gradient of half the cost that each sample contributes; times : (N,) [s], increasing.
    """
    block = _block_of(times)
    sums = np.zeros((len(scores), block[-1] + 1))
    np.add.at(sums.T, block, scores.T)
    return _widening(covariance, scores @ scores.T, sums)


def _widening(covariance: Array, power: Array, sums: Array) -> Array:
    """(P,) from the scores' products (P, P), summed over the samples, and their sums (P, B) over blocks."""
    white = np.einsum("ij,jk,ik->i", covariance, power, covariance, optimize=True)
    blocked = ((covariance @ sums) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(1.0, blocked / np.where(white > 0.0, white, 1.0))))


def _block_of(times: Array) -> NDArray[np.intp]:
    """(N,) number of each sample's block of time, from 0."""
    return np.cumsum(np.diff(np.floor((times - times[0]) / BLOCK), prepend=0.0) > 0)


def _scores(fit: JointFit) -> tuple[Array, Array]:
    """Products (P, P) of the scores, summed over all samples, and their sums (P, B) over blocks of time, none across recordings."""
    model, layout = fit.model, fit.model.unknowns
    power, sums = np.zeros((layout.count, layout.count)), []
    for k, (point, weights, residual) in enumerate(
        zip(fit.linear.points, fit.linear.weights, fit.linear.residuals, strict=True)
    ):
        where = _block_of(model.tracks[k].times)
        own = np.zeros((layout.count, where[-1] + 1))
        for block in jacobian(model, fit.x, k, point, weights):
            score = block.against(residual[:, block.samples], model, k)
            power += score @ score.T
            np.add.at(own.T, where[block.samples], score.T)
        sums.append(own)
    return power, np.concatenate(sums, axis=1)


def autocorrelation(residual: Array, times: Array, smoothing: float) -> float:
    """Mean over the equations of a residual's (M, N) correlation with its neighbour.

    times : (N,) [s]. smoothing : [s] over which the logs were smoothed; samples closer than that share noise, so the
    neighbour is the sample about as far away.
    """
    lag = max(1, round(smoothing / float(np.median(np.diff(times)))))
    return float(
        (
            (residual[:, lag:] * residual[:, :-lag]).sum(axis=1) / (residual * residual).sum(axis=1)
        ).mean()
    )


def correlated_groups(covariance: Array, names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Unknowns that the data tell apart badly: chains of correlations above STRONG."""
    deviation = np.sqrt(np.diag(covariance))
    strong = np.abs(covariance / np.outer(deviation, deviation)) > STRONG
    left, groups = set(range(len(names))), []
    while left:
        group, front = set(), {left.pop()}
        while front:
            group |= front
            front = {int(j) for i in front for j in np.flatnonzero(strong[i])} - group
        left -= group
        if len(group) > 1:
            groups.append(tuple(names[i] for i in sorted(group)))
    return sorted(groups)


def observability(model: Model, normal: Array, chosen: Array) -> dict[str, float]:
    """Observability indices O1 to O5 of some unknowns, their prior deviations as units (Sun & Hollerbach 2008).

    normal : (P, P) of the data and the prior. chosen : indices of the unknowns; all others count as free.
    """
    sigma = model.unknowns.sigma
    scaled = normal * np.outer(sigma, sigma)
    others = np.setdiff1d(np.arange(sigma.size), chosen)
    kept = scaled[np.ix_(chosen, chosen)]
    if others.size:
        mixed = scaled[np.ix_(chosen, others)]
        kept = kept - mixed @ np.linalg.solve(scaled[np.ix_(others, others)], mixed.T)
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(kept), np.finfo(float).tiny))
    samples = sum(t.times.size for t in model.tracks)
    return {
        "O1": float(np.exp(np.log(values).mean()) / np.sqrt(samples)),
        "O2": float(values[0] / values[-1]),
        "O3": float(values[0]),
        "O4": float(values[0] ** 2 / values[-1]),
        "O5": float(1.0 / (1.0 / values).sum()),
    }
