"""Axis ranges from which still poses are drawn."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ballbar.cell.errors import InputError
from ballbar.cell.load import load_robot
from ballbar.sim.pose_choice import _limits
from ballbar.sim.settings import ErrorSettings, PosesSettings
from ballbar.sim.true_robot import true_arm

ROBOT = load_robot("ur5")
ARM = true_arm(ROBOT, ErrorSettings(), 1)
LOWER, UPPER = np.rad2deg(ROBOT.axis_lower), np.rad2deg(ROBOT.axis_upper)  # [deg]


def settings(lower: object = None, upper: object = None) -> PosesSettings:
    return cast("PosesSettings", SimpleNamespace(axis_lower_deg=lower, axis_upper_deg=upper))


def test_a_degree_is_kept_from_the_limits_of_the_robot_or_of_the_scenario() -> None:
    lower, upper = _limits(settings(), ARM)
    assert np.rad2deg(lower) == pytest.approx(LOWER + 1.0)
    assert np.rad2deg(upper) == pytest.approx(UPPER - 1.0)
    lower, upper = _limits(settings([-30.0] * 6, [20.0, 30.0, 40.0, 50.0, 60.0, 70.0]), ARM)
    assert np.rad2deg(lower) == pytest.approx(np.full(6, -29.0))
    assert np.rad2deg(upper) == pytest.approx([19.0, 29.0, 39.0, 49.0, 59.0, 69.0])
    assert _limits(settings(list(LOWER), list(UPPER)), ARM)[0] == pytest.approx(
        _limits(settings(), ARM)[0]
    )


def test_limits_that_are_not_of_this_robot_are_refused() -> None:
    beyond = list(UPPER)
    beyond[3] += 5.0
    for wrong, why in (
        (settings([0.0] * 5), r"poses.axis_lower_deg: 5 angles, but .* has 6 axes"),
        (
            settings(None, beyond),
            rf"axis_upper_deg: {beyond[3]:g} deg of axis 4 is beyond .* {UPPER[3]:g}",
        ),
        (settings(list(LOWER - 1.0)), r"axis_lower_deg: .* of axis 1 is beyond"),
        (settings([0.0] * 6, [2.0] * 6), "leave axis 1 no range; 2 deg are kept"),
    ):
        with pytest.raises(InputError, match=why):
            _limits(wrong, ARM)
    assert (np.diff(_limits(settings([0.0] * 6, [2.1] * 6), ARM), axis=0) > 0.0).all()
