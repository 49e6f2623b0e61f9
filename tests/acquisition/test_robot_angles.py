"""Robot angles of a table by themselves: rows that stand for none, and whether anything moves."""

from __future__ import annotations

import numpy as np

from ballbar.acquisition.faults.robot_angles import moves, without_sentinels
from ballbar.acquisition.table.table import Table

NAMES = ("m1", "m2")


def table(angles: np.ndarray) -> Table:
    rows = len(angles)
    columns = dict(zip(NAMES, angles.T, strict=True))
    return Table(columns, ("robot.csv",), np.zeros(rows, dtype=np.int64), np.arange(rows) + 2)


def test_axes_that_stand_at_different_angles_do_not_move() -> None:
    still = np.tile([0.5, -1.2], (300, 1))
    assert not moves(still)
    turning = still + np.linspace(0.0, 0.3, 300)[:, None] * [0.0, 1.0]
    assert moves(turning)


def test_of_negative_angles_behind_zeros_none_is_left_out() -> None:
    angles = np.column_stack((np.linspace(-2.0, -1.0, 50), np.linspace(-0.5, 0.5, 50)))
    angles[:3] = 0.0
    out = without_sentinels(table(angles), NAMES)
    np.testing.assert_array_equal(out.columns["m1"], angles[3:, 0])
    assert [(entry.kind, entry.count) for entry in out.findings] == [("zeros at the start", 3)]
