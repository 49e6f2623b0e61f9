"""Inverse kinematics of a point: it arrives within the limits, or is stated not to."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.chain import Chain
from ballbar.cell.load import load_robot
from ballbar.cell.numerical_inverse import point_columns, reach_points
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes

POINT = np.array([0.05, -0.02, 0.12])


def chain_of(name: str) -> Chain:
    robot = load_robot(name)
    return Chain(robot.a, robot.d, robot.alpha, robot.theta, np.zeros(robot.joints))


@pytest.mark.parametrize("name", ["irb2400", "ur10e", "panda"])
def test_the_point_comes_to_its_place_within_the_limits_of_the_axes(name: str) -> None:
    robot, chain, rng = load_robot(name), chain_of(name), np.random.default_rng(3)
    q = controller_to_joints(
        robot, rng.uniform(robot.axis_lower, robot.axis_upper, (120, robot.joints))
    )
    reachable, _ = point_columns(chain, POINT, q)
    start = q[rng.permutation(len(q))]
    limits = {"lower": robot.axis_lower, "upper": robot.axis_upper}
    found, reached = reach_points(robot, chain, point=POINT, q=start, wanted=reachable, **limits)
    assert reached.mean() > 0.5, "from starts anywhere; the others are stuck at limits"
    place, _ = point_columns(chain, POINT, found[reached])
    assert np.abs(place - reachable[reached]).max() < 1e-9
    axes = joints_to_axes(robot, found)
    assert (axes >= robot.axis_lower - 1e-12).all()
    assert (axes <= robot.axis_upper + 1e-12).all()


def test_a_place_beyond_the_arm_is_not_reached() -> None:
    robot = load_robot("irb120")
    limits = {"lower": robot.axis_lower, "upper": robot.axis_upper}
    wanted = np.array([[3.0, 0.0, 0.5]])
    _, reached = reach_points(
        robot, chain_of("irb120"), point=POINT, q=np.zeros((1, 6)), wanted=wanted, **limits
    )
    assert not reached.any()


def test_an_arm_that_differs_from_the_chain_is_brought_there_as_it_is() -> None:
    robot, chain = load_robot("panda"), chain_of("panda")
    limits = {"lower": robot.axis_lower, "upper": robot.axis_upper}
    bent = Chain(chain.a + 1e-3, chain.d - 1e-3, chain.alpha, chain.theta + 1e-3, chain.beta)
    start = np.tile(0.5 * (robot.axis_lower + robot.axis_upper), (1, 1))
    wanted = point_columns(chain, POINT, start)[0] + [[0.05, -0.1, 0.02]]
    q, reached = reach_points(
        robot,
        chain,
        point=POINT,
        q=start,
        wanted=wanted,
        position=lambda angles: point_columns(bent, POINT, angles)[0],
        **limits,
    )
    assert reached.all()
    assert np.abs(point_columns(bent, POINT, q)[0] - wanted).max() < 1e-9


def test_the_columns_are_the_derivatives_of_the_place() -> None:
    chain, rng = chain_of("ur5e"), np.random.default_rng(0)
    q = rng.uniform(-2.0, 2.0, (5, 6))
    _, columns = point_columns(chain, POINT, q)
    for j in range(6):
        step = 1e-6 * np.eye(6)[j]
        moved = point_columns(chain, POINT, q + step)[0] - point_columns(chain, POINT, q - step)[0]
        assert columns[:, :, j] == pytest.approx(moved / 2e-6, abs=1e-8)
