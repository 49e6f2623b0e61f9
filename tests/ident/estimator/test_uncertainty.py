"""Autocorrelation-robust covariance, information gain, correlation and observability of a fit."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import parameter_named
from ballbar.ident.estimator.fit import Fit, fit_kinematics
from ballbar.ident.estimator.identifiability import candidates
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.estimator.time_blocks import BLOCK, NONE, block_numbers
from ballbar.ident.estimator.uncertainty import (
    autocorrelation,
    correlated_groups,
    correlation_time,
    doubted_shift,
    inflation_factors,
    observability,
    uncertainty,
)
from ballbar.ident.signals.smooth_log import smooth_log, smoothing
from tests.helpers.six_axes import INDEX, NAMES, TABLE
from tests.helpers.synthetic_recording import (
    NO_CLOCK_ERROR,
    NOMINAL,
    UNIVERSAL_AND_GIMBAL,
    recording,
)

PARAMETERS = np.array(
    [
        i
        for i in candidates(TABLE, UNIVERSAL_AND_GIMBAL)
        if NAMES[i] not in ("rd1", "rd3", "rtheta1")
    ]
)
# Of the minute's 19 blocks eight unknowns, clock included, leave enough to tell their scatter.
FEW = np.array([INDEX[name] for name in ("btheta1", "ox", "oy", "oz", "bd3", "ra2")])
REPEATED = 5


def fitted(samples: Samples, sigma: Array | None = None, parameters: Array = PARAMETERS) -> Fit:
    rod = ExcessNoise(rod=1e-7)
    return fit_kinematics(samples, NOMINAL, NO_CLOCK_ERROR, parameters, rod, prior_sigma=sigma)


@pytest.fixture(scope="module")
def white(noisy: Samples) -> Fit:
    return fitted(noisy)


@pytest.fixture(scope="module")
def slow() -> Fit:
    """The same noise in five samples after each other: they tell as much as one."""
    return fitted(recording(noise=1e-5, repeated=REPEATED, seed=31), parameters=FEW)


def scores(influence: Array, times: Array) -> tuple[Array, Array]:
    """Products and block sums of the scores (P, N)."""
    sums = np.zeros((len(influence), block_numbers(times)[-1] + 1))
    np.add.at(sums.T, block_numbers(times), influence.T)
    return influence @ influence.T, sums


def test_white_influence_is_not_inflated_and_slow_influence_is() -> None:
    times = np.arange(0.0, 120.0, 0.08)
    rng = np.random.default_rng(0)
    white = rng.standard_normal((40, times.size))
    assert np.median(inflation_factors(np.eye(40), *scores(white, times))) == pytest.approx(
        1.0, abs=0.1
    )
    # the same over 0.8 s: ten samples tell as much as one
    slow = np.repeat(rng.standard_normal((40, 150)), 10, axis=1)
    assert np.median(inflation_factors(np.eye(40), *scores(slow, times))) == pytest.approx(
        np.sqrt(10.0), rel=0.15
    )


def test_an_inflation_factor_is_at_least_1() -> None:
    """Neighbours that cancel do not make an estimate better than white noise would."""
    times = np.arange(0.0, 120.0, 0.08)
    alternating = np.tile([1.0, -1.0], times.size // 2)[None]
    assert np.array_equal(inflation_factors(np.eye(1), *scores(alternating, times)), [1.0])


def test_an_unknown_without_any_influence_is_not_inflated() -> None:
    assert np.array_equal(inflation_factors(np.zeros((2, 2)), np.eye(2), np.ones((2, 3))), [1, 1])


def test_blocks_of_time_are_three_seconds_long_and_gaps_leave_no_empty_ones() -> None:
    times = np.array([10.0, 11.0, 12.9, 13.0, 15.9, 31.0, 33.9, 34.0])
    assert BLOCK == 3.0
    assert block_numbers(times).tolist() == [0, 0, 0, 1, 1, 2, 2, 3]


def test_white_residuals_leave_the_covariance_as_it_is(white: Fit) -> None:
    stated = uncertainty(white)
    # 19 blocks scatter by a sixth; no factor is below 1
    assert np.median(stated.inflation) == pytest.approx(1.0, abs=0.1)
    assert abs(stated.autocorrelation) < 0.06  # 1 / sqrt(286)
    misfit = max(1.0, white.chi2_per_dof)
    expected = misfit * white.covariance * np.outer(stated.inflation, stated.inflation)
    assert stated.covariance == pytest.approx(expected, rel=1e-6)


def test_autocorrelated_residuals_inflate_the_standard_deviations_by_the_known_factor(
    slow: Fit,
) -> None:
    stated = uncertainty(slow)
    # Blocks of 15 samples cut some of the runs of five, and the fit absorbs a part of 19 blocks.
    assert 0.75 * np.sqrt(REPEATED) < np.median(stated.inflation) < 1.1 * np.sqrt(REPEATED)
    # 4 of 5 neighbours are the same, less what the fit absorbs
    assert 0.55 < stated.autocorrelation < 0.8
    ratio = np.sqrt(np.diag(stated.covariance) / np.diag(slow.covariance))
    assert ratio == pytest.approx(np.sqrt(max(1.0, slow.chi2_per_dof)) * stated.inflation, rel=1e-6)


def test_correlations_stay_those_of_the_normal_equations(slow: Fit) -> None:
    stated = uncertainty(slow).covariance
    a, b = (c / np.sqrt(np.outer(np.diag(c), np.diag(c))) for c in (stated, slow.covariance))
    assert a == pytest.approx(b, abs=1e-6)


def test_stated_deviations_hold_over_many_seeds_of_slow_noise() -> None:
    """Mean square of the normalised errors: 5 if the residuals were taken for white."""
    robust, white = [], []
    for seed in range(20):
        fit = fitted(recording(noise=1e-5, repeated=REPEATED, seed=100 + seed), parameters=FEW)
        names = fit.model.unknowns.names
        true = np.array([NOMINAL[name] for name in names[:-2]] + [0.0, 0.0])
        robust.append((fit.x - true) ** 2 / np.diag(uncertainty(fit).covariance))
        white.append((fit.x - true) ** 2 / np.diag(fit.covariance))
    # 160 values, correlated within a seed: a fifth of sampling error, about 5 and about 1.4, since
    # of 19 blocks the fit absorbs a part
    assert np.mean(white) == pytest.approx(REPEATED, rel=0.6)
    assert 0.8 < np.mean(robust) < 2.2
    assert np.mean(white) > 2.5 * np.mean(robust)


def test_a_misfit_widens_what_the_data_say_and_not_what_the_prior_says(noisy: Samples) -> None:
    """The logs state a third of their noise, so chi-square is nine."""
    sigma = np.full(PARAMETERS.size, np.inf)
    held = [NAMES[i] for i in PARAMETERS].index("rd6")
    sigma[held] = 1e-9
    quiet = replace(
        noisy, joint_noise=noisy.joint_noise / 3.0, encoder_noise=noisy.encoder_noise / 3.0
    )
    fit = fitted(quiet, sigma)
    assert fit.chi2_per_dof == pytest.approx(9.0, rel=0.15)
    stated, names = uncertainty(fit), fit.model.unknowns.names
    deviation = np.sqrt(np.diag(stated.covariance) / np.diag(fit.covariance))
    k = names.index("ra2")
    assert deviation[k] == pytest.approx(np.sqrt(fit.chi2_per_dof) * stated.inflation[k], rel=1e-3)
    assert deviation[names.index("rd6")] == pytest.approx(1.0, rel=1e-3)


def test_information_gain_is_the_share_of_the_variance_that_the_data_took_away(
    noisy: Samples,
) -> None:
    """A prior as wide as the data leaves half the variance: 1/2; much wider 1; much narrower 0."""
    free = fitted(noisy)
    names = [NAMES[i] for i in PARAMETERS]
    sigma = np.full(PARAMETERS.size, np.inf)
    k = free.model.unknowns.names.index("rd6")
    alone = float(np.sqrt(free.covariance[k, k]))
    for prior, gain in ((alone, 0.5), (1e3 * alone, 1.0), (1e-3 * alone, 0.0)):
        sigma[names.index("rd6")] = prior
        fit = fitted(noisy, sigma)
        stated = uncertainty(fit)
        at = fit.model.unknowns.names.index("rd6")
        assert stated.information_gain[at] == pytest.approx(gain, abs=1e-4)
        others = np.delete(stated.information_gain, at)
        assert (others == 1.0).all()  # no prior: all from the data


def test_covariance_keeps_the_prior_where_the_data_are_silent(machine_fit: Fit) -> None:
    stated = uncertainty(machine_fit)
    sigma = np.sqrt(np.diag(stated.covariance))
    layout = machine_fit.model.unknowns
    i = layout.names.index("backlash3")  # the forearm's load never reverses on this path
    assert stated.information_gain[i] < 0.5
    assert sigma[i] == pytest.approx(layout.sigma[i], rel=0.35)
    assert (np.linalg.eigvalsh(stated.covariance / np.outer(sigma, sigma)) > -1e-9).all()


def test_smoothed_noise_is_not_taken_for_a_systematic_residual_however_dense_the_samples() -> None:
    def motion(t: Array) -> Array:
        return np.stack(
            (np.sin(0.7 * t) + 0.3 * np.sin(1.9 * t), 0.8 + 0.4 * np.cos(0.45 * t)), axis=1
        )

    rng = np.random.default_rng(5)
    t = np.arange(0.0, 60.0, 0.004)
    log = smooth_log(t, motion(t) + rng.normal(0, 1e-5, (t.size, 2)), widest_knot_spacing=0.08)
    for step in (0.2, 0.07, 0.03, 0.01):
        times = np.arange(1.0, 59.0, step)
        residual = (log.spline(times) - motion(times)).T
        assert abs(autocorrelation(residual, times, smoothing(log, None))) < 0.15
        drift = np.sin(times / 2.0)[None] + 0.3 * rng.normal(0.0, 1.0, (1, times.size))
        assert autocorrelation(drift, times, smoothing(log, None)) > 0.7


def test_strongly_correlated_unknowns_are_one_group() -> None:
    correlation = np.eye(4)
    correlation[0, 2] = correlation[2, 0] = -0.95
    assert correlated_groups(correlation, ("a", "b", "c", "d")) == [("a", "c")]


def test_chains_of_correlations_are_one_group_whatever_the_units() -> None:
    correlation = np.eye(5)
    for i, j in ((0, 1), (1, 4)):
        correlation[i, j] = correlation[j, i] = 0.92
    correlation[2, 3] = correlation[3, 2] = 0.89  # not strong
    unit = np.array([1e-6, 1.0, 1e3, 2.0, 5.0])
    covariance = correlation * np.outer(unit, unit)
    assert correlated_groups(covariance, ("a", "b", "c", "d", "e")) == [("a", "b", "e")]


def test_observability_is_counted_with_all_other_unknowns_unknown() -> None:
    """Indices of the singular values of the selected block of the inverse covariance's inverse."""
    rng = np.random.default_rng(9)
    columns = rng.standard_normal((60, 5)) * np.array([1.0, 10.0, 0.1, 5.0, 2.0])
    normal, sigma = columns.T @ columns, np.array([1.0, 0.1, 10.0, 0.2, 0.5])
    selected = np.array([0, 2, 3])
    covariance = np.linalg.inv(normal)[np.ix_(selected, selected)]
    values = 1.0 / np.sqrt(
        np.linalg.eigvalsh(covariance / np.outer(sigma[selected], sigma[selected]))[::-1]
    )
    found = observability(normal, sigma, selected, 60)
    assert found == pytest.approx(
        {
            "O1": np.prod(values) ** (1 / 3) / np.sqrt(60),
            "O2": values[0] / values[-1],
            "O3": values[0],
            "O4": values[0] ** 2 / values[-1],
            "O5": 1.0 / (1.0 / values).sum(),
        }
    )
    every = observability(normal, sigma, np.arange(5), 60)
    assert every["O3"] == pytest.approx(np.linalg.svd(columns * sigma, compute_uv=False)[-1])


def test_what_stands_beyond_its_prior_widens_what_is_stated() -> None:
    """By half of what it moved the estimate; the robot's own parameters do not."""
    own = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]]) * 1e-12
    layout = SimpleNamespace(
        names=("ba2", "ba4", "ra2"),
        machine=np.arange(3),
        mean=np.zeros(3),
        sigma=np.array([5e-6, 5e-6, 7e-4]),
        shared=np.arange(3),
        parameters=[parameter_named(name) for name in ("ba2", "ba4", "ra2")],
        fixed=SimpleNamespace(table=SimpleNamespace(plate="ra6")),
    )

    def shift(x: list[float]) -> Array:
        fit = SimpleNamespace(model=SimpleNamespace(unknowns=layout), x=np.array(x), covariance=own)
        return doubted_shift(cast("Fit", fit), NONE)

    np.testing.assert_array_equal(shift([1e-5, 0.0, 5e-3]), 0.0)
    np.testing.assert_allclose(shift([4e-5, 0.0, 5e-3]), [4e-5, 1e-5, 0.0])


@pytest.mark.parametrize("time", [0.05, 0.3])
@pytest.mark.parametrize("white", [0.0, 2.0])
def test_the_correlation_time_is_that_of_a_drawn_process(time: float, white: float) -> None:
    """With and without white noise beside it; of white noise alone it is a row."""
    rng, t = np.random.default_rng(4), 0.01 * np.arange(40_000)
    values, keep = rng.normal(size=(3, t.size)), np.exp(-0.01 / time)
    only_white = values.copy()
    for k in range(1, t.size):
        values[:, k] = keep * values[:, k - 1] + np.sqrt(1.0 - keep**2) * values[:, k]
    values += white * rng.normal(size=values.shape)
    assert correlation_time(values, t) == pytest.approx(time, rel=0.25)
    assert correlation_time(only_white, t) < 0.05
