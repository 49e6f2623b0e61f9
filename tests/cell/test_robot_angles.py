"""Linear maps between motor, axis and joint angles, of few rows and of many."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.load import load_robot
from ballbar.cell.robot_angles import (
    controller_to_joints,
    joints_to_axes,
    joints_to_motors,
    motors_to_joints,
)

ROBOT = load_robot("irb2400")
BLOCK = 4096  # rows that are multiplied at a time


@pytest.mark.parametrize("rows", [1, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, 2 * BLOCK + 7])
def test_many_rows_are_mapped_as_each_of_them_is(rows: int) -> None:
    """Long logs are multiplied in blocks; the last block is seldom full."""
    motors = np.random.default_rng(rows).uniform(-100.0, 100.0, (rows, 6))
    joints = motors_to_joints(ROBOT, motors)
    for k in {0, rows // 2, rows - 1}:
        assert joints[k] == pytest.approx(motors_to_joints(ROBOT, motors[k]), abs=1e-12)
    np.testing.assert_allclose(joints, motors @ ROBOT.transmission, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(joints_to_motors(ROBOT, joints), motors, rtol=0.0, atol=1e-9)


def test_columns_of_a_log_keep_their_layout_in_memory() -> None:
    """A log of hours is held column by column; a copy in rows would double its memory."""
    motors = np.asfortranarray(np.ones((BLOCK + 1, 6)))
    assert motors_to_joints(ROBOT, motors).flags.f_contiguous


def test_axis_angles_and_joint_angles_lead_back_to_each_other() -> None:
    axes = np.random.default_rng(2).uniform(-1.0, 1.0, (50, 6))
    assert joints_to_axes(ROBOT, controller_to_joints(ROBOT, axes)) == pytest.approx(axes)


def test_angles_of_another_number_of_axes_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"angles have shape \(4, 5\), expected \(N, 6\) or \(6,\)"
    ):
        motors_to_joints(ROBOT, np.zeros((4, 5)))
