"""Statistics that every package uses."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike


def rms(values: ArrayLike) -> float:
    """Root mean square of all values of an array of any shape, in its unit; NaN without values."""
    squares = np.square(np.asarray(values, dtype=float))
    return float(np.sqrt(np.mean(squares))) if squares.size else math.nan
