"""A buffer that was sent again is found in a log; a robot that repeats its program is none."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.acquisition.faults.replayed import with_replays_checked
from ballbar.acquisition.flags import RowFlag, usable
from ballbar.acquisition.table.table import Table
from ballbar.cell.arrays import Array

ROWS, PERIOD = 1200, 400  # of a program that the robot repeats
SCALES = {"m1": 0.01, "m2": 0.01}  # [rad] at the joint


def table_of(values: Array) -> Table:
    return Table(
        columns=dict(zip(SCALES, values.T, strict=True)),
        line=np.arange(2, len(values) + 2),
        flags=np.zeros(len(values), dtype=np.uint32),
        file=np.zeros(len(values), dtype=np.uint16),
        files=("robot.csv",),
    )


def motion(noise: float) -> Array:
    t = 2.0 * np.pi * np.arange(ROWS) / PERIOD
    exact = np.stack((30.0 * np.sin(t), 20.0 * np.cos(2.0 * t)), axis=1)
    exact = np.round(exact[np.arange(ROWS) % PERIOD], 6)
    return np.asarray(exact + noise * np.random.default_rng(1).standard_normal(exact.shape))


def test_rows_that_repeat_others_and_begin_with_a_leap_are_left_out() -> None:
    values = motion(1e-4)
    values[500:560] = values[430:490]
    checked = with_replays_checked(table_of(values), SCALES)
    assert np.flatnonzero(~usable(checked.flags)).tolist() == list(range(500, 560))
    (finding,) = checked.findings
    assert finding.kind == "replayed rows"
    assert "lines 502 to 561 repeat lines 432 to 491" in finding.sentence
    assert checked.flags[500] & np.uint32(RowFlag.FROZEN)


def test_a_counter_that_wraps_is_judged_by_its_steps() -> None:
    words = np.round(1e6 * motion(1e-4)).astype(np.int64) % 2**32
    words[500:560] = words[430:490]
    checked = with_replays_checked(table_of(words), dict.fromkeys(SCALES, 1e-8), 2.0**32)
    assert np.count_nonzero(~usable(checked.flags)) == 60


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_program_that_the_robot_repeats_is_no_replay(noise: float) -> None:
    """Commanded angles repeat to the last digit, and lead on without a leap."""
    assert with_replays_checked(table_of(motion(noise)), SCALES).findings == ()


def test_rest_repeats_a_value_and_is_no_replay() -> None:
    values = np.insert(motion(0.0), 300, np.repeat(motion(0.0)[300:301], 200, axis=0), axis=0)
    values[300:500:2, 0] += 1e-6  # its last digit flickers
    assert with_replays_checked(table_of(values), SCALES).findings == ()
