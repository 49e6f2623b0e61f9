"""Targets that bring an identified robot to where the nominal one would have gone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, robot_frames
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes
from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.inverse_calibration import TargetError, corrected_targets
from tests.helpers.simulated_recordings import perturbed
from tests.helpers.synthetic_recording import minute


@pytest.fixture(scope="module")
def targets() -> Array:
    """Poses of the minute, which is away from singularities and the ends of the axes."""
    return minute().q[::30]


@pytest.fixture(scope="module")
def identified(cell: Cell, nominal: Geometry) -> IdentifiedRobot:
    """Millimetres off, elastic, with ripple."""
    corrections = tuple(
        CORRECTIONS[name](cell, ()) for name in ("joint_compliance", "gear_backlash", "gear_ripple")
    )
    coefficients = [c for correction in corrections for c in correction.coefficients]
    values = np.array([c.mean + 0.5 * c.sigma for c in coefficients])
    off = perturbed(nominal, np.random.default_rng(111), 1e-3)
    return IdentifiedRobot(cell, off, corrections, values)


def test_the_corrected_robot_stands_at_the_nominal_pose(
    identified: IdentifiedRobot, nominal: Geometry, targets: Array
) -> None:
    found = corrected_targets(identified, nominal.robot, targets)
    wanted = robot_frames(nominal, targets)
    actual = robot_frames(identified.geometry, identified.joints(found.q))
    # 1e-11 rad of the last Newton step; what gears do differently by less than 1 % a turn is gone
    assert np.abs(actual.tip - wanted.tip).max() < 1e-9
    assert np.abs(actual.rotation() - wanted.rotation()).max() < 1e-9
    assert found.position_after.max() < 1e-9
    assert found.angle_after.max() < 1e-9


def test_the_errors_before_are_those_of_the_identified_robot_at_the_nominal_target(
    identified: IdentifiedRobot, nominal: Geometry, targets: Array
) -> None:
    found = corrected_targets(identified, nominal.robot, targets)
    wanted = robot_frames(nominal, targets)
    actual = robot_frames(identified.geometry, identified.joints(targets))
    assert found.position_before == pytest.approx(np.linalg.norm(actual.tip - wanted.tip, axis=0))
    cosine = 0.5 * (np.einsum("ijn,ijn->n", actual.rotation(), wanted.rotation()) - 1.0)
    assert found.angle_before == pytest.approx(np.arccos(cosine), rel=1e-6)
    assert found.position_before.min() > 1e-4


def test_a_nominal_robot_keeps_its_targets(cell: Cell, nominal: Geometry, targets: Array) -> None:
    found = corrected_targets(IdentifiedRobot(cell, nominal), nominal.robot, targets)
    assert found.q == pytest.approx(targets, abs=1e-12)
    assert found.position_before.max() < 1e-12


def test_rows_that_cannot_be_corrected_are_all_named(
    cell: Cell, identified: IdentifiedRobot, nominal: Geometry, targets: Array
) -> None:
    robot, bad = cell.robot, targets[:5].copy()
    bad[1, 0] += robot.axis_upper[0] + 0.1 - joints_to_axes(robot, bad)[1, 0]
    bad[3, 4] = 0.0  # the wrist is straight
    with pytest.raises(TargetError) as caught:
        corrected_targets(identified, nominal.robot, bad)
    faults = caught.value.faults
    assert set(faults) == {1, 3}
    assert "axis 1 of the given target is" in faults[1]
    assert "outside its range of" in faults[1]
    assert "singularity or at the edge of its reach" in faults[3]
    assert "joint 5 stands at 0.0 deg" in faults[3]
    assert str(caught.value).startswith("target 1: axis 1")


def test_a_correction_that_leaves_the_range_is_refused(
    cell: Cell, identified: IdentifiedRobot, nominal: Geometry, targets: Array
) -> None:
    """A target just inside its range, whose correction lies outside."""
    robot, free = cell.robot, corrected_targets(identified, nominal.robot, targets[:1]).q[0]
    turn = np.sign(free[0] - targets[0, 0])  # of the first axis, the others stay
    edge = targets[:1].copy()
    limit = robot.axis_upper if turn > 0.0 else robot.axis_lower
    edge[0, 0] += limit[0] - joints_to_axes(robot, edge)[0, 0] - turn * 1e-7
    with pytest.raises(TargetError, match="of the corrected target"):
        corrected_targets(identified, nominal.robot, edge)


def test_five_axes_cannot_keep_a_whole_pose(nominal: Geometry) -> None:
    five = cast(IdentifiedRobot, SimpleNamespace(robot=SimpleNamespace(title="Five", joints=5)))
    with pytest.raises(InputError, match="Five: 5 axes cannot keep a whole pose"):
        corrected_targets(five, nominal.robot, np.zeros((1, 5)))


def test_the_axis_that_is_furthest_outside_its_range_is_named(
    cell: Cell, identified: IdentifiedRobot, nominal: Geometry, targets: Array
) -> None:
    robot = cell.robot
    axes = joints_to_axes(robot, targets[:1])
    axes[0, 0], axes[0, 3] = robot.axis_lower[0] - 0.09, robot.axis_upper[3] + 0.02
    with pytest.raises(TargetError, match="axis 1 of the given target is"):
        corrected_targets(identified, nominal.robot, controller_to_joints(robot, axes))
