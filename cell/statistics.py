"""Statistics that every package uses."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaincinv


def rms(values: ArrayLike) -> float:
    """Root mean square of all values of an array of any shape, in its unit; NaN without values."""
    squares = np.square(np.asarray(values, dtype=float))
    return float(np.sqrt(np.mean(squares))) if squares.size else math.nan


def chi_square_quantile(probability: float, freedom: float) -> float:
    """Quantile of the chi-square distribution with `freedom` degrees of freedom.

    The formula of scipy.stats, which is slow to import.
    """
    return float(2.0 * gammaincinv(freedom / 2.0, probability))
