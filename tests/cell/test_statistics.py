"""Statistics against scipy.stats and formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from ballbar.cell.statistics import (
    chi_square_quantile,
    correlation_time,
    covariance_root,
    rms,
    variance_beyond,
)


@pytest.mark.parametrize("freedom", [1, 2.5, 3, 60])
@pytest.mark.parametrize("probability", [0.001, 0.5, 0.95])
def test_a_quantile_of_chi_square_is_that_of_scipy(probability: float, freedom: float) -> None:
    assert chi_square_quantile(probability, freedom) == chi2.ppf(probability, freedom)


@pytest.mark.parametrize("shape", [(7,), (2, 3), (1,)])
def test_the_rms_is_that_of_all_values_whatever_their_shape(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(1).normal(2.0, 1.0, shape)
    assert rms(values) == pytest.approx(np.sqrt(sum(v * v for v in values.flat) / values.size))


def test_no_values_have_no_rms() -> None:
    assert math.isnan(rms([]))


def test_the_root_of_a_covariance_squares_to_it_and_is_symmetric_in_correlations() -> None:
    mixed = np.random.default_rng(2).normal(size=(4, 4))
    mixed[2] = 0.0  # something that is known exactly
    scale = np.array([1e-6, 1.0, 1.0, 1e4])
    covariance = mixed @ mixed.T * np.outer(scale, scale)
    root = covariance_root(covariance)
    assert root @ root.T == pytest.approx(covariance, rel=1e-9)
    assert not root[2].any()
    sigma = np.sqrt(np.diag(covariance))[[0, 1, 3]]
    correlations = root[np.ix_([0, 1, 3], [0, 1, 3])] / sigma[:, None]
    assert correlations == pytest.approx(correlations.T, rel=1e-9)


@pytest.mark.parametrize(("memory", "tau"), [(0.0, 1.0), (0.5, 3.0), (0.8, 9.0)])
def test_neighbours_of_an_autoregressive_series_count_as_its_correlation_time(
    memory: float, tau: float
) -> None:
    """(1 + memory) / (1 - memory) for a first-order series."""
    rng = np.random.default_rng(3)
    noise, series = rng.normal(size=(3, 40_000)), np.zeros((3, 40_000))
    for k in range(1, 40_000):
        series[:, k] = memory * series[:, k - 1] + noise[:, k]
    assert correlation_time(series, most=50.0) == pytest.approx(tau, rel=0.06)
    assert correlation_time(series, most=2.0) == pytest.approx(min(tau, 2.0), rel=0.06)


@pytest.mark.parametrize("true", [0.0, 2e-4])
def test_a_variance_beyond_known_noise_is_told_by_the_directions_that_are_known_well(
    true: float,
) -> None:
    """Depth is fifty times noisier than the other two: all squares alike would tell nothing."""
    rng = np.random.default_rng(4)
    turn = np.linalg.qr(rng.standard_normal((500, 3, 3)))[0]
    sigma = np.array([1e-4, 1e-4, 5e-3])
    known = turn @ (sigma[:, None] ** 2 * turn.transpose(0, 2, 1))
    rest = np.einsum("nij,jn->in", turn, sigma[:, None] * rng.standard_normal((3, 500)))
    rest += true * rng.standard_normal((3, 500))
    parts = list(zip(rest.T, known, strict=True))
    assert np.sqrt(variance_beyond(parts)[0]) == pytest.approx(true, rel=0.1, abs=3e-5)


def test_an_error_that_many_share_is_no_variance_of_each() -> None:
    """Ten errors of 0.1 mm with one of 0.2 mm in common, in each of 400 parts."""
    rng = np.random.default_rng(5)
    shared, each = 2e-4, 1e-4
    errors = shared * rng.standard_normal((400, 1)) + each * rng.standard_normal((400, 10))
    known = shared**2 + each**2 * np.eye(10)
    variance, chance = variance_beyond([(e, known) for e in errors])
    assert variance < 3.0 * chance
    more = errors + each * rng.standard_normal(errors.shape)
    variance, _ = variance_beyond([(e, known) for e in more])
    assert variance == pytest.approx(each**2, rel=0.1)


def test_the_deviation_of_a_variance_by_chance_is_that_of_many_draws() -> None:
    """Errors with nothing beyond their noise, a tenth of which are known ten times as well."""
    rng = np.random.default_rng(6)
    sigma = np.repeat([1e-5, 1e-4], [10, 90])
    known = np.diag(sigma**2)
    draws = [variance_beyond([(sigma * rng.standard_normal(100), known)]) for _ in range(2000)]
    found = np.array([variance for variance, _ in draws])
    # half of the draws have less than their noise, and stand at 0
    assert np.sqrt((found**2).mean() * 2.0) == pytest.approx(draws[0][1], rel=0.25)
