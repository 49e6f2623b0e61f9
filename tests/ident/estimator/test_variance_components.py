"""Noise that the logs do not show: planted in a recording and found in its loop-closure error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.ident.complete_fit import FIRST_EXCESS
from ballbar.ident.estimator.fit import Fit, fit_kinematics
from ballbar.ident.estimator.identifiability import candidates
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.estimator.variance_components import COMPONENTS, excess_noise, rod_deviation
from ballbar.ident.estimator.whitening import covariance
from tests.helpers.six_axes import NAMES, TABLE
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
ONLY_ROD = ExcessNoise(rod=2e-6)


def fitted(samples: Samples, excess: ExcessNoise = ONLY_ROD) -> Fit:
    return fit_kinematics(samples, NOMINAL, NO_CLOCK_ERROR, PARAMETERS, excess)


@pytest.fixture(scope="module")
def stretched() -> Fit:
    """A rod whose length deviates by 20 um, under 10 um of noise from the angles."""
    return fitted(recording(noise=1e-5, stretch=2e-5, seed=21))


def test_a_planted_deviation_of_the_rod_is_found(stretched: Fit) -> None:
    # 286 samples: 4 % of the deviation itself, and as much again from the noise of the angles
    assert rod_deviation(stretched) == pytest.approx(2e-5, rel=0.15)


def test_the_deviation_that_a_fit_assumed_does_not_matter(stretched: Fit) -> None:
    """Its own excess noise of the rod is taken out; of the angles all else stays."""
    again = replace(stretched, excess=ExcessNoise(rod=5e-5))
    assert rod_deviation(again) == pytest.approx(rod_deviation(stretched), rel=1e-6)


def test_a_rigid_rod_deviates_by_less_than_the_noise_could_hide(noisy: Samples) -> None:
    # the noise of 10 um over sqrt(286 / 2) samples' worth of variance: 3 um
    assert rod_deviation(fitted(noisy)) < 4e-6


@pytest.mark.parametrize(
    ("noise", "encoder_noise", "stretch", "expected"),
    [
        (1e-5, 4e-5, 0.0, ExcessNoise(0.0, 0.0, np.sqrt(15.0) * 1e-5, 0.0)),
        ([4e-5] * 3 + [1e-5] * 3, 1e-5, 0.0, ExcessNoise(np.sqrt(15.0) * 1e-5, 0.0, 0.0, 0.0)),
        ([1e-5] * 3 + [1e-4] * 3, 1e-5, 0.0, ExcessNoise(0.0, np.sqrt(99.0) * 1e-5, 0.0, 0.0)),
        (1e-5, 1e-5, 4e-5, ExcessNoise(0.0, 0.0, 0.0, 4e-5)),
    ],
    ids=["encoders", "main axes", "wrist", "rod"],
)
def test_noise_beyond_that_of_the_logs_is_found_in_the_channel_that_has_it(
    noise: float | list[float], encoder_noise: float, stretch: float, expected: ExcessNoise
) -> None:
    """The logs state 10 urad; the others of the four components stay at a fraction of it."""
    samples = recording(
        noise=np.array(noise), encoder_noise=encoder_noise, stretch=stretch, seed=22
    )
    found = excess_noise(fitted(samples))
    for name in ("gear", "wrist", "bar", "rod"):
        planted, value = getattr(expected, name), getattr(found, name)
        if planted:
            # 286 samples of several angles: 3 % of sampling error
            assert value == pytest.approx(planted, rel=0.12), name
        else:
            assert value < 0.2 * max(vars(expected).values()), name


def deviance(fit: Fit, excess: ExcessNoise) -> float:
    """-2 log likelihood of the components, from numpy's determinants."""
    (point,) = fit.linear.evaluations
    share = np.sqrt(fit.linear.equations / (fit.linear.equations - fit.model.unknowns.count))
    free = point.unmeasured_columns  # of a variance so large that its size does not matter
    spread = covariance(point.noise_columns(excess)) + np.einsum("mkn,mln->kln", free, free)
    matrices, error = spread.transpose(2, 0, 1), point.closure.error.T * share
    chi2 = np.einsum("nk,nk->n", error, np.linalg.solve(matrices, error[:, :, None])[:, :, 0])
    return float((chi2 + np.linalg.slogdet(matrices)[1]).sum())


def assert_most_likely(fit: Fit, found: ExcessNoise) -> None:
    least = deviance(fit, found)
    for name in ("gear", "wrist", "bar", "rod"):
        for factor in (0.8, 1.25):
            changed = replace(found, **{name: factor * getattr(found, name)})
            assert deviance(fit, changed) > least, (name, factor)


def test_several_components_at_once_are_the_most_likely_ones() -> None:
    """Two passes, as the complete fit makes them: the first one's values are the second's start."""
    samples = recording(noise=2e-5, encoder_noise=2e-5, stretch=1e-5, seed=23)
    fit = fitted(samples, FIRST_EXCESS)
    fit = fitted(samples, excess_noise(fit))
    found = excess_noise(fit)
    assert_most_likely(fit, found)
    planted = [np.sqrt(3.0) * 1e-5] * 3 + [1e-5]
    # they share the residual of 286 samples, so each has a sampling error of 10 %
    assert [getattr(found, name) for name in COMPONENTS] == pytest.approx(planted, rel=0.3)


def test_components_ten_times_their_start_are_the_most_likely_ones_after_two_passes() -> None:
    samples = recording(noise=1e-4, encoder_noise=1e-4, stretch=1e-4, seed=23)
    fit = fitted(samples, FIRST_EXCESS)
    fit = fitted(samples, excess_noise(fit))
    assert_most_likely(fit, excess_noise(fit))


@pytest.mark.parametrize("start", [1e-6, 1e-5, 1e-3])
def test_no_start_of_the_search_ends_without_noise(start: float) -> None:
    """Regression: a step to the lowest noise of all, from which no slope leads back, was the end. A
    residual of two lengths was then 1.17 times the noise, and the result no good one.
    """
    fit = fitted(recording(noise=1e-5, stretch=2e-6, seed=21))
    found = excess_noise(replace(fit, excess=ExcessNoise(1e-5, 1e-5, 1e-5, start)))
    assert 5e-7 < found.rod < 3e-6  # planted 2 um, below the noise of the angles
