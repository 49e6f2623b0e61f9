"""The loop-closure error: its derivatives, and where joints without encoder start."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, nominal_geometry, robot_frames
from ballbar.cell.load import load_plate, load_robot, load_telescoping_bar
from ballbar.cell.rotation import matrix_from_rotvec, rotvec_from_matrix
from ballbar.ident.estimator.closure import (
    bar_joint_jacobian,
    beside_rod,
    close_loop,
    complete_bar_angles,
    parameter_jacobian,
    pointing_bar,
    robot_joint_jacobian,
    runs_of_one_side,
)
from ballbar.ident.estimator.whitening import covariance, whitening
from tests.helpers.six_axes import NAMES, PARAMETERS
from tests.helpers.synthetic_recording import Loop

STEP = 1e-6  # central differences: truncation 1e-12, cancellation 1e-10
# The error may be tenths of a radian here, so the third derivatives are of order 10.
TOLERANCE = 2e-8


def central(error: Callable[[float], Array]) -> Array:
    return (error(STEP) - error(-STEP)) / (2 * STEP)


def test_the_error_is_zero_where_both_chains_meet(nominal: Geometry, loop: Loop) -> None:
    assert np.abs(close_loop(nominal, loop.q, loop.b).error).max() < 1e-12


def test_parameter_jacobian_is_the_central_difference_of_the_signed_error(loop: Loop) -> None:
    columns = parameter_jacobian(loop.closure, PARAMETERS)
    for column, name in zip(columns, NAMES, strict=True):
        value = loop.geometry[name]
        numeric = central(
            lambda h, name=name, value=value: (
                close_loop(loop.geometry.replaced({name: value + h}), loop.q, loop.b).error
            )
        )
        assert np.abs(column - numeric).max() < TOLERANCE, name


def test_joint_jacobians_are_central_differences_too(loop: Loop) -> None:
    geometry, q, b = loop.geometry, loop.q, loop.b
    for j, column in enumerate(robot_joint_jacobian(loop.closure)):
        numeric = central(lambda h, j=j: close_loop(geometry, q + h * np.eye(6)[j], b).error)
        assert np.abs(column - numeric).max() < TOLERANCE
    for j, column in enumerate(bar_joint_jacobian(loop.closure)):
        numeric = central(lambda h, j=j: close_loop(geometry, q, b + h * np.eye(5)[j]).error)
        assert np.abs(column - numeric).max() < TOLERANCE
    numeric = central(
        lambda h: close_loop(geometry.replaced({"bd3": geometry["bd3"] + h}), q, b).error
    )
    assert np.abs(loop.closure.rod_column - numeric).max() < TOLERANCE


def test_the_plate_bends_about_a_hinge_a_third_of_its_length_from_the_sixth_axis(
    loop: Loop,
) -> None:
    closure = loop.closure
    robot, bar = robot_frames(loop.geometry, loop.q), closure.bar
    hinge = robot.tip - 2.0 / 3.0 * loop.geometry["ra6"] * robot.x[-1]

    def error(angle: float) -> Array:
        bend = matrix_from_rotvec(angle * robot.y[-1])
        tip = hinge + np.einsum("ijn,jn->in", bend, robot.tip - hinge)
        turned = np.einsum("ijn,jkn->ikn", bend, robot.rotation())
        relative = np.einsum("ikn,jkn->ijn", bar.rotation(), turned)
        return np.concatenate((bar.tip - tip, rotvec_from_matrix(relative)))

    # The column neglects that a loop which is open by tenths of a radian turns: closed, it is
    # exact.
    assert np.abs(closure.plate_column[:3] - central(error)[:3]).max() < TOLERANCE


def test_the_plates_column_is_exact_where_the_loop_is_closed(nominal: Geometry, loop: Loop) -> None:
    """A bent plate turns the tool by the bending angle about its own y axis."""
    closure = close_loop(nominal, loop.q, loop.b)
    assert closure.plate_column[3:] == pytest.approx(-closure.robot.y[-1], abs=1e-15)


def test_neighbours_of_one_side_are_one_run() -> None:
    names = ["ra1", "rd2", "bd3", "ox", "rtheta1"]
    parameters = [PARAMETERS[NAMES.index(name)] for name in names]
    assert list(runs_of_one_side(parameters)) == [(0, 2, True), (2, 4, False), (4, 5, True)]
    assert list(runs_of_one_side([])) == []


def test_part_of_a_closure_is_the_closure_of_those_samples(loop: Loop) -> None:
    part = loop.closure.part(slice(2, 5))
    again = close_loop(loop.geometry, loop.q[2:5], loop.b[2:5])
    assert np.array_equal(part.error, again.error)
    assert np.array_equal(
        parameter_jacobian(part, PARAMETERS), parameter_jacobian(again, PARAMETERS)
    )


@pytest.mark.parametrize("joints", [(), (1, 2), (1, 2, 4, 5), (4, 5)])
def test_unmeasured_joints_of_an_ideal_ball_bar_follow_from_the_robot(
    nominal: Geometry, loop: Loop, joints: tuple[int, ...]
) -> None:
    measured = loop.b[:, [j - 1 for j in joints]]
    filled = complete_bar_angles(nominal, loop.q, measured, joints)
    assert np.abs(close_loop(nominal, loop.q, filled).error).max() < 1e-10


def test_unmeasured_joints_are_stated_as_their_encoders_would_read(
    nominal: Geometry, loop: Loop
) -> None:
    """The offsets are parameters of the geometry: the angle less its offset closes the loop."""
    offset = nominal.replaced({"btheta3": 0.4, "btheta5": -1.1})
    read = loop.b - np.array([0.0, 0.0, 0.4, 0.0, -1.1])
    filled = complete_bar_angles(offset, loop.q, read[:, :2], (1, 2))
    assert np.abs(close_loop(offset, loop.q, filled).error).max() < 1e-10


CELL = Cell(load_robot("irb2400"), load_telescoping_bar("drawwire_2m"), load_plate("plate_250"))
SEAT = np.array([0.4, -0.8, 0.1])
GEOMETRY = nominal_geometry(CELL, SEAT)
Q = np.random.default_rng(1).uniform(-0.6, 0.6, (40, 6))
EXTENSION = np.random.default_rng(2).uniform(-0.4, 0.4, 40)


def length_error(geometry, q: np.ndarray = Q) -> np.ndarray:
    """(N,) [m] sensed length minus the distance that the robot predicts."""
    distance = np.linalg.norm(robot_frames(geometry, q).tip.T - geometry.origin, axis=1)
    return geometry["bd3"] + EXTENSION - distance


def test_the_loop_is_open_along_the_rod_alone() -> None:
    closure = close_loop(GEOMETRY, Q, pointing_bar(GEOMETRY, Q, EXTENSION))
    rod = closure.bar.z[2]
    np.testing.assert_allclose(closure.error[:3], length_error(GEOMETRY) * rod, atol=1e-14)
    np.testing.assert_allclose(closure.error[3:], 0.0, atol=1e-14)


def test_what_the_unsensed_joints_move_is_beside_the_rod() -> None:
    """The same five directions, where the joints' own columns have them all."""
    closure = close_loop(GEOMETRY, Q, pointing_bar(GEOMETRY, Q, EXTENSION))
    joints, beside = bar_joint_jacobian(closure), beside_rod(closure)
    for k in range(len(Q)):
        both = np.concatenate((joints[:, :, k], beside[:, :, k]))
        assert np.linalg.svd(both, compute_uv=False)[5:].max() < 1e-12


@pytest.mark.parametrize("name", ["ox", "oz", "ra2", "rd4", "ralpha3", "rtheta5", "ra6", "bd3"])
def test_the_whitened_column_of_a_parameter_is_that_of_the_distance(name: str) -> None:
    """Against central differences of |p - c|, whitened by the noise of the length alone."""
    sigma, step = 1e-5, 1e-6
    closure = close_loop(GEOMETRY, Q, pointing_bar(GEOMETRY, Q, EXTENSION))
    noise = np.zeros((1, 6, len(Q)))
    noise[0, :3] = sigma * closure.bar.z[2]
    weights = whitening(covariance(noise), beside_rod(closure))
    parameter = GEOMETRY.table.parameters[GEOMETRY.table.index[name]]
    column = weights(parameter_jacobian(closure, [parameter]))[0]
    assert column.shape == (1, len(Q))
    ahead, behind = (
        length_error(GEOMETRY.replaced({name: GEOMETRY[name] + h})) for h in (step, -step)
    )
    expected = (ahead - behind) / (2.0 * step) / np.hypot(sigma, 1e-7)
    sign = np.sign(weights(closure.error)[0] * length_error(GEOMETRY))
    np.testing.assert_allclose(sign * column[0], expected, rtol=1e-4, atol=1e-2)
