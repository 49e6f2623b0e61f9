"""The test cube of ISO 9283 and the poses that a robot takes in it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.geometry import nominal_chain, robot_geometry
from ballbar.cell.load import load_robot
from ballbar.cell.numerical_inverse import dexterity
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.ident.performance import cube
from ballbar.ident.performance.cube import SIDES, cube_points, fitting_cube
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.identified_kinematics import SINGULAR, IdentifiedKinematics, kinematics


def test_five_poses_lie_on_the_diagonals_of_a_plane() -> None:
    """An edge of 1000 mm about (1, 2, 3): a tenth of a diagonal of sqrt(3) m from its end is
    0.1 m along each axis from the corners (0.5, 1.5, 2.5), (0.5, 2.5, 2.5), (1.5, 2.5, 3.5) and
    (1.5, 1.5, 3.5).
    """
    points = cube_points(1.0, np.array([1.0, 2.0, 3.0]))
    expected = [[1.0, 2.0, 3.0], [0.6, 1.6, 2.6], [0.6, 2.4, 2.6], [1.4, 2.4, 3.4], [1.4, 1.6, 3.4]]
    assert points == pytest.approx(np.array(expected), abs=1e-12)
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    assert (points - points[0]) @ normal == pytest.approx(np.zeros(5), abs=1e-12)


def nominal_robot(name: str) -> tuple[IdentifiedKinematics, IdentifiedRobot]:
    """Kinematics of a robot by its file, and the same as if it had been identified."""
    robot = load_robot(name)
    identified = IdentifiedRobot(robot, robot_geometry(robot))
    return kinematics(identified, nominal_chain(robot)), identified


@pytest.mark.parametrize("name", ["irb2400", "ur5", "kr10_r1100"])
def test_the_largest_standard_cube_that_fits_is_taken(name: str) -> None:
    nominal, identified = nominal_robot(name)
    cube = fitting_cube(nominal, identified)
    assert cube is not None
    poses = forward(nominal_chain(nominal.robot), cube.q).poses()  # not by the inverse's own error
    assert poses == pytest.approx(cube.poses, abs=1e-6)
    axes = joints_to_axes(nominal.robot, cube.q)
    assert ((axes >= nominal.robot.axis_lower) & (axes <= nominal.robot.axis_upper)).all()
    corners = cube_points(cube.side, cube.poses[0, :3, 3])
    assert cube.poses[:, :3, 3] == pytest.approx(corners, abs=1e-9)
    assert np.ptp(cube.poses[:, :3, :3], axis=0).max() < 1e-12  # one orientation
    assert dexterity(nominal_chain(nominal.robot), cube.q).min() >= SINGULAR
    centre = cube.poses[0, :3, 3]
    assert centre[2] >= 0.5 * cube.side  # on the base's side of the floor
    assert np.abs(centre[:2]).max() > 0.5 * cube.side  # the base is not in it
    larger = [side for side in SIDES if side > cube.side]
    assert all(fitting_cube(nominal, identified, side) is None for side in larger)


def test_a_cube_within_the_fitted_ranges_is_preferred() -> None:
    """Ranges that hold a smaller cube with 10 deg to spare make it the one where something is
    stated, whose poses the largest one leaves.
    """
    nominal, identified = nominal_robot("ur5")
    largest = fitting_cube(nominal, identified)
    small = fitting_cube(nominal, identified, 0.25)
    assert largest is not None
    assert small is not None
    spare = np.deg2rad(10.0)
    ranges = np.stack((small.q.min(axis=0) - spare, small.q.max(axis=0) + spare), axis=1)
    fitted = IdentifiedRobot(identified.robot, identified.geometry, ranges=ranges)
    chosen = fitting_cube(nominal, fitted)
    assert chosen is not None
    assert 0.25 <= chosen.side < largest.side
    assert fitted.covered(chosen.q).all()


def test_no_cube_of_five_metres_fits() -> None:
    assert fitting_cube(*nominal_robot("irb2400"), 5.0) is None


def test_where_no_cube_fits_the_ranges_one_that_is_asked_for_may_leave_them() -> None:
    nominal, identified = nominal_robot("ur5")
    middle = np.array([0.0, -1.2, 1.5, -1.6, -1.5, 0.3])
    ranges = np.stack((middle - 0.03, middle + 0.03), axis=1)
    fitted = IdentifiedRobot(identified.robot, identified.geometry, ranges=ranges)
    assert fitting_cube(nominal, fitted) is None
    outside = fitting_cube(nominal, fitted, 0.25)
    assert outside is not None
    assert not fitted.covered(outside.q).all()
    tiny = fitting_cube(nominal, fitted, 0.01)
    assert tiny is not None
    assert fitted.covered(tiny.q).all()


def test_five_axes_keep_no_orientation() -> None:
    assert fitting_cube(*nominal_robot("so101")) is None


def test_no_cube_reaches_below_the_base_or_holds_the_column(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Centres on either side of a tenth of the chain's length, here 2 m, before a side of 0.5 m."""

    def nearest(poses: Array, first: Array) -> SimpleNamespace:
        yes = np.ones(len(poses), dtype=bool)
        return SimpleNamespace(reached=yes, within=yes, singular=~yes, q=first)

    monkeypatch.setattr(cube, "length_of", lambda _: 2.0)
    nominal: Any = SimpleNamespace(nominal=None, nearest=nearest)
    ends = np.tile(np.eye(4), (4, 1, 1))
    ends[:, :3, 3] = [[0.46, 0, 0.26], [0.44, 0, 0.26], [0.1, -0.46, 0.26], [0.46, 0, 0.24]]
    rows, poses, q = cube._taken(nominal, ends, np.zeros(6), 0.5)
    assert rows.tolist() == [0, 2]
    assert (poses.shape, q.shape) == ((2, 5, 4, 4), (2, 5, 6))
    np.testing.assert_allclose(poses[:, 0, :3, 3], ends[rows, :3, 3])
