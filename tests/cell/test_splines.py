"""Least-squares splines of logs: which knots the rows support."""

from __future__ import annotations

import numpy as np

from cell.splines import DEGREE, smoothing_spline

ROWS = np.arange(41) * 0.5  # [s]


def inner_knots(t: np.ndarray) -> list[float]:
    """[s] of knots asked for at every second, that the spline has."""
    spline = smoothing_spline(t, np.cos(t)[:, None], np.arange(1.0, 20.0) - 0.1)
    return (spline.t[DEGREE + 1 : -DEGREE - 1] + 0.1).round().tolist()


def test_two_rows_hold_a_knot_interval() -> None:
    assert inner_knots(ROWS) == list(range(1, 20))


def test_an_interval_of_a_single_row_is_joined_with_the_next() -> None:
    assert inner_knots(np.delete(ROWS, 21)) == [k for k in range(1, 20) if k != 11]
