"""A sensed length against the path of the tool, at all lags."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.ident.start.lag_scan import subsample
from ballbar.ident.start.length_scan import best_lengths

STEP = 0.05  # [s]


def path(count: int, *, flat: bool = False) -> np.ndarray:
    """(count, 3) [m] a smooth path that does not repeat itself."""
    t = STEP * np.arange(count)
    x = 0.9 + 0.3 * np.sin(0.31 * t) + 0.1 * np.sin(1.3 * t + 1.0)
    y = 0.4 * np.sin(0.23 * t + 2.0) + 0.1 * np.sin(0.9 * t)
    z = np.full(count, 0.5) if flat else 0.6 + 0.3 * np.cos(0.41 * t) + 0.1 * np.sin(0.7 * t)
    return np.stack((x, y, z), axis=1)


def lengths(points: np.ndarray, seat: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points - seat, axis=1)


NO_MOVES = np.zeros((0, 3, 1600))


@pytest.mark.parametrize("lag", [-300, 0, 417])
def test_lag_seat_and_zero_come_out_of_one_scan(lag: int) -> None:
    points, seat, zero = path(2600), np.array([0.2, -0.6, 0.1]), 4e-3
    length = lengths(points[500 + lag :][:1500], seat) - zero
    best = best_lengths(points[500:2100], NO_MOVES, length, STEP, zero_sigma=0.01, count=3)
    scan, index = best[0]
    assert subsample(scan.scan, index) == pytest.approx(lag, abs=0.05)
    assert len(scan.seats(index)) == 1
    np.testing.assert_allclose(scan.seats(index)[0], seat, atol=1e-4)
    assert scan.zero(index) == pytest.approx(zero, abs=1e-4)


def test_a_path_in_a_plane_leaves_a_seat_on_either_side() -> None:
    points, seat = path(1600, flat=True), np.array([0.2, -0.6, 0.1])
    length = lengths(points[100:1500], seat)
    scan, index = best_lengths(points, NO_MOVES, length, STEP, zero_sigma=1e-9, count=3)[0]
    above, below = sorted(scan.seats(index), key=lambda s: -s[2])
    np.testing.assert_allclose(below, seat, atol=1e-3)
    np.testing.assert_allclose(above, seat + np.array([0.0, 0.0, 0.8]), atol=1e-3)


def test_a_short_stroke_is_seen_once_the_robots_parameters_are_free() -> None:
    """A millimetre of stroke beside two of a robot's error: the nominal path alone hides it."""
    t = STEP * np.arange(1600)
    stroke = 1e-3 * np.sin(0.37 * t) * np.sin(1.1 * t + 0.4)
    direction = path(1600) - [0.2, -0.6, 0.1]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    true = np.array([0.2, -0.6, 0.1]) + (1.0 + stroke)[:, None] * direction
    error = np.stack((np.sin(3.0 * true[:, 1]), np.cos(2.0 * true[:, 0]), true[:, 0] ** 2), axis=1)
    moves = np.stack([(error * axis).T for axis in np.eye(3)]) * 5e-3
    nominal = true - 2e-3 * error
    length = 1.0 + stroke[300:1500]
    scan, index = best_lengths(nominal, moves, length, STEP, zero_sigma=0.0, count=3)[0]
    assert scan.scan.lags[index] == 300


def test_no_lag_without_overlap() -> None:
    points = path(150)
    assert (
        best_lengths(points, np.zeros((0, 3, 150)), np.ones(150), STEP, zero_sigma=0.0, count=3)
        == []
    )
