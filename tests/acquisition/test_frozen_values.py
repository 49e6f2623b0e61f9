"""A channel that repeats its value while it moves is frozen; one that stands still is not."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.acquisition.faults.frozen import EDGE, _frozen, _side
from ballbar.cell.arrays import Array

T = 0.01 * np.arange(60)  # [s]
FIRST, LAST = 25, 34  # of the rows that repeat a value


def motion(speed: float) -> Array:
    """(60,) [rad] of an axis that speeds up, no two steps alike, from `speed` [rad/s]."""
    return speed * (T + 0.4 * T**2 + 0.1 * np.sin(3.0 * T))


def runs(values: Array) -> list[tuple[int, int]]:
    found = _frozen(T, np.diff(values))
    return list(zip(found.first.tolist(), found.last.tolist(), strict=True))


@pytest.mark.parametrize("direction", [-1, 1])
def test_the_speed_beside_a_run_is_that_of_the_five_rows_next_to_it(direction: int) -> None:
    """The step out of a frozen run is a jump and no speed."""
    values = motion(0.5)
    values[FIRST : LAST + 1] = values[FIRST]
    row = np.array([FIRST if direction < 0 else LAST])
    side = _side(T, np.diff(values), row, direction)
    near = FIRST if direction < 0 else LAST + 1
    far = near + direction * EDGE
    assert side.speed == pytest.approx((values[far] - values[near]) / (T[far] - T[near]))
    assert side.exists.all()
    assert side.abrupt.all()


def test_there_is_no_motion_before_the_first_row_nor_behind_the_last() -> None:
    step = np.diff(motion(0.5))
    for row, direction in ((0, -1), (EDGE - 1, -1), (T.size - 1, 1), (T.size - EDGE - 1, 1)):
        side = _side(T, step, np.array([row]), direction)
        assert (side.speed, side.exists, side.abrupt) == (0.0, False, False)
    assert _side(T, step, np.array([EDGE]), -1).exists
    assert _side(T, step, np.array([T.size - EDGE - 2]), 1).exists


def test_a_value_that_repeats_while_the_axis_goes_on_is_frozen() -> None:
    values = motion(0.5)
    values[FIRST : LAST + 1] = values[FIRST]
    assert runs(values) == [(FIRST, LAST)]


def test_an_axis_that_stops_and_goes_on_from_there_is_not_frozen() -> None:
    values = motion(0.5)
    values[LAST:] = values[LAST:] - values[LAST] + values[FIRST]
    values[FIRST : LAST + 1] = values[FIRST]
    assert runs(values) == []


@pytest.mark.parametrize(("speed", "frozen"), [(0.5, True), (1e-3, False)])
def test_at_the_end_of_a_log_half_of_the_way_left_out_must_be_seen(
    speed: float, *, frozen: bool
) -> None:
    """In 0.09 s an axis of 1 mrad/s goes 0.15 mrad, half of which is within a backlash."""
    values = motion(speed)
    values[-10:] = values[-10]
    assert runs(values) == ([(50, 59)] if frozen else [])
    values = motion(speed)
    values[:10] = values[9]
    assert runs(values) == ([(0, 9)] if frozen else [])


@pytest.mark.parametrize(("rows", "frozen"), [(4, False), (5, True)])
def test_fewer_rows_than_five_are_damaged_values(rows: int, *, frozen: bool) -> None:
    values = motion(0.5)
    values[FIRST : FIRST + rows] = values[FIRST]
    assert bool(runs(values)) is frozen
