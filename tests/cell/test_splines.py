"""Least-squares splines of logs: their values, and which knots the rows support."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_lsq_spline

from ballbar.cell.splines import DEGREE, smoothing_spline

ROWS = np.arange(41) * 0.5  # [s]


def test_the_spline_is_that_of_scipy_where_rows_come_unevenly() -> None:
    rng = np.random.default_rng(1)
    t = np.sort(np.delete(rng.uniform(0.0, 10.0, 1200), np.s_[300:360]))
    values = np.sin(np.outer(t, [1.0, 2.0, 3.0])) + 1e-3 * rng.normal(size=(t.size, 3))
    inner = np.linspace(0.2, 9.8, 49)
    ours = smoothing_spline(t, values, inner)
    rival = make_lsq_spline(t, values, ours.t, k=DEGREE)
    np.testing.assert_allclose(ours(t), rival(t), rtol=0.0, atol=1e-11)
    assert ours.t.size == inner.size + 2 * (DEGREE + 1)  # no knot is left out


def inner_knots(t: np.ndarray) -> list[float]:
    """[s] of knots asked for at every second, that the spline has."""
    spline = smoothing_spline(t, np.cos(t)[:, None], np.arange(1.0, 20.0) - 0.1)
    return (spline.t[DEGREE + 1 : -DEGREE - 1] + 0.1).round().tolist()


def test_two_rows_hold_a_knot_interval() -> None:
    assert inner_knots(ROWS) == list(range(1, 20))


def test_an_interval_of_a_single_row_is_joined_with_the_next() -> None:
    assert inner_knots(np.delete(ROWS, 21)) == [k for k in range(1, 20) if k != 11]
