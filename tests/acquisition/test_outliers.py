"""Damaged values in a motion are found, alone and in pairs; what a robot does is left alone."""

import numpy as np
import pytest

from ballbar.acquisition.faults.damaged_values import damaged_values
from ballbar.cell.neighbours import SMALLEST

PERIOD = 0.004032  # [s]
T = PERIOD * np.arange(1000)
NOISE = 1e-6  # [rad]

Array = np.ndarray


def motion() -> Array:
    """(N, 2) [rad]"""
    noise = np.random.default_rng(3).normal(0.0, NOISE, (T.size, 2))
    return np.stack((0.6 * np.sin(1.3 * T), 0.2 * np.cos(2.0 * T + 1.0)), axis=1) + noise


def damaged(values: Array, begins: tuple[int, ...] = ()) -> list[tuple[int, int]]:
    breaks = np.isin(np.arange(T.size), begins)
    return [
        (int(row), int(channel)) for row, channel in np.argwhere(damaged_values(T, values, breaks))
    ]


@pytest.mark.parametrize("row", [0, 1, 3, 500, 996, 999])
@pytest.mark.parametrize("size", [2.0 * SMALLEST, -0.01])
def test_a_damaged_value_is_found_wherever_it_stands(row: int, size: float) -> None:
    values = motion()
    values[row, 1] += size
    assert damaged(values) == [(row, 1)]


@pytest.mark.parametrize(
    "rows", [(500, 501), (500, 502), (500, 503), (2, 3), (996, 999), (0, 2), (996, 997), (500, 504)]
)
@pytest.mark.parametrize("sizes", [(0.01, -0.008), (3e-4, 2e-4), (0.5, 2e-4)])
def test_two_damaged_values_that_hide_each_other_are_found(
    rows: tuple[int, int], sizes: tuple[float, float]
) -> None:
    values = motion()
    values[rows, 0] += sizes
    assert damaged(values) == [(row, 0) for row in rows]


def test_beside_a_new_stretch_only_its_own_rows_judge() -> None:
    values = motion()
    values[400:] += 1.0  # a counter that was reset
    assert damaged(values, begins=(400,)) == []
    values[399, 0] += 0.01
    values[400, 1] -= 0.01
    assert damaged(values, begins=(400,)) == [(399, 0), (400, 1)]


def test_stamps_that_jitter_damage_no_values_of_a_quick_motion() -> None:
    """Rows 80 us off at 2 rad/s are 160 urad off; where the robot is slow they show nothing."""
    t = PERIOD * np.arange(20_000)
    read = t + np.random.default_rng(7).normal(0.0, 8e-5, t.size)
    quick = 0.5 + 0.5 * np.sin(0.2 * t)  # [1] most of the time it is slow
    values = np.stack((quick**4 * np.sin(4.0 * read), 0.3 * np.cos(read)), axis=1)
    values += np.random.default_rng(3).normal(0.0, NOISE, values.shape)
    none = np.zeros(t.size, dtype=bool)
    assert np.count_nonzero(damaged_values(t, values, none)) <= 1e-4 * t.size
    values[10_000, 0] += 5e-3
    assert damaged_values(t, values, none)[10_000, 0]


@pytest.mark.parametrize("rows", [5, 6, 8, 500])
def test_a_step_in_the_motion_is_no_damage(rows: int) -> None:
    """Backlash that is crossed; in the last four rows of a log it looks like damage."""
    values = motion()
    values[-rows:] += 3e-4
    assert damaged(values) == []


def test_a_motion_that_begins_or_stops_at_once_is_no_damage() -> None:
    values = np.zeros((T.size, 2))
    values[300:600, 0] = 0.5 * (T[300:600] - T[299])
    values[600:, 0] = values[599, 0]
    values[:, 1] = np.abs(0.3 * (T - T[500]))
    assert damaged(values + np.random.default_rng(1).normal(0.0, NOISE, values.shape)) == []


def test_white_noise_is_no_damage() -> None:
    rng, t = np.random.default_rng(8), PERIOD * np.arange(100_000)
    values = rng.normal(0.0, 3e-5, (t.size, 3)) + np.sin(t)[:, None]
    assert damaged_values(t, values, np.zeros(t.size, dtype=bool)).sum() == 0


def test_values_of_an_encoder_in_coarse_steps_are_no_damage() -> None:
    steps = 1.7e-4  # [rad] 0.01 deg
    assert damaged(np.round(motion() / steps) * steps) == []
