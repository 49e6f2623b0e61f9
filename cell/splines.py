"""Least-squares splines of logs with gaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from cell.arrays import Array

DEGREE = 5  # continuous acceleration and jerk; used for logs and recorded paths alike


def smoothing_spline(t: Array, values: Array, inner: Array, *, rows: int = 2) -> BSpline:
    """Least-squares spline of degree DEGREE through values (N, C) at times t (N,) [s].

    inner : (K,) [s] inner knots; those with too few rows between them are left out. rows : least
        number of rows in each knot interval. With a single row, beside a gap for instance, the
        Schoenberg-Whitney condition may hold and the spline still oscillate without bound.
    """
    supported = inner[_supported(np.searchsorted(t, inner), t.size, rows)]
    ends = np.repeat(t[0], DEGREE + 1), np.repeat(t[-1], DEGREE + 1)
    knots = np.concatenate((ends[0], supported, ends[1]))
    # Normal equations agree with "qr" to 1e-13 and take a tenth of its time.
    return make_lsq_spline(t, values, knots, k=DEGREE, method="norm-eq")


def _supported(before: NDArray[np.intp], total: int, rows: int) -> list[int]:
    """Indices of knots with at least `rows` rows between them; before : (K,) rows before each."""
    knots, last = [], 0
    for knot, count in enumerate(before.tolist()):
        if count - last >= rows and total - count >= rows:
            knots.append(knot)
            last = count
    return knots
