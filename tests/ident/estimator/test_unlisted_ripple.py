"""Errors of gears that no file lists, in the uncertainty of a fit without them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.statistics import rms
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.linear_model import LinearModel
from ballbar.ident.estimator.order_search import ORDERS
from ballbar.ident.estimator.uncertainty import uncertainty
from ballbar.ident.estimator.unlisted_ripple import amplitude_variance, unlisted_ripple
from ballbar.ident.joint_errors import linearised

SIZE = 1e-6  # [rad]


def waves(model: LinearModel) -> Array:
    """(K, E N) columns of the amplitudes, formed one by one."""
    return np.array(
        [
            (columns * wave(order * angle)).ravel()
            for columns, angle in zip(model.joints, model.angles, strict=True)
            for wave in (np.cos, np.sin)
            for order in range(1, ORDERS + 1)
        ]
    )


def with_ripple(fit: Fit, size: float) -> tuple[Fit, LinearModel, Array, Array]:
    """The fit of logs of white noise and ripple of every order, unknowns off by what their priors
    allow; the whitened columns of the ripple; and the error (P,) of the estimate.
    """
    rng, model = np.random.default_rng(1), linearised(fit)
    columns, flat = waves(model), model.columns.reshape(len(model.columns), -1)
    off = fit.model.unknowns.sigma * rng.standard_normal(len(flat))
    amplitudes = size * rng.standard_normal(len(columns))
    residual = rng.standard_normal(model.residual.size) + amplitudes @ columns + off @ flat
    step = -fit.covariance @ (flat @ residual)
    residual += step @ flat
    model = replace(model, residual=residual.reshape(model.residual.shape))
    linear = replace(fit.linear, residuals=(model.residual,), gradient=np.zeros(len(flat)))
    return replace(fit, linear=linear), model, columns, off + step


def test_the_shifts_are_those_of_the_posterior_of_all_amplitudes(machine_fit: Fit) -> None:
    fit, model, columns, _ = with_ripple(machine_fit, SIZE)
    ripple = unlisted_ripple(fit)
    flat = model.columns.reshape(len(model.columns), -1)
    mixed = flat @ columns.T
    information = columns @ columns.T - mixed.T @ fit.covariance @ mixed
    score = columns @ model.residual.ravel()
    size, directions = np.linalg.eigh(information)
    ratio, noise = amplitude_variance(np.maximum(size, 0.0), directions.T @ score)
    assert np.sqrt(ratio * noise) == pytest.approx(SIZE, rel=0.3)
    posterior = np.linalg.inv(information / noise + np.eye(len(columns)) / (ratio * noise))
    mean = posterior @ score / noise
    moved = fit.covariance @ mixed
    expected = moved @ posterior @ moved.T
    assert np.diag(ripple.shifts @ ripple.shifts.T) == pytest.approx(np.diag(expected), rel=1e-4)
    assert ripple.step == pytest.approx(
        moved @ mean, rel=1e-4, abs=1e-4 * np.abs(moved @ mean).max()
    )
    left = model.residual - (mean @ columns).reshape(model.residual.shape)
    assert np.hstack(ripple.residuals) == pytest.approx(left, abs=1e-3)


def test_generalised_least_squares_is_nearer_and_its_sigma_true(machine_fit: Fit) -> None:
    fit, _, _, error = with_ripple(machine_fit, SIZE)
    ripple, machine = unlisted_ripple(fit), fit.model.unknowns.machine
    white, nearer = np.diag(fit.covariance), error + ripple.step
    stated = np.sqrt(white + (ripple.shifts**2).sum(axis=1))
    before, after = ((e / np.sqrt(white))[machine] for e in (error, nearer))
    assert rms(after) < 0.8 * rms(before)
    assert 0.8 < rms((nearer / stated)[machine]) < 1.2


def test_white_noise_and_kinematics_alone_ask_for_none(machine_fit: Fit) -> None:
    nothing = unlisted_ripple(with_ripple(machine_fit, 0.0)[0])
    assert nothing.shifts.shape[1] == 0
    assert not nothing.step.any()
    bare = replace(machine_fit, model=replace(machine_fit.model, corrections=()))
    assert unlisted_ripple(bare).shifts.shape[1] == 0


@pytest.mark.parametrize("noise", [1.0, 4.0])
def test_variances_of_drawn_scores_are_found(noise: float) -> None:
    rng, size = np.random.default_rng(2), np.geomspace(1e6, 1e14, 480)
    found = np.array(
        [
            amplitude_variance(
                size, np.sqrt(noise * size + (4e-7 * size) ** 2) * rng.standard_normal(size.size)
            )
            for _ in range(20)
        ]
    )
    assert np.median(np.sqrt(found[:, 0] * found[:, 1])) == pytest.approx(4e-7, rel=0.1)
    assert np.median(found[:, 1]) == pytest.approx(noise, rel=0.1)
    white = [
        amplitude_variance(size, np.sqrt(noise * size) * rng.standard_normal(size.size))[0]
        for _ in range(20)
    ]
    assert np.count_nonzero(white) <= 2


def test_noise_that_the_scores_have_too_much_of_is_told(machine_fit: Fit) -> None:
    """A ripple of 0.2 mrad on one gear passed for noise: good, 2.2 stated deviations off."""
    fit, model, _, _ = with_ripple(machine_fit, 0.0)
    assert unlisted_ripple(fit).noise == 1.0
    linear = replace(fit.linear, residuals=(2.0 * model.residual,))
    ripple = unlisted_ripple(replace(fit, linear=linear))
    assert ripple.noise == pytest.approx(4.0, rel=0.2)
    assert ripple.shifts.shape[1] == 0
    assert uncertainty(replace(fit, linear=linear)).coloured == ripple.noise
