"""The common scale of the sag's priors: its evidence, its doubt, and what it is good for."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from ballbar.cell.arrays import Array
from ballbar.ident import table_fit
from ballbar.ident.corrections.unit_weights import PRIOR, unit_weights
from ballbar.ident.estimator.common_scale import SCALES, CommonScale, common_scale
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.options import FitOptions
from ballbar.ident.robot.accuracy import position_error
from ballbar.ident.table_fit import fit_table
from tests.helpers.still_poses import angles, table_of, true_robot

PLAIN = FitOptions(joint_errors="none")
NAMES = [c.name for c in unit_weights(true_robot("ur5").robot).coefficients]


@cache
def fitted(sag: float, seed: int = 1) -> Fit:
    """A UR5 with sag of that size [rad/m] by 40 points, as its white covariance has it."""
    fit = fit_table(table_of(true_robot("ur5", sag=sag, seed=seed), count=40), PLAIN).fit
    return replace(fit, covariance=np.linalg.inv(fit.linear.normal))


def at_scales(fit: Fit) -> tuple[Array, Array]:
    """(S,) probability of each scale, and (S, P) the estimate there, by whole matrices."""
    layout = fit.model.unknowns
    own = np.array([layout.names.index(name) for name in NAMES])
    data = fit.linear.normal.copy()
    data[own, own] -= layout.sigma[own] ** -2.0
    right = fit.linear.normal @ fit.x
    known = np.linalg.inv(data)  # of the coefficients as the data alone tell them
    spread, alone = known[np.ix_(own, own)], (known @ right)[own]
    density, estimates = [], []
    for scale in SCALES:
        prior = (scale * PRIOR) ** 2 * np.eye(own.size)
        density.append(multivariate_normal(cov=spread + prior).logpdf(alone))
        whole = data.copy()
        whole[own, own] += (scale * PRIOR) ** -2.0
        estimates.append(np.linalg.solve(whole, right))
    weight = np.exp(np.array(density) - max(density))
    return weight / weight.sum(), np.array(estimates)


@pytest.mark.parametrize("sag", [0.0, 3e-4, 3e-3])
def test_the_scale_and_its_doubt_are_those_of_the_density_of_what_the_data_tell(sag: float) -> None:
    fit = fitted(sag)
    own = np.array([fit.model.unknowns.names.index(name) for name in NAMES])
    found = common_scale(fit, own, np.full(own.size, PRIOR))
    weight, estimates = at_scales(fit)
    assert found.scale**2 == pytest.approx(weight @ SCALES**2, rel=1e-5)
    data = fit.linear.normal.copy()
    data[own, own] += (found.scale * PRIOR) ** -2.0 - fit.model.unknowns.sigma[own] ** -2.0
    off = estimates - np.linalg.solve(data, fit.linear.normal @ fit.x)
    second = np.einsum("s,sp,sq->pq", weight, off, off)
    size = np.sqrt(np.diag(second))
    assert np.abs(found.doubt - second).max() < 1e-4 * np.outer(size, size).max()
    assert np.diag(found.doubt) == pytest.approx(np.diag(second), rel=1e-3, abs=1e-20)


def test_a_robot_that_sags_more_has_the_larger_scale() -> None:
    scales = []
    for sag in (0.0, 3e-4, 3e-3):
        fit = fitted(sag)
        scales.append(float(fit.model.corrections[0].coefficients[0].sigma / PRIOR))
    assert scales == sorted(scales)
    assert scales[0] < 0.1
    assert scales[2] > 0.5


def as_declared(fit: Fit, chosen: NDArray[np.intp], declared: Array) -> CommonScale:
    """The priors as they are."""
    del chosen, declared
    return CommonScale(1.0, np.zeros(fit.covariance.shape))


@pytest.mark.slow
@pytest.mark.parametrize(("sag", "most"), [(0.0, 0.85), (2e-3, 1.03)])
def test_a_robot_without_sag_is_found_better_and_one_that_sags_as_well(
    sag: float, most: float
) -> None:
    """Mean errors over the ranges of six robots by 30 poses, over those of priors as declared."""
    error, declared = [], []
    for seed in range(6):
        true = true_robot("ur5", sag=sag, seed=seed)
        table, q = table_of(true, count=30, noise=1e-4, seed=seed), angles("ur5", 200, 50)
        scaled = fit_table(table, PLAIN).identified_robot()
        with patch.object(table_fit, "common_scale", as_declared):
            plain = fit_table(table, PLAIN).identified_robot()
        inside = q[scaled.covered(q)]
        for robot, errors in ((scaled, error), (plain, declared)):
            errors.append(position_error(robot.tool(inside), true.positions(inside)).mean)
    assert np.mean(error) < most * np.mean(declared)
