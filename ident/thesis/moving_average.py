"""The filter of thesis sec. 5.2: a moving average over 100 ms of each log, before the fit."""

from __future__ import annotations

import numpy as np

from cell.arrays import Array

PERIOD = 0.1  # [s] thesis sec. 5.2


def moving_average(t: Array, angles: Array, period: float = PERIOD) -> Array:
    """(N, K) [rad] mean of the rows within half a period before and after each row.

    t : (N,) [s] rising, even or not. angles : (N, K) [rad]. Towards the ends the window narrows
    evenly, so that no row is delayed.
    """
    half = np.minimum(0.5 * period, np.minimum(t - t[0], t[-1] - t))
    tolerance = 1e-6 * period  # of rounding: rows on the window's edge belong to it
    first = np.searchsorted(t, t - half - tolerance)
    last = np.searchsorted(t, t + half + tolerance)
    sums = np.concatenate((np.zeros((1, angles.shape[1])), np.cumsum(angles, axis=0)))
    return np.asarray((sums[last] - sums[first]) / (last - first)[:, None])
