"""Dwells: when a mechanism stands, judged against the noise of its own log.

Speed at a sample is the mean angle of the WINDOW after it minus the mean of the WINDOW before it,
over the difference of their mean times: no delay, no even sampling needed, noise sigma_v = sigma
sqrt(2/m) / WINDOW with m samples a window. sigma comes from four neighbouring samples: a cubic
through the true motion leaves nothing in their third divided difference, so the median of its size
is noise even if the log has no dwell.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.neighbours import Mask, robust_sigma

# [s] half of the span over which a speed is taken: shorter than any dwell, longer than ten ball-
# bar samples.
WINDOW = 0.1
# Of noise in the speed: a standing channel exceeds it in none of the 1e6 samples of a long log.
SIGMAS = 6.0
# [rad/s] slower is standing: servos settle and creep; a path for calibration moves at 0.1 to 1
# rad/s.
CREEP = 5e-4
_BLOCK = 4096  # rows at a time, for the processor's cache
SHORTEST = 0.5  # [s] reversals of all channels at once look like a dwell for less


@dataclass(frozen=True, eq=False)
class Dwells:
    """When all channels of a log stand, and how noisy each is."""

    standing: Mask  # (N,) samples at which nothing moves
    intervals: NDArray[np.int64]  # (K, 2) first and last sample of each dwell
    sigma: Array  # (C,) [rad] white noise of each channel, per sample


def find_dwells(t: Array, angles: Array) -> Dwells:
    """Dwells of a log.

    t : (N,) [s], strictly increasing. angles : (N, C) [rad].
    """
    sigma = noise_sigma(t, angles)
    threshold = np.maximum(SIGMAS * sigma * np.sqrt(2.0 / _window(t)) / WINDOW, CREEP)
    slow = np.ones(t.size, dtype=bool)
    for speed, least in zip(speeds(t, angles), threshold, strict=True):
        slow &= np.abs(speed) < least
    edges = np.flatnonzero(np.diff(np.concatenate(([0], slow.astype(np.int8), [0]))))
    intervals = np.stack((edges[::2], edges[1::2] - 1), axis=1)
    intervals = intervals[t[intervals[:, 1]] - t[intervals[:, 0]] >= SHORTEST]
    standing = np.zeros(t.size, dtype=bool)
    for first, last in intervals:
        standing[first : last + 1] = True
    return Dwells(standing, intervals.astype(np.int64), sigma)


def speeds(t: Array, angles: Array) -> Iterator[Array]:
    """(N,) [rad/s] mean speed of each channel over one WINDOW before and one after each sample.

    t : (N,) [s]. angles : (N, C) [rad]. The speed is constant within a WINDOW of the ends. They
    come one at a time, since a log of hours is large.
    """
    m = _window(t)
    if t.size < 2 * m + 1:
        raise ValueError(f"a log of {t.size} samples is shorter than {2 * WINDOW} s")
    times = _box_means(t - t[0], m)
    apart = times[m + 1 :] - times[: -m - 1]
    for angle in angles.T:
        means = _box_means(angle - angle[0], m)
        # Entry i belongs to sample i+m.
        yield np.pad((means[m + 1 :] - means[: -m - 1]) / apart, m, mode="edge")


def noise_sigma(t: Array, angles: Array) -> Array:
    """(C,) [rad] white noise of each channel per sample, from its third divided differences.

    t : (N,) [s]. angles : (N, C) [rad].
    """
    difference = np.empty((t.size - 3, angles.shape[1]), order="F")
    for first in range(0, t.size - 3, _BLOCK):
        rows = slice(first, min(first + _BLOCK, t.size - 3))
        nodes = np.stack([t[i : t.size - 3 + i][rows] for i in range(4)], axis=1)
        gaps = nodes[:, :, None] - nodes[:, None, :] + np.eye(4)
        weights = 1.0 / gaps.prod(axis=2)  # (n, 4) of the divided difference
        weights /= np.linalg.norm(weights, axis=1, keepdims=True)
        around = [angles[i : t.size - 3 + i][rows] for i in range(4)]
        difference[rows] = sum(weights[:, i, None] * around[i] for i in range(4))
    return np.concatenate([robust_sigma(channel[:, None]) for channel in difference.T])


def _window(t: Array) -> int:
    """Samples t (N,) [s] in one WINDOW, at least one."""
    return max(1, round(WINDOW / float(np.median(np.diff(t)))))


def _box_means(values: Array, m: int) -> Array:
    """(N-m+1,) means of m neighbouring samples of values (N,)."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    return (total[m:] - total[:-m]) / m
