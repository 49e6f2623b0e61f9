"""Statistics that every package uses."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincinv

Values = NDArray[np.float64]


def rms(values: ArrayLike) -> float:
    """Root mean square of all values of an array of any shape, in its unit; NaN without values."""
    squares = np.square(np.asarray(values, dtype=float))
    return float(np.sqrt(np.mean(squares))) if squares.size else math.nan


def chi_square_quantile(probability: float, freedom: float) -> float:
    """Quantile of the chi-square distribution with `freedom` degrees of freedom.

    The formula of scipy.stats, which is slow to import.
    """
    return float(2.0 * gammaincinv(freedom / 2.0, probability))


def covariance_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """(U, U) matrix R with R R' the covariance (U, U): the symmetric root of the correlations,
    scaled.

    It changes little with the last bits of the covariance, as eigenvectors do not.
    """
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return np.asarray(sigma[:, None] * root)


def correlation_time(series: NDArray[np.float64], *, most: float) -> float:
    """Number of neighbouring columns of a series (E, N) that count as one: 1 for white noise.

    Integrated autocorrelation, cut where it is no longer seen (Sokal 1997), at most `most`.
    """
    total, n = float((series**2).sum()), series.shape[1]
    tau, seen = 1.0, 2.0 / np.sqrt(series.size)
    for lag in range(1, n // 4):
        share = float((series[:, lag:] * series[:, :-lag]).sum()) / total
        if share < seen or tau > most:
            break
        tau += 2.0 * share
    return min(tau, most)


def variance_beyond(parts: Sequence[tuple[Values, Values]]) -> tuple[float, float]:
    """Variance of each of some errors beside what is known of them, and its deviation by chance.

    parts : errors (M,), and the covariance (M, M) that is known of them. Each direction counts by
    its own variance: those with large noise, such as depths of pictures, tell little, and an error
    that many share is one (DerSimonian & Laird 1986). The deviation is that of the estimate where
    nothing is beyond.
    """
    sizes, squares = list[NDArray[np.float64]](), list[NDArray[np.float64]]()
    for errors, known in parts:
        size, axes = np.linalg.eigh(known)
        sizes.append(np.maximum(size, 0.0))
        squares.append((axes.T @ errors) ** 2)
    noise, square, out = np.concatenate(sizes), np.concatenate(squares), 0.0
    for _ in range(20):  # converges in a few
        weight = (noise + out) ** -2.0
        out = max(0.0, float(weight @ (square - noise) / weight.sum()))
    return out, float(np.sqrt(2.0 / (noise**-2.0).sum()))
