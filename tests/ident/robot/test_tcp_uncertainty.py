"""The stated uncertainty of the tool, in parts, against robots drawn from the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, robot_frames
from ballbar.cell.statistics import rms
from ballbar.ident.robot.accuracy import accuracy_grid, tcp_error
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.tcp_uncertainty import (
    SCALE,
    TcpUncertainty,
    parts_without_scale,
    scale_direction,
    tcp_uncertainty,
)
from ballbar.ident.robot.tool_covariance import ToolCovariance
from tests.helpers.six_axes import INDEX
from tests.helpers.synthetic_recording import CELL

NAMES = ("ra2", "rd4", "rtheta3", "ralpha4", "ra6", "rd1")
DRAWS = 2000  # a mean square then scatters by about 3 %


@pytest.fixture(scope="module")
def root() -> Array:
    return np.random.default_rng(94).normal(0.0, 1e-5, (len(NAMES), len(NAMES)))


@pytest.fixture(scope="module")
def grid() -> Array:
    return accuracy_grid(CELL.robot)[::20]


@pytest.fixture(scope="module")
def stated(nominal: Geometry, grid: Array, root: Array) -> TcpUncertainty:
    robot, parameters = IdentifiedRobot(CELL, nominal), np.array([INDEX[n] for n in NAMES])
    moves = robot.jacobian(grid, parameters)
    return tcp_uncertainty(robot.tool(grid), moves, root @ root.T, NAMES)


@pytest.fixture(scope="module")
def drawn(nominal: Geometry, grid: Array, root: Array) -> tuple[Array, Array, Array]:
    """Errors of drawn robots (D, G) [m] with scale and without, and their parts along it (D,)."""
    parameters, rng = [INDEX[n] for n in NAMES], np.random.default_rng(95)
    errors, without = [], []
    for z in rng.standard_normal((DRAWS, len(NAMES))):
        values = nominal.values.copy()
        values[parameters] += root @ z
        off = tcp_error(nominal.with_values(values), nominal, grid)
        errors.append(off.error)
        without.append(off.error_without_scale)
    square = (np.square(errors) - np.square(without)).mean(axis=1)
    return np.array(errors), np.array(without), square


def test_the_squares_of_parts_of_the_covariance_add_up(
    nominal: Geometry, grid: Array, root: Array, stated: TcpUncertainty
) -> None:
    robot = IdentifiedRobot(CELL, nominal)
    tool, moves = robot.tool(grid), robot.jacobian(grid, np.array([INDEX[n] for n in NAMES]))
    halves = (root[:, ::2] @ root[:, ::2].T, root[:, 1::2] @ root[:, 1::2].T)
    parts = parts_without_scale(tool, moves, *halves)
    assert np.hypot(*parts) == pytest.approx(rms(stated.without_scale))


def test_both_figures_are_the_spread_of_drawn_robots(
    stated: TcpUncertainty, drawn: tuple[Array, Array, Array]
) -> None:
    """Robots by full kinematics, aligned by Kabsch and Umeyama; 10 % at a single pose."""
    errors, without, _ = drawn
    assert np.sqrt((errors**2).mean(axis=0)) == pytest.approx(stated.sigma, rel=0.1)
    assert np.sqrt((without**2).mean(axis=0)) == pytest.approx(stated.without_scale, rel=0.1)


def test_the_share_of_the_scale_is_that_of_drawn_robots(
    stated: TcpUncertainty, drawn: tuple[Array, Array, Array]
) -> None:
    errors, _, square = drawn
    (scale,) = (d for d in stated.directions if d.name == SCALE)
    share = square.mean() / (errors**2).mean()
    assert 0.02 < share < 0.98  # or the test would say nothing
    assert stated.share(scale) == pytest.approx(share, rel=0.1)


def test_the_shares_of_all_directions_add_up(stated: TcpUncertainty) -> None:
    """But for those left out, a thousandth in all."""
    shares = [stated.share(d) for d in stated.directions]
    assert 0.999 <= sum(shares) <= 1.0 + 1e-12
    assert shares == sorted(shares, reverse=True)


def test_one_uncertain_parameter_is_a_direction_of_its_own(nominal: Geometry, grid: Array) -> None:
    robot = IdentifiedRobot(CELL, nominal)
    moves = robot.jacobian(grid, np.array([INDEX["ralpha4"], INDEX["rd1"]]))
    stated = tcp_uncertainty(robot.tool(grid), moves, np.diag([1e-10, 1.0]), ("ralpha4", "rd1"))
    without = [d for d in stated.directions if d.name != SCALE]
    assert [d.members for d in without] == [(("ralpha4", pytest.approx(1.0)),)]


def test_an_uncertain_scale_is_all_gone_without_it(nominal: Geometry, grid: Array) -> None:
    positions = robot_frames(nominal, grid).tip.T
    stated = tcp_uncertainty(positions, positions.T[None], np.full((1, 1), 1e-10), ("factor",))
    reach = np.linalg.norm(positions - positions.mean(axis=0), axis=1)
    assert stated.sigma == pytest.approx(1e-5 * reach)
    assert stated.without_scale.max() < 1e-12
    assert [(d.name, d.members) for d in stated.directions] == [
        (SCALE, (("factor", pytest.approx(1.0)),))
    ]
    along = scale_direction(positions).reshape(-1, 3)
    assert np.abs(np.cross(along, positions - positions.mean(axis=0))).max() < 1e-12


def test_a_doubt_adds_to_both_figures_and_to_the_directions(
    stated: TcpUncertainty, nominal: Geometry, grid: Array
) -> None:
    bent = nominal.replaced({"rtheta3": nominal["rtheta3"] + 3e-4})
    doubt = tcp_error(bent, nominal, grid)
    doubted = stated.with_doubt(doubt, 0.5)
    assert doubted.sigma**2 - stated.sigma**2 == pytest.approx(0.25 * doubt.error**2)
    added = doubted.without_scale**2 - stated.without_scale**2
    assert added == pytest.approx(0.25 * doubt.error_without_scale**2)
    largest = doubted.directions[0]
    assert largest.rms == pytest.approx(0.5 * rms(doubt.error))
    assert sum(doubted.share(d) for d in doubted.directions) == pytest.approx(1.0, abs=1e-3)


def test_what_has_no_tolerance_is_exact_already() -> None:
    """A telescoping bar whose file states none once made the covariance of all unknowns nan."""
    values = np.diag([4.0, 9.0, 0.0, 1.0])
    values[0, 3] = values[3, 0] = 1.0  # the unknown goes with the second of the held
    tool = ToolCovariance(("ra2", "ra3"), np.zeros((0, 28)), values, held=("bd3", "ra6"))
    np.testing.assert_allclose(tool.of_names, np.diag([3.0, 9.0]))
