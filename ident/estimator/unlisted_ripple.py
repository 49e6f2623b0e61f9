"""Uncertainty by periodic errors of the gears that no file lists and no search has found.

Every gear errs by a little at orders that its file does not hold. Amplitudes of a few 1e-6 rad are
too small for the search (ballbar.ident.estimator.order_search), and what of them the unknowns of a
fit can take over shows in no residual. They are random effects here: cosine and sine of every whole
order of every gear, with one variance s^2. With the fit linearised, J of its unknowns x with
covariance C and A of the amplitudes, the scores h = A' r of the whitened residual r have the
covariance

    k M + s^2 M M,   M = A' A - A' J C J' A

of which maximum likelihood gives s and the noise k (restricted likelihood: Patterson & Thompson
1971). The amplitudes then have the posterior mean c and covariance `D = (M / k + 1 / s^2)^-1`. They
moved the unknowns by `-C J' A c`, so the best linear unbiased estimate (Henderson 1975), that of
generalised least squares, is the one of white noise less this, and errs by `-C J' A D A' J C` more.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.corrections.base import GEAR
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.normal_equations import jacobian
from ballbar.ident.estimator.order_search import ORDERS

# [rad] standard deviations of an amplitude that are tried: a gear errs by nine times as much
SIZES = np.geomspace(1e-8, 1e-4, 81)
EVIDENCE = 2.0  # logarithm of the likelihood's ratio that speaks for more than none
COLOURED = 2.0  # variance of the scores, over white noise, of no sound robot: 0.7 to 1.7 found
_LEAST = 1e-6  # of the largest eigenvalue: below, an amplitude is all taken over


@dataclass(frozen=True, eq=False)
class RandomRipple:
    """Random ripple of all gears: what it may do to an estimate, and what it has done."""

    shifts: Array  # (P, K) of the unknowns, each of one standard deviation and independent
    step: Array  # (P,) from the estimate to that of generalised least squares
    residuals: tuple[Array, ...]  # (E, N) of each part, without the likeliest ripple
    noise: float = 1.0  # variance of the scores over that of white noise, where nothing else is it


def unlisted_ripple(fit: Fit) -> RandomRipple:
    """The ripple that the residual of a fit asks for.

    None where its likelihood speaks for no such error, or the fit is one of kinematics alone.
    """
    none = np.zeros((fit.x.size, 0))
    nothing = RandomRipple(none, np.zeros(fit.x.size), fit.linear.residuals)
    if not fit.model.corrections:
        return nothing
    waves, mixed, score = _scores(fit)
    shifts = -fit.covariance @ mixed  # of the unknowns, for each amplitude
    score += shifts.T @ fit.linear.gradient  # what the search of the fit has left
    size, directions = np.linalg.eigh(waves + mixed.T @ shifts)
    size = np.maximum(size, 0.0)
    along = directions.T @ score
    ratio, noise = amplitude_variance(size, along)
    if ratio == 0.0:
        return replace(nothing, noise=noise if noise > COLOURED else 1.0)
    amplitudes = directions @ (along / (size + 1.0 / ratio))
    root = directions * np.sqrt(noise / (size + 1.0 / ratio))
    return RandomRipple(shifts @ root, -shifts @ amplitudes, _without(fit, amplitudes))


def amplitude_variance(size: Array, along: Array) -> tuple[float, float]:
    """The variance of an amplitude over that of the noise, and the latter; 0 without evidence.

    size : (K,) eigenvalues of the information. along : (K,) scores in their directions.
    """
    seen = size > _LEAST * size.max()
    square, size = along[seen] ** 2 / size[seen], size[seen]
    ratios = np.concatenate(([0.0], SIZES**2))
    spread = 1.0 + ratios[:, None] * size
    noise = (square / spread).mean(axis=1)
    likelihood = -0.5 * (size.size * np.log(noise) + np.log(spread).sum(axis=1))
    likelihood[0] += EVIDENCE
    best = int(np.argmax(likelihood))
    return float(ratios[best]), float(noise[best])


def _waves(fit: Fit) -> Iterator[tuple[Array, Array, Array]]:
    """Whitened columns (J, E, N) of the gears of each recording, cosines and sines
    (J, K / J, N) of the orders of each, and the residual (E, N).
    """
    gears = fit.model.gearing.to_gear.shape[1]
    for point, weights, residual in fit.recorded:
        columns = weights(point.columns[GEAR : GEAR + gears])
        angles = point.recording.robot.spline(point.robot_time) @ fit.model.gearing.to_gear
        turned = np.arange(1, ORDERS + 1)[:, None] * angles.T[:, None]  # (J, ORDERS, N)
        yield columns, np.concatenate((np.cos(turned), np.sin(turned)), axis=1), residual


def _without(fit: Fit, amplitudes: Array) -> tuple[Array, ...]:
    """The residuals (E, N) of each part without ripple of these amplitudes (K,)."""
    size = amplitudes.reshape(fit.model.gearing.to_gear.shape[1], -1)
    left = [
        residual - np.einsum("jk,jkn,jen->en", size, each, columns, optimize=True)
        for columns, each, residual in _waves(fit)
    ]
    return (*left, *fit.linear.residuals[len(left) :])


def _scores(fit: Fit) -> tuple[Array, Array, Array]:
    """The products (K, K) of the columns of the amplitudes, those with the unknowns' (P, K), and
    the scores (K,); a cosine and a sine of every order of every gear.
    """
    model, per_gear, gears = fit.model, 2 * ORDERS, fit.model.gearing.to_gear.shape[1]
    waves = np.zeros((gears, per_gear, gears, per_gear))
    mixed = np.zeros((model.unknowns.count, gears, per_gear))
    score = np.zeros((gears, per_gear))
    for k, (columns, each, residual) in enumerate(_waves(fit)):
        for block in jacobian(model, fit.linear, k):
            own, wave = columns[..., block.samples], each[..., block.samples]
            for j in range(gears):
                score[j] += wave[j] @ (own[j] * residual[:, block.samples]).sum(axis=0)
                mixed[:, j] += block.products(own[j], wave[j], model, k)
                for i in range(j + 1):
                    waves[j, :, i] += wave[j] * (own[j] * own[i]).sum(axis=0) @ wave[i].T
    lower = np.tril(waves.reshape(score.size, -1))
    return lower + np.tril(lower, -1).T, mixed.reshape(-1, score.size), score.ravel()
