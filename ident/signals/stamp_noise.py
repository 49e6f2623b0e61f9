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

from cell.arrays import Array
from cell.neighbours import robust_sigma

SIGNIFICANT = 10.0  # standard errors
# Of the mean variance of the channels' own noise: less hardly matters, and stays with the channels
NOTABLE = 0.5
CLIPPED = 5.0  # standard deviations: a few outliers decide nothing
_PASSES = 8  # in which the channels' own noise shrinks to what it is


def stamp_noise(residual: Array, speed: Array) -> tuple[float, Array]:
    """[s] standard deviation of the stamps, and (C,) of each channel's own noise [rad].

    residual : (N, C) [rad] of the spline. speed : (N, C) [rad/s]. Without notable noise of the
    stamps: 0, and the rms of the residual.
    """
    noise = np.sqrt(np.mean(residual * residual, axis=0))
    sigma = robust_sigma(residual)
    if residual.shape[1] < 2 or not (sigma > 0.0).all():
        return 0.0, noise
    # channel first: sums over six numbers of a row take numpy many times as long
    residual, speed = np.ascontiguousarray(residual.T), np.ascontiguousarray(speed.T)
    scale = sigma[:, None]
    variance, error = _variance(np.clip(residual / scale, -CLIPPED, CLIPPED), speed / scale)
    if variance < SIGNIFICANT * error:
        return 0.0, noise
    own = noise
    for _ in range(_PASSES):
        power = (speed / own[:, None]) ** 2
        total = power.sum(axis=0)
        total = np.where(total > 0.0, total, 1.0)
        late = (residual * speed / own[:, None] ** 2).sum(axis=0) / total
        rest = residual - speed * late
        freedom = (1.0 - power / total).sum(axis=1)
        own = np.sqrt((rest * rest).sum(axis=1) / np.maximum(1.0, freedom))
        if not (own > 0.0).all():
            return 0.0, noise
    if variance * np.mean((speed / own[:, None]) ** 2) < NOTABLE:
        return 0.0, noise
    return float(np.sqrt(variance)), np.minimum(own, noise)


def _variance(residual: Array, speed: Array) -> tuple[float, float]:
    """[s^2] variance of the stamps, and its standard error where it is none.

    residual : (C, N) in units of the noise. speed : (C, N) [1/s] likewise.
    """
    products, squares = residual * speed, speed * speed
    shown = (products.sum(axis=0) ** 2 - (products**2).sum(axis=0)).sum()
    weight = (squares.sum(axis=0) ** 2 - (squares**2).sum(axis=0)).sum()
    if weight <= 0.0:
        return 0.0, 1.0
    return float(shown / weight), float(np.sqrt(2.0 / weight))
