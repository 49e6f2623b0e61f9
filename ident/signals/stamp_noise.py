"""Noise of a log's stamps, separate from that of its channels, by the residual of its spline.

A row that is stamped late by d reads too little by d times the speed, in all channels at once:
`r_c = v_c d + e_c`. The channels' own noise e is independent between channels, so products of two
of them show the variance of d alone,

    var d = sum r_a r_b v_a v_b / sum (v_a v_b)^2    over rows and pairs a < b,

with the standard error sqrt(1 / sum (v_a v_b)^2) of residuals in units of the noise if there is
none. Given d, fitted row by row, what is left of each channel is its own noise; a row takes the
share h of a channel with it.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.neighbours import robust_sigma

SIGNIFICANT = 10.0  # standard errors
# Of the mean variance of the channels' own noise: less hardly matters, and stays with the channels
NOTABLE = 0.5
CLIPPED = 5.0  # standard deviations: a few outliers decide nothing
_BLOCK = 1 << 18  # rows at a time, of a log of hours
_PASSES = 8  # in which the channels' own noise shrinks to what it is


def stamp_noise(residual: Array, speed: Array) -> tuple[float, Array]:
    """[s] standard deviation of the stamps, and (C,) of each channel's own noise [rad].

    residual : (N, C) [rad] of the spline. speed : (N, C) [rad/s]. Without notable noise of the
    stamps: 0, and the rms of the residual.
    """
    blocks = [slice(k, k + _BLOCK) for k in range(0, len(residual), _BLOCK)]
    noise = np.sqrt(sum((residual[b] * residual[b]).sum(axis=0) for b in blocks) / len(residual))
    sigma = np.concatenate([robust_sigma(channel[:, None]) for channel in residual.T])
    if residual.shape[1] < 2 or not (sigma > 0.0).all():
        return 0.0, noise
    parts = [_sums(residual[b].T / sigma[:, None], speed[b].T / sigma[:, None]) for b in blocks]
    shown, weight = np.sum(parts, axis=0)
    variance = shown / weight if weight > 0.0 else 0.0
    if weight <= 0.0 or variance < SIGNIFICANT * np.sqrt(2.0 / weight):
        return 0.0, noise
    own = noise
    for _ in range(_PASSES):
        power, freedom = np.sum([_rest(residual[b].T, speed[b].T, own) for b in blocks], axis=0)
        own = np.sqrt(power / np.maximum(1.0, freedom))
        if not (own > 0.0).all():
            return 0.0, noise
    share = sum(((speed[b] / own) ** 2).sum() for b in blocks) / speed.size
    if variance * share < NOTABLE:
        return 0.0, noise
    return float(np.sqrt(variance)), np.minimum(own, noise)


def _sums(residual: Array, speed: Array) -> tuple[float, float]:
    """Sums above and below the fraction that is the variance of the stamps [s^2].

    residual : (C, n) in units of the noise. speed : (C, n) [1/s] in the same units. Channel
    first: sums over six numbers of a row take numpy many times as long.
    """
    clipped, speed = np.clip(residual, -CLIPPED, CLIPPED), np.ascontiguousarray(speed)
    products, squares = np.ascontiguousarray(clipped) * speed, speed * speed
    shown = (products.sum(axis=0) ** 2 - (products**2).sum(axis=0)).sum()
    weight = (squares.sum(axis=0) ** 2 - (squares**2).sum(axis=0)).sum()
    return float(shown), float(weight)


def _rest(residual: Array, speed: Array, own: Array) -> tuple[Array, Array]:
    """(C,) [rad^2] sum of squares of what late stamps leave, and (C,) its degrees of freedom.

    residual : (C, n) [rad]. speed : (C, n) [rad/s]. own : (C,) [rad] noise of the channels.
    """
    residual, speed = np.ascontiguousarray(residual), np.ascontiguousarray(speed)
    power = (speed / own[:, None]) ** 2
    total = power.sum(axis=0)
    total = np.where(total > 0.0, total, 1.0)
    late = (residual * speed / own[:, None] ** 2).sum(axis=0) / total
    rest = residual - speed * late
    return (rest * rest).sum(axis=1), (1.0 - power / total).sum(axis=1)
