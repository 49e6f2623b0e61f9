"""TCP error over the held-out grid, base frames aligned, and what a covariance says of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, robot_frames
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.ident.robot.accuracy import (
    _grid_points,
    accuracy_grid,
    position_error,
    position_sigma,
    rigid_basis,
    tcp_error,
    tcp_sigma,
)
from tests.helpers.six_axes import INDEX


@pytest.mark.parametrize("joints", [5, 6, 7, 8])
def test_the_points_of_the_grid_are_those_of_scipy_to_the_last_bit(joints: int) -> None:
    sequence = qmc.Sobol(joints, scramble=True, rng=np.random.default_rng(2400))
    assert np.array_equal(_grid_points(joints), sequence.random(1024)[:800])


@pytest.fixture(scope="module")
def grid(cell: Cell) -> Array:
    return accuracy_grid(cell.robot)


def test_the_grid_is_the_same_for_everyone_and_lies_in_the_accuracy_box(
    cell: Cell, grid: Array
) -> None:
    robot = cell.robot
    assert grid.shape == (800, 6)
    assert np.array_equal(grid, accuracy_grid(robot))
    axes = joints_to_axes(robot, grid)
    assert (axes > robot.accuracy_lower - 1e-12).all()
    assert (axes < robot.accuracy_upper + 1e-12).all()
    # a Sobol sequence covers the box: means of 800 values of a uniform distribution to a percent
    middle, width = 0.5 * (robot.accuracy_lower + robot.accuracy_upper), np.ptp(axes, axis=0)
    assert np.abs((axes.mean(axis=0) - middle) / width).max() < 0.01


def test_a_base_that_stands_elsewhere_is_no_error_of_the_robot() -> None:
    rng = np.random.default_rng(91)
    points = rng.normal(0.0, 1.0, (50, 3))
    turned = Rotation.from_rotvec([0.3, -0.5, 1.1]).apply(points) + np.array([1.0, 2.0, -3.0])
    found = position_error(points, turned)
    assert found.maximum < 1e-12
    assert np.array_equal(found.position, points)


def test_a_robot_and_its_mirror_image_are_not_aligned_by_a_reflection() -> None:
    points = np.random.default_rng(92).normal(0.0, 1.0, (50, 3))
    assert position_error(points, points * np.array([1.0, 1.0, -1.0])).mean > 0.1


def test_a_scale_error_is_told_from_the_rest() -> None:
    points = np.random.default_rng(93).normal(0.0, 1.0, (50, 3))
    found = position_error(points, 1.001 * points + np.array([0.1, 0.0, 0.0]))
    centred = np.linalg.norm(points - points.mean(axis=0), axis=1)
    assert found.error == pytest.approx(1e-3 * centred, rel=1e-9)
    assert found.error_without_scale.max() < 1e-12
    assert found.mean == pytest.approx(found.error.mean())
    assert found.maximum == found.error.max()


def test_parameters_that_only_move_the_base_cost_nothing(nominal: Geometry, grid: Array) -> None:
    """rd1 lifts and rtheta1 turns the whole robot; rtheta3 moves the tool against it."""
    of = {name: nominal.replaced({name: nominal[name] + 1e-3}) for name in ("rd1", "rtheta1")}
    for off in of.values():
        assert tcp_error(off, nominal, grid).maximum < 1e-12
    bent = nominal.replaced({"rtheta3": nominal["rtheta3"] + 1e-3})
    assert tcp_error(bent, nominal, grid).mean > 1e-4


def test_the_stated_sigma_is_the_spread_of_robots_drawn_from_the_covariance(
    nominal: Geometry, grid: Array
) -> None:
    """Root mean square of the aligned error at each pose over 400 draws, 5 % of sampling error."""
    names = ["ox", "ra2", "rd4", "rtheta3", "ralpha4", "rd1"]
    parameters, rng = np.array([INDEX[name] for name in names]), np.random.default_rng(94)
    root = rng.normal(0.0, 1e-5, (6, 6))
    covariance, some = root @ root.T, grid[::20]
    stated = tcp_sigma(nominal, some, parameters, covariance)
    squares = np.zeros(len(some))
    for _ in range(400):
        values = nominal.values.copy()
        values[parameters] += root @ rng.standard_normal(6)
        squares += tcp_error(nominal.with_values(values), nominal, some).error ** 2
    assert np.sqrt(squares / 400) == pytest.approx(stated, rel=0.15)


def test_what_moves_all_points_alike_leaves_no_uncertainty(nominal: Geometry, grid: Array) -> None:
    positions = robot_frames(nominal, grid[:50]).tip.T
    shift = np.broadcast_to(np.array([1.0, 0.0, 0.0])[:, None], (3, 50))
    spin = np.cross([0.0, 0.0, 1.0], positions).T
    basis = rigid_basis(positions)
    assert basis.T @ basis == pytest.approx(np.eye(6), abs=1e-12)
    sigma = position_sigma(positions, np.stack((shift, spin)), np.eye(2))
    assert sigma.max() < 1e-7  # the root of rounding
