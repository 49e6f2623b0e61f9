"""Loop closure of a bar whose rod is sensed: one equation a sample, along the rod."""

from __future__ import annotations

import numpy as np
import pytest

from cell.descriptions import Cell
from cell.geometry import nominal_geometry, robot_frames
from cell.load import load_plate, load_robot, load_telescoping_bar
from ident.estimator.closure import (
    bar_joint_jacobian,
    beside_rod,
    close_loop,
    parameter_jacobian,
    pointing_bar,
)
from ident.estimator.whitening import covariance, whitening

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
