"""Rows that a log repeats because its source holds them are told from measurements."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.held_values import changed_rows, fresh_rows, whole_and_torn_rows

T = 0.004 * np.arange(400)  # [s] of a logger that is three times as quick as its source


def moving(t: Array) -> Array:
    """(N, 2) of a motion whose steps differ by far more than their digits."""
    return np.column_stack((np.sin(1.3 * t) + 0.2 * t, 0.7 * np.cos(0.9 * t)))


def held(every: int = 3) -> Array:
    return moving(T[np.arange(T.size) // every * every])


def test_a_row_changed_where_any_channel_did() -> None:
    channels = np.array([[1.0, 1.0, 2.0, 2.0, 2.0], [0.0, 0.0, 0.0, 0.0, 5.0]])
    assert changed_rows(channels).tolist() == [True, False, True, False, True]


def test_of_held_values_the_rows_are_measurements_in_which_they_first_appear() -> None:
    fresh = fresh_rows(T, held())
    assert np.array_equal(fresh, np.arange(T.size) % 3 == 0)


def test_in_a_dwell_a_row_of_every_second_period_of_the_source_remains() -> None:
    t = np.minimum(T, 0.4) + np.maximum(T - 1.0, 0.0)  # stands still for 0.6 s
    values = moving(t[np.arange(T.size) // 3 * 3])
    fresh = fresh_rows(T, values)
    inside = (T > 0.41) & (T < 0.99)
    assert np.array_equal(fresh[T < 0.4], (np.arange(T.size) % 3 == 0)[T < 0.4])
    assert np.diff(T[fresh & inside]) == pytest.approx(0.024)
    assert (fresh & inside).sum() == pytest.approx(0.58 / 0.024, abs=1.0)


def test_all_rows_are_measurements_where_few_repeat_or_values_are_rounded() -> None:
    values = moving(T)
    assert fresh_rows(T, values).all()
    values[[50, 150]] = values[[49, 149]]
    assert fresh_rows(T, values).all()
    assert fresh_rows(T, np.round(moving(T), 2)).all()  # most changes are of the last digit
    assert fresh_rows(T, np.ones((T.size, 2))).all()
    values[20::10] = values[19:-1:10]  # a tenth of the rows
    assert fresh_rows(T, values).sum() == T.size - 38


def test_a_row_read_while_the_source_renewed_its_values_is_torn() -> None:
    """One channel is still at its last value there; the next row has what was missing."""
    a, b = moving(T).T.copy()
    b[[100, 250]] = b[[99, 249]]
    whole, torn = whole_and_torn_rows([a, b])
    assert torn.tolist() == [100, 250]
    assert np.array_equal(whole, np.delete(np.arange(T.size), [100, 250]))


def test_a_channel_that_moves_by_its_last_digit_is_never_torn() -> None:
    a, b = moving(T).T.copy()
    b = np.round(b, 3)
    assert whole_and_torn_rows([a, b])[1].size == 0
