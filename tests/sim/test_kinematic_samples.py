"""Samples along a path: at which times, and where friction holds the sign of the rod's force."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.sim.kinematic_samples import (
    SampledPath,
    kinematic_samples,
    sample_path,
    sample_path_at,
)
from ballbar.sim.path import reference_path
from tests.helpers.simulated_recordings import settings
from tests.helpers.synthetic_recording import CELL, NOMINAL, SHAPE

DWELL = 2.0  # [s]
PATH = reference_path(CELL.robot, NOMINAL, SHAPE, duration=60.0, dwell=DWELL, stops=2, step=0.02)


def at_all_times() -> SampledPath:
    return sample_path_at(CELL, NOMINAL, PATH, PATH.t)


def test_samples_of_a_part_of_the_path_come_in_order_from_its_first_to_its_last_time() -> None:
    t = sample_path(CELL, NOMINAL, PATH, 40, instants="moving").t
    assert (np.diff(t) > 0.0).all()
    moving = PATH.t[np.abs(PATH.speed).max(axis=1) > 1e-3]
    assert t[[0, -1]] == pytest.approx(moving[[0, -1]], abs=0.05)


@pytest.mark.parametrize("direction", ["rising", "around"])
def test_friction_holds_its_sign_while_the_rod_stands_still(direction: str) -> None:
    path = at_all_times()
    sign = getattr(path, direction)
    assert set(sign) == {-1.0, 1.0}
    still = np.abs(PATH.speed).max(axis=1) < 1e-9
    assert still.sum() > 3.0 * DWELL / 0.02
    changes = np.flatnonzero(np.diff(sign))
    assert not (still[changes] & still[changes + 1]).any()


@pytest.mark.parametrize("delay", [0.0, 5e-3])
def test_a_path_sampled_for_an_earlier_or_later_robot_is_not_taken(delay: float) -> None:
    path = sample_path(CELL, NOMINAL, PATH, 20, delay=delay)
    late = settings(errors={"synchronisation": {"delay_s": 2e-3}}, plant={"kind": "kinematic"})
    with pytest.raises(ValueError, match=r"settings ask for 0\.002 s"):
        kinematic_samples(late, path)
