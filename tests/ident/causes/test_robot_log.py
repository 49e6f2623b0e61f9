"""Mistakes in the robot's log as affine maps of its joint angles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.load import load_robot
from ballbar.cell.robot_angles import (
    controller_to_joints,
    joints_to_axes,
    joints_to_motors,
    motors_to_joints,
)
from ballbar.ident.causes.robot_log import other_angles

Q = np.random.default_rng(4).uniform(-1.0, 1.0, (20, 6))
LOG = "the robot's log"


@pytest.fixture(scope="module", params=["irb2400", "ur10"])
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


def test_every_mistake_has_a_correction_of_its_own(robot: Robot) -> None:
    mistakes = other_angles(robot)
    assert len({mistake.cause for mistake in mistakes}) >= 6 + 15 + 2  # signs, pairs, units
    for a, b in combinations([mistake.joints(Q) for mistake in mistakes], 2):
        assert np.abs(a - b).max() > 1e-6
    assert all(np.abs(mistake.joints(Q) - Q).max() > 1e-6 for mistake in mistakes)


@pytest.mark.parametrize(
    ("cause", "read"),
    [
        (f"{LOG} is in degrees and was read as rad", lambda _: np.rad2deg(Q)),
        (f"{LOG} is in rad and was read as degrees", lambda _: np.deg2rad(Q)),
        (
            f"{LOG} holds motor angles, and was read otherwise",
            lambda robot: controller_to_joints(robot, joints_to_motors(robot, Q)),
        ),
        (
            f"{LOG} holds joint angles in degrees, and was read otherwise",
            lambda robot: motors_to_joints(robot, np.rad2deg(Q)),
        ),
    ],
)
def test_angles_of_another_kind_or_unit_are_corrected(
    cause: str, read: Callable[[Robot], Array]
) -> None:
    robot = load_robot("irb2400")
    corrected = [m.joints(read(robot)) for m in other_angles(robot) if m.cause == cause]
    assert min(np.abs(q - Q).max() for q in corrected) < 1e-9  # rounding of inverses


def test_an_axis_that_counts_backwards_does_so_about_its_own_zero() -> None:
    robot = replace(
        load_robot("irb2400"), controller_offset=np.array([0.0, -0.5, 0.3, 0.0, 0.2, 0.0])
    )
    backwards = joints_to_axes(robot, Q) * np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0])
    read = controller_to_joints(robot, backwards)
    (mistake,) = [m for m in other_angles(robot) if m.cause.startswith("axis 2")]
    np.testing.assert_allclose(mistake.joints(read), Q, atol=1e-12)
