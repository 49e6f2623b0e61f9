"""Axis angles from a pose and its configuration data, and new data after a correction."""

from __future__ import annotations

import itertools
from contextlib import suppress

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.load import load_robot
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.compensation.configurations import axes_of_pose, configuration_changes
from ballbar.compensation.frames import angles_near, pose_of_angles
from ballbar.compensation.program_source import MoveSetup, ProgramTarget
from ballbar.compensation.program_text import Number, ProgramError
from tests.helpers.programs import flange


def target_of(*configuration: object) -> ProgramTarget:
    """A target of quadrants and cfx, or of S and T."""
    numbers = tuple(Number(str(v), k, k, 1) for k, v in enumerate(configuration))
    rotation = "zyx" if len(numbers) == 2 else "quaternion"
    return ProgramTarget("p", 1, (), rotation, MoveSetup(), numbers)  # type: ignore[arg-type]


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("border", [-180.0, -90.0, 0.0, 90.0])
def test_a_quadrant_is_left_only_for_that_of_an_axis_that_moved_beyond_it(
    place: int, border: float
) -> None:
    robot = load_robot("irb2400")
    offsets, axis = (-0.1, -1e-3, -1e-6, 0.0, 1e-6, 1e-3, 0.1), (0, 3, 5)[place]
    before, after = (np.array([20.0, 10.0, 5.0, 30.0, 40.0, 50.0]) for _ in range(2))
    for quadrant in (int(border // 90.0) - 1, int(border // 90.0)):
        data = [int(v // 90.0) for v in before[[0, 3, 5]]]
        data[place] = quadrant
        target = target_of(*data, 0)
        for start, end in itertools.product(offsets, offsets):
            before[axis], after[axis] = border + start, border + end
            changes = configuration_changes(robot, target, before, after)
            stays = 90.0 * quadrant <= after[axis] <= 90.0 * (quadrant + 1)
            if stays or abs(end - start) <= 1e-6:
                assert changes == []
            else:
                assert changes == [(target.configuration[place], str(int(after[axis] // 90.0)))]


def test_a_turn_of_a_robot_without_errors_stays_with_axes_at_zero() -> None:
    robot, axes = load_robot("kr10_r1100"), np.array([10.0, -80.0, 95.0, 1e-9, 60.0, 0.0])
    for given in ("2", "10", "'B101010'"):
        assert configuration_changes(robot, target_of(2, given), axes, axes - 2e-7) == []


@pytest.mark.parametrize("name", ["kr10_r1100", pytest.param("kr210", marks=pytest.mark.slow)])
def test_every_posture_of_a_kuka_robot_is_found_from_its_status_and_turn(name: str) -> None:
    """Regression: the search missed 10 of these 200 of the KR 10; one S took the other elbow."""
    robot, rng = load_robot(name), np.random.default_rng(1)
    drawn = np.degrees(rng.uniform(robot.axis_lower, robot.axis_upper, (200, 6)))
    for axes in drawn:
        front, behind = _in_front(robot, axes), _behind(robot, axes)
        turn = int(((axes < 0.0) * 2 ** np.arange(6)).sum())
        for status in (behind + 2 * front + 4 * (axes[4] >= 0.0), behind + 2 * (not front)):
            target = target_of(int(status), turn)
            if bool(status & 2) == front:
                solved = axes_of_pose(robot, flange(robot, axes), target)
                np.testing.assert_allclose(solved, axes, atol=1e-5)
                continue
            with suppress(ProgramError):
                other = axes_of_pose(robot, flange(robot, axes), target)
                assert _in_front(robot, other) is not front, "the other elbow, as stated"


def test_cfx_tells_elbow_up_from_elbow_down_where_quadrants_do_not() -> None:
    """Both elbows of an IRB 120 are often within range and in the same quadrants."""
    robot, rng = load_robot("irb120"), np.random.default_rng(2)
    drawn = rng.uniform(robot.axis_lower, robot.axis_upper, (60, 6))
    distinguished = 0
    for axes in np.degrees(drawn):
        quadrants = [int(np.floor(axes[i] / 90.0)) for i in (0, 3, 5)]
        solutions = []
        for cfx in range(8):
            with suppress(ProgramError):
                solved = axes_of_pose(robot, flange(robot, axes), target_of(*quadrants, cfx))
                solutions.append(tuple(solved.round(3)))
        if len(set(solutions)) < 2 or len(solutions) < 8:
            continue
        cfx = 4 * _behind(robot, axes) + 2 * (not _in_front(robot, axes)) + (axes[4] < 0.0)
        np.testing.assert_allclose(solutions[cfx], axes, atol=2e-3)
        distinguished += 1
    assert distinguished > 1


def _joints_of(robot: Robot, axes: Array) -> tuple[Array, Array, Array]:
    """Shoulder, elbow and wrist, turned into the plane of the arm."""
    q = controller_to_joints(robot, np.radians(axes))[None]
    points = forward(nominal_chain(robot), q).origin[[1, 2, 4], :, 0]
    plane = points[:, :2] @ [np.cos(q[0, 0]), np.sin(q[0, 0])]
    shoulder, elbow, wrist = np.column_stack((plane, points[:, 2]))
    return shoulder, elbow, wrist


def _in_front(robot: Robot, axes: Array) -> bool:
    shoulder, elbow, wrist = _joints_of(robot, axes)
    upper, reach = elbow - shoulder, wrist - shoulder
    return bool(upper[1] * reach[0] - upper[0] * reach[1] > 0.0)


def _behind(robot: Robot, axes: Array) -> bool:
    return bool(_joints_of(robot, axes)[2][0] < 0.0)


def test_turns_about_z_y_x_stay_near_those_given_also_where_a_and_c_are_alike() -> None:
    for given in (
        [10.0, 20.0, 30.0],
        [190.0, 160.0, 210.0],
        [-170.0, 90.0, 20.0],
        [5.0, -90.0, 0.0],
    ):
        np.testing.assert_allclose(
            angles_near(pose_of_angles([0.0, 0.0, 0.0, *given]), given), given, rtol=0.0, atol=1e-5
        )
