"""The moving average of thesis sec. 5.2."""

from __future__ import annotations

import numpy as np

from ident.thesis.moving_average import PERIOD, moving_average


def test_each_row_is_the_mean_of_its_neighbours_within_the_period() -> None:
    t = np.arange(200) * 0.01
    angles = np.random.default_rng(5).normal(size=(200, 2))
    averaged = moving_average(t, angles)
    for row in (5, 77, 194):
        assert np.abs(averaged[row] - angles[row - 5 : row + 6].mean(axis=0)).max() < 1e-12
    assert np.abs(averaged[[0, -1]] - angles[[0, -1]]).max() < 1e-12


def test_a_straight_motion_is_kept_and_a_bent_one_loses_what_the_formula_says() -> None:
    """The mean of t^2 / 2 over +-T/2 in steps h is (T^2 + 2 T h) / 24 more."""
    t = np.arange(401) * 0.002
    straight, bent = t[:, None], 0.5 * t[:, None] ** 2
    assert np.abs(moving_average(t, straight) - straight).max() < 1e-12
    inside = slice(30, -30)
    expected = (PERIOD**2 + 2.0 * PERIOD * 0.002) / 24.0
    assert np.abs((moving_average(t, bent) - bent)[inside] - expected).max() < 1e-12
