"""How far to trust a joint fit: covariance that stays honest when residuals are alike in time, observability, correlation.

The influence of one sample on the estimate is `H^-1 J_t' r_t`. Were the residuals white, their squares would add up to the
variance; where they are not, sums over blocks of a few seconds do (block sandwich; Newey & West 1987 for the idea, blocks
instead of lags). The ratio widens each unknown's deviation, so the correlations stay those of the normal equations, which a
sandwich of some tens of blocks could not give for a hundred unknowns. What the prior contributes is not widened.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.chain import Array
from ident.joint_fit import JointFit, Linear, Model, jacobian

BLOCK = 3.0  # [s] longer than residuals remember: the path's own motion and the knots of the tension
STRONG = 0.9  # correlation from which two unknowns are named together


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Of all unknowns of a fit."""

    covariance: Array  # (P, P)
    widening: Array  # (P,) factor on each standard deviation over that of white residuals
    told_by_data: Array  # (P,) share of the knowledge that is the data's, 0 to 1; the rest is the prior's
    autocorrelation: float  # of the whitened residual, one sample apart


def uncertainty(fit: JointFit) -> Uncertainty:
    """Honest covariance of a fit."""
    model, sigma = fit.model, fit.model.unknowns.sigma
    influence = [fit.covariance @ score for score in _scores(fit)]
    inflation = max(1.0, fit.chi2_per_dof)
    widening = block_widening(np.concatenate(influence, axis=1), np.concatenate([_after(k, t.times) for k, t in enumerate(model.tracks)]))
    prior = fit.covariance @ (fit.covariance / sigma[:, None] ** 2)
    data = fit.covariance - prior
    covariance = inflation * data * np.outer(widening, widening) + prior
    share = 1.0 - np.clip(np.diag(fit.covariance) / sigma**2, 0.0, 1.0)
    return Uncertainty(0.5 * (covariance + covariance.T), widening, share, autocorrelation(fit.linear))


def block_widening(influence: Array, times: Array) -> Array:
    """(P,) at least 1: deviation from sums over blocks of time over that of independent samples.

    influence : (P, N) of each sample on each unknown; times : (N,) [s], increasing.
    """
    white = (influence * influence).sum(axis=1)
    blocked = (_block_sums(influence, times) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(1.0, blocked / np.where(white > 0.0, white, 1.0))))


def _after(recording: int, times: Array) -> Array:
    """Times of one recording, moved so that no block spans two."""
    return np.asarray(times - times[0] + recording * 1e6 * BLOCK)


def _scores(fit: JointFit) -> list[Array]:
    """(P, N) gradient of half the cost that each sample of each recording contributes."""
    model, layout = fit.model, fit.model.unknowns
    out = []
    for k, (point, weights, residual) in enumerate(zip(fit.linear.points, fit.linear.weights, fit.linear.residuals, strict=True)):
        index, columns, slope = jacobian(model, fit.x, k, point, weights)
        score = np.zeros((layout.count, residual.shape[1]))
        score[index] = (columns * residual).sum(axis=1)
        knots = layout.own[k].knots
        if slope is not None and knots is not None:
            score[knots] = model.tracks[k].knots * (slope * residual).sum(axis=0)
        out.append(score)
    return out


def _block_sums(influence: Array, times: Array) -> Array:
    """(P, B) sums over blocks of time."""
    edges = np.flatnonzero(np.diff(np.floor((times - times[0]) / BLOCK)) > 0) + 1
    return np.asarray(np.add.reduceat(influence, np.concatenate(([0], edges)), axis=1))


def autocorrelation(linear: Linear) -> float:
    """Mean over equations and recordings of the whitened residual's correlation one sample apart."""
    pairs = [((r[:, 1:] * r[:, :-1]).sum(axis=1) / (r * r).sum(axis=1)).mean() for r in linear.residuals]
    return float(np.mean(pairs))


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
