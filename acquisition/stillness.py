"""When a mechanism stands still, judged against the noise of its own log.

Speed at a sample is the mean angle of the WINDOW after it minus the mean of the WINDOW before it, over the difference of
their mean times: no delay, no even sampling needed, noise sigma_v = sigma sqrt(2/m) / WINDOW with m samples a window.
sigma comes from four neighbouring samples: a cubic through the true motion leaves nothing in their third divided
difference, so the median of its size is noise even if the log never rests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WINDOW = 0.1  # [s] half of the span over which a speed is taken: shorter than any dwell, longer than ten ball-bar samples
SIGMAS = 6.0  # of noise in the speed: a standing channel exceeds it in none of the 1e6 samples of a long log
CREEP = 5e-4  # [rad/s] slower is standing: servos settle and creep; a path for calibration moves at 0.1 to 1 rad/s
SHORTEST = 0.5  # [s] reversals of all channels at once look still for less


@dataclass(frozen=True, eq=False)
class Stillness:
    """When all channels of a log stand still, and how noisy each is."""

    still: NDArray[np.bool_]  # (N,) samples at which nothing moves
    intervals: NDArray[np.int64]  # (K, 2) first and last sample of each rest
    sigma: Array  # (C,) [rad] white noise of each channel, per sample


def stillness(t: Array, angles: Array) -> Stillness:
    """Rests of a log.

    t : (N,) [s], strictly increasing. angles : (N, C) [rad].
    """
    sigma, speed = noise_sigma(t, angles), speeds(t, angles)
    threshold = np.maximum(SIGMAS * sigma * np.sqrt(2.0 / _window(t)) / WINDOW, CREEP)
    quiet = (np.abs(speed) < threshold).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], quiet.astype(np.int8), [0]))))
    intervals = np.stack((edges[::2], edges[1::2] - 1), axis=1)
    intervals = intervals[t[intervals[:, 1]] - t[intervals[:, 0]] >= SHORTEST]
    still = np.zeros(t.size, dtype=bool)
    for first, last in intervals:
        still[first : last + 1] = True
    return Stillness(still, intervals.astype(np.int64), sigma)


def speeds(t: Array, angles: Array) -> Array:
    """(N, C) [rad/s] mean speed over one WINDOW before and one after each sample; constant within a WINDOW of the ends."""
    m = _window(t)
    if t.size < 2 * m + 1:
        raise ValueError(
            f"a log of {t.size} samples is shorter than {2 * WINDOW} s, too short for a speed"
        )
    times, means = _box_means(t[:, None] - t[0], m), _box_means(angles - angles[0], m)
    inner = (means[m + 1 :] - means[: -m - 1]) / (
        times[m + 1 :] - times[: -m - 1]
    )  # entry i belongs to sample i+m
    return np.pad(inner, ((m, m), (0, 0)), mode="edge")


def noise_sigma(t: Array, angles: Array) -> Array:
    """(C,) [rad] white noise of each channel per sample, from its third divided differences."""
    nodes = np.stack([t[i : t.size - 3 + i] for i in range(4)], axis=1)
    gaps = nodes[:, :, None] - nodes[:, None, :] + np.eye(4)
    weights = 1.0 / gaps.prod(axis=2)  # (N-3, 4) of the divided difference
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    difference = sum(weights[:, i, None] * angles[i : t.size - 3 + i] for i in range(4))
    return np.asarray(
        np.median(np.abs(difference), axis=0) / 0.6745, dtype=np.float64
    )  # 0.6745: median of |normal| in sigmas


def _window(t: Array) -> int:
    """Samples in one WINDOW, at least one."""
    return max(1, round(WINDOW / float(np.median(np.diff(t)))))


def _box_means(values: Array, m: int) -> Array:
    """(N-m+1, C) means of m neighbouring samples."""
    total = np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)))
    return (total[m:] - total[:-m]) / m
