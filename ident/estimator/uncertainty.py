"""Autocorrelation-robust (jackknife) covariance, observability and correlation of a fit.

Were the residuals white, the normal equations would give the variance; where they are
autocorrelated, the estimates without each block of a few seconds do (blocks instead of lags, as for
Newey & West 1987; left out, so that the residual of what only a block tells is not fitted away).
The ratio inflates each unknown's standard deviation, so the correlations stay those of the normal
equations, which some tens of blocks could not give for a hundred unknowns. What the prior
contributes is not inflated, unless the lengths that are known beforehand contradict each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from ident.estimator.considered import considered_shifts
from ident.estimator.fit import Fit
from ident.estimator.known_lengths import KnownLengths, known_lengths
from ident.estimator.time_blocks import BLOCK, each_block

STRONG = 0.9  # correlation from which two unknowns are named together


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """How well the unknowns of a fit are known."""

    covariance: Array  # (P, P) what is considered included
    white: Array  # (P, P) part that the data would leave were their residuals white
    widened: Array  # (P, P) part by which it is more, as they are not
    considered: Array  # (P, K) shifts of the estimate for a deviation of each direction of masses
    inflation: Array  # (P,) factor on each standard deviation over that of white residuals
    information_gain: Array  # (P,) 1 - (posterior sigma / prior sigma)^2: 0 prior alone, 1 data
    autocorrelation: float  # of neighbours in the whitened residual
    blocks: int  # of time, that the inflation comes from
    lengths: KnownLengths


def uncertainty(fit: Fit, deviated: Sequence[Cell] = ()) -> Uncertainty:
    """Autocorrelation-robust covariance of a fit, misfit included.

    deviated : cells with masses beside those that the fit took as given, as in
        ident.estimator.considered.
    """
    layout, misfit = fit.model.unknowns, max(1.0, fit.chi2_per_dof)
    sigma = layout.sigma
    prior = fit.covariance @ (fit.covariance / sigma[:, None] ** 2)
    data = fit.covariance - prior
    variance, blocks = _left_out(fit)
    white = misfit * np.maximum(np.diag(data), np.finfo(float).tiny)
    inflation = np.sqrt(np.maximum(1.0, variance / white))
    inflated = misfit * data * np.outer(inflation, inflation)
    covariance = inflated + prior
    lengths = known_lengths(layout, fit.x, fit.covariance, inflated - data)
    doubted = fit.covariance[:, lengths.unknowns] / sigma[lengths.unknowns]
    covariance += (lengths.widening**2 - 1.0) * doubted @ doubted.T
    shifts = considered_shifts(fit, deviated)
    covariance += shifts @ shifts.T
    gain = 1.0 - np.clip(np.diag(fit.covariance) / sigma**2, 0.0, 1.0)
    return Uncertainty(
        covariance=0.5 * (covariance + covariance.T),
        white=data,
        widened=inflated - data,
        considered=shifts,
        inflation=inflation,
        information_gain=gain,
        autocorrelation=mean_autocorrelation(fit),
        blocks=blocks,
        lengths=lengths,
    )


def inflation_factors(covariance: Array, power: Array, sums: Array) -> Array:
    """(P,) at least 1: standard deviation from blocks of time over that of independent samples.

    covariance : (P, P) of white residuals. power : (P, P) products of the scores, summed over the
    samples. sums : (P, B) scores summed over blocks of time.
    """
    white = np.einsum("ij,jk,ik->i", covariance, power, covariance, optimize=True)
    blocked = ((covariance @ sums) ** 2).sum(axis=1)
    ratio = blocked / np.where(white > 0.0, white, 1.0)
    return np.asarray(np.sqrt(np.maximum(1.0, ratio)))


def _left_out(fit: Fit) -> tuple[Array, int]:
    """(P,) variance by leaving out each block of time in turn, and how many blocks there are.

    The jackknife: `(B - 1) / B` times the sum of squares over B blocks (Efron & Stein 1981).
    Without a block of normal matrix N and gradient g the estimate moves by `(H - N)^-1 g`, so what
    single blocks hold alone counts for what it is.
    """
    variance, count = np.zeros(fit.model.unknowns.count), 0
    for block in each_block(fit, BLOCK):
        own = np.flatnonzero(np.diag(block.normal))
        normal, covariance = block.normal[np.ix_(own, own)], fit.covariance[:, own]
        without = np.eye(own.size) - normal @ covariance[own]
        moved = covariance @ np.linalg.solve(without, block.gradient[own])
        variance += moved**2
        count += 1
    return variance * (count - 1) / count, count


def mean_autocorrelation(fit: Fit) -> float:
    """Mean autocorrelation of neighbours in the whitened residuals of a fit's recordings."""
    each = [
        autocorrelation(residual, point.recording.times, point.recording.smoothing)
        for point, _, residual in fit.recorded
    ]
    return float(np.mean(each))


def autocorrelation(residual: Array, times: Array, smoothing: float) -> float:
    """Mean over the equations of a residual's (E, N) correlation with its neighbour in time.

    times : (N,) [s]. smoothing : [s] over which the logs were smoothed; samples closer than that
    share noise, so the neighbour is the sample about as far away.
    """
    lag = max(1, round(smoothing / float(np.median(np.diff(times)))))
    products = (residual[:, lag:] * residual[:, :-lag]).sum(axis=1)
    return float((products / (residual * residual).sum(axis=1)).mean())


def correlated_groups(covariance: Array, names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Groups of unknowns that the data hardly separate: chains of correlations above STRONG.

    covariance : (P, P) of the unknowns `names` [m, rad, s and their products].
    """
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


def observability(normal: Array, sigma: Array, selected: Array, samples: int) -> dict[str, float]:
    """Observability indices O1 to O5 of some unknowns (Sun & Hollerbach 2008).

    normal : (P, P) of the data and the prior. sigma : (P,) prior deviations, the units of the
    unknowns. selected : (S,) indices of the unknowns; all others count as unknown. samples : how
    many went into the normal matrix.
    """
    scaled = normal * np.outer(sigma, sigma)
    others = np.setdiff1d(np.arange(sigma.size), selected)
    own = scaled[np.ix_(selected, selected)]
    if others.size:
        mixed = scaled[np.ix_(selected, others)]
        own = own - mixed @ np.linalg.solve(scaled[np.ix_(others, others)], mixed.T)
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(own), np.finfo(float).tiny))
    return {
        "O1": float(np.exp(np.log(values).mean()) / np.sqrt(samples)),
        "O2": float(values[0] / values[-1]),
        "O3": float(values[0]),
        "O4": float(values[0] ** 2 / values[-1]),
        "O5": float(1.0 / (1.0 / values).sum()),
    }
