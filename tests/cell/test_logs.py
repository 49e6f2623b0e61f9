"""Logs keep write-protected copies: a caller's arrays stay its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import read_only
from ballbar.cell.geometry import Geometry
from ballbar.cell.logs import BallBarLog, ForceLog, RobotLog
from tests.helpers.six_axes import NAMES, TABLE

LOGS = {
    "robot": (RobotLog, {"q": 6, "torque": 6}, {}),
    "ball-bar": (BallBarLog, {"angles": 2}, {"joints": (1, 4)}),
    "force sensor": (ForceLog, {"wrench": 6}, {}),
}


@pytest.mark.parametrize("log", LOGS)
def test_a_log_neither_protects_nor_follows_the_arrays_of_its_caller(log: str) -> None:
    """Regression: a log set the write flag of the arrays that it was made from.

    A caller that reused its buffer for the next recording met "assignment destination is
    read-only".
    """
    kind, columns, others = LOGS[log]
    arrays = {"t": np.arange(5.0)} | {name: np.ones((5, c)) for name, c in columns.items()}
    marks = {"segment": np.zeros(5, np.uint16), "flags": np.zeros(5, np.uint32)}
    if kind is not ForceLog:
        arrays |= marks
    made = kind(**arrays, **others)
    for name, values in arrays.items():
        assert values.flags.writeable, name
        before = getattr(made, name).copy()
        values[...] = 7
        np.testing.assert_array_equal(getattr(made, name), before)
        with pytest.raises(ValueError, match="read-only"):
            getattr(made, name)[0] = 0


def test_a_view_of_a_writeable_array_is_copied_even_if_the_view_is_protected() -> None:
    buffer = np.ones((5, 6))
    view = buffer[:]
    view.flags.writeable = False
    log = RobotLog(np.arange(5.0), view)
    buffer[...] = 7.0
    np.testing.assert_array_equal(log.q, np.ones((5, 6)))


def test_a_log_made_from_another_shares_its_arrays() -> None:
    log = RobotLog(np.arange(5.0), np.ones((5, 6)))
    assert replace(log, flags=np.zeros(5, np.uint32)).q is log.q


def test_a_copy_keeps_the_memory_layout_that_a_reader_chose() -> None:
    columns = np.ones((6, 5)).T
    assert RobotLog(np.arange(5.0), columns).q.flags.f_contiguous


def test_a_geometry_does_not_follow_the_array_it_was_made_from() -> None:
    values = np.zeros(len(NAMES))
    geometry = Geometry(values, TABLE)
    values[0] = 1.0
    assert geometry.values[0] == 0.0


def test_numbers_of_another_type_become_float64() -> None:
    assert read_only([1, 2]).dtype == np.float64
    assert RobotLog(np.arange(5), np.ones((5, 6), np.float32)).q.dtype == np.float64
