"""Common scale of the priors of a correction's coefficients, by its evidence.

A prior that fits the heaviest of machines is wide for most of them, and every coefficient that it
leaves open costs accuracy. Where all coefficients of a correction are small or large together,
their prior deviations are known to one common factor s, which the data tell: they give the
coefficients, in units of their priors, as x with information G, so that the marginal likelihood of
s is that of `x ~ N(0, G^-1 + s^2)` (empirical Bayes: Morris 1983; evidence: MacKay 1992). The prior
of s is even in its logarithm, from SCALES[0] to 1.

A fit has the root of the mean square of s. What the scale leaves open, the second moment of the
estimates at other scales about that of the fit, is stated in addition (law of total variance); the
variance at that root is not below the mean of the variances, which are concave in s^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.fit import Fit

SCALES = np.logspace(-2.0, 0.0, 25)


@dataclass(frozen=True, eq=False)
class CommonScale:
    """Scale of the prior deviations of K unknowns of a fit."""

    scale: float  # root of the mean square
    doubt: Array  # (P, P) second moment of the estimates at other scales about that estimate


def common_scale(fit: Fit, chosen: NDArray[np.intp], declared: Array) -> CommonScale:
    """The scale that the data tell of the priors of the unknowns `chosen` (K,).

    declared : (K,) their prior deviations, about zero. The priors of the fit may be wider.
    """
    covariance, x = fit.covariance[np.ix_(chosen, chosen)], fit.x[chosen]
    inverse = np.linalg.inv(covariance)
    data = inverse - np.diag(fit.model.unknowns.sigma[chosen] ** -2.0)
    gained, axes = np.linalg.eigh(data * np.outer(declared, declared))
    along = axes.T @ (declared * (inverse @ x))
    square = SCALES[:, None] ** 2  # (S, 1)
    open_part = square / (1.0 + square * np.maximum(gained, 0.0))  # (S, K)
    evidence = 0.5 * (along**2 * open_part - np.log(square / open_part)).sum(axis=1)
    likely = np.exp(evidence - evidence.max())
    likely /= likely.sum()
    mean_square = float(likely @ square[:, 0])
    at_mean = along * mean_square / (1.0 + mean_square * np.maximum(gained, 0.0))
    onto = fit.covariance[:, chosen] @ inverse @ (declared[:, None] * axes)  # (P, K)
    others = onto @ (along * open_part - at_mean).T * np.sqrt(likely)  # (P, S)
    return CommonScale(float(np.sqrt(mean_square)), others @ others.T)
