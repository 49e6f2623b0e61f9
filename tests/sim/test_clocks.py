"""Times of the rows of both logs, before any device file is written."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.sim.errors.sensor_errors import LEAD
from ballbar.sim.logging.clocks import log_times, task_cycles
from ballbar.sim.settings import ClockSettings

DURATION = 30.0  # [s]


@pytest.mark.parametrize("offset", [-20.0, -LEAD, 0.0, 12.0])
def test_the_ball_bar_is_logged_to_the_end_whenever_its_log_begins(offset: float) -> None:
    times = log_times(DURATION, ClockSettings(offset_s=offset), seed=1)
    end = DURATION - LEAD
    assert times.robot_true[0] - times.bar_true[0] == pytest.approx(-offset)
    assert end - 0.011 < times.bar_true[-1] <= end


def test_cycles_are_counted_from_the_first_row_also_where_the_second_is_late() -> None:
    for seed in range(8):
        cycles = task_cycles(50, 0.5, np.random.default_rng(seed))
        assert cycles[0] == 0
        assert set(np.diff(cycles)) == {2, 3}
