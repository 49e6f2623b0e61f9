"""Variance components of the loop-closure error, by maximum likelihood.

Each component's variance is what makes the residuals most likely, given that the fit has absorbed
its share of the degrees of freedom (residuals are scaled up for it). Unmeasured joints have
unlimited variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.model import Evaluation, Model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import NormalEquations
from ballbar.ident.estimator.whitening import cholesky, covariance, inverse_lower

LOWEST, HIGHEST = 1e-8, 3e-3  # [rad, m] below every noise of the logs; above every model error
LITTLE = 1e-7  # [rad, m] start of a second search where a step of the first was too long
UNMEASURED_SIGMA = 1.0  # [rad] of a joint without encoder: a twelfth of all turns, no knowledge
COMPONENTS = ("gear", "wrist", "bar", "rod")  # of recordings, found together
OF_POSES = ("position", "rotation")  # of still poses beside them
ROD_SIGMA_RANGE = 1e-8, 1e-3  # [m] from nothing to a rod that is no constraint any more


def rod_deviation(fit: Fit) -> float:
    """[m] standard deviation of the rod's length that makes the residuals of a fit most likely.

    One unknown and a rank-one update of the covariance, so no matrix is inverted again. The fit is
    of one recording; its own excess noise of the rod is taken out.
    """
    (point,) = fit.linear.evaluations
    weights = fit.model.weights(fit.x, point, replace(fit.excess, rod=0.0))
    residual, rod = weights(point.closure.error), weights(point.closure.rod_column)
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
    """The variance components of the residuals of a fit."""
    components = COMPONENTS if fit.model.table is None else (*COMPONENTS, *OF_POSES)
    freedom = fit.degrees / sum(r.size for r in fit.linear.residuals)
    return likeliest(fit.model, fit.linear, fit.excess, components, freedom)


def likeliest(
    model: Model,
    linear: NormalEquations,
    start: ExcessNoise,
    components: Sequence[str],
    freedom: float,
    highest: float = HIGHEST,
) -> ExcessNoise:
    """The variance components of residuals.

    freedom : degrees of freedom over equations. highest : [m, rad] bound of each component.
    """
    share = 1.0 / np.sqrt(max(freedom, 1.0 / linear.equations))
    robust = linear.robust or [np.ones(point.samples.size) for point in linear.evaluations]
    likelihoods = [
        _Likelihood.of(
            point,
            model.backlash_uncertainty(linear.x, point),
            share * point.closure.error * weight,
            components,
        ).part(weight > 0.0)
        for point, weight in zip(linear.evaluations, robust, strict=True)
    ]

    def deviance(logs: Array) -> tuple[float, Array]:
        variances = np.exp(logs)
        values, slopes = zip(*(each.deviance(variances) for each in likelihoods), strict=True)
        return sum(values), variances * np.sum(slopes, axis=0)

    bounds = [(2.0 * float(np.log(LOWEST)), 2.0 * float(np.log(highest)))] * len(components)
    search = partial(minimize, deviance, jac=True, method="L-BFGS-B", bounds=bounds)
    sizes = np.clip([getattr(start, c) for c in components], 1e-6, highest)
    begin = np.log(np.square(sizes))
    optimum = search(begin)
    moved = optimum.x != begin
    if (optimum.x[moved] < 2.0 * np.log(2.0 * LOWEST)).all():  # no slope leads back from there
        again = search(np.where(moved, 2.0 * np.log(LITTLE), begin))
        optimum = min(optimum, again, key=lambda solution: solution.fun)
    sigmas = np.exp(0.5 * optimum.x).tolist()
    return ExcessNoise(**dict(zip(components, sigmas, strict=True)))


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Likelihood of the components given the loop-closure errors of one recording's N samples."""

    error: Array  # (6, N) [m, rad]
    logged: Array  # (6, 6, N) covariance without the components
    per_variance: Array  # (C, 6, 6, N) what each component adds for a variance of one

    @classmethod
    def of(
        cls, point: Evaluation, uncertain: Array | float, error: Array, components: Sequence[str]
    ) -> _Likelihood:
        """uncertain : as of `Evaluation.noise_columns`."""
        logged = covariance(point.noise_columns(ExcessNoise(), uncertain))
        for column in point.unmeasured_columns * UNMEASURED_SIGMA:
            logged += column[:, None] * column[None]
        silent = covariance(point.noise_columns(ExcessNoise()))
        units = [ExcessNoise(**{name: 1.0}) for name in components]
        added = [covariance(point.noise_columns(unit)) - silent for unit in units]
        return cls(error, logged, np.array(added))

    def part(self, samples: NDArray[np.bool_]) -> _Likelihood:
        """That of some of the samples."""
        if samples.all():
            return self
        return _Likelihood(
            self.error[:, samples], self.logged[..., samples], self.per_variance[..., samples]
        )

    def deviance(self, variances: Array) -> tuple[float, Array]:
        """-2 log likelihood of the variances, and its derivatives (C,)."""
        spread = self.logged + np.tensordot(variances, self.per_variance, axes=1)
        factor = cholesky(spread)
        rows = inverse_lower(factor)
        white = (rows * self.error[:, None]).sum(axis=0)
        weighted = (rows * white).sum(axis=1)
        slope = np.einsum("ikn,jkn->ijn", rows, rows) - weighted[:, None] * weighted
        value = (white * white).sum() + 2.0 * sum(np.log(factor[i, i]).sum() for i in range(6))
        return float(value), np.tensordot(self.per_variance, slope, axes=3)
