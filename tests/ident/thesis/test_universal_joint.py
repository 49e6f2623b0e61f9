"""The universal joint's angles against those that the robot's pose asks for (thesis eq. 2.3)."""

from __future__ import annotations

import numpy as np

from cell.geometry import Geometry, parameter_screw
from ident.estimator.closure import close_loop
from ident.thesis.universal_joint import universal_joint_angles, universal_joint_columns
from tests.helpers.six_axes import PARAMETERS
from tests.helpers.synthetic_recording import Loop


def test_where_the_loop_closes_nothing_is_left_of_both_angles(
    nominal: Geometry, loop: Loop
) -> None:
    error = universal_joint_angles(close_loop(nominal, loop.q, loop.b)).error
    assert np.abs(np.sin(error)).max() < 1e-12
    assert (np.cos(error) > 0.0).all()


def test_a_joint_that_is_turned_shows_in_its_own_angle_alone(nominal: Geometry, loop: Loop) -> None:
    for k, turn in ((0, 0.1), (1, -0.2)):
        b = loop.b.copy()
        b[:, 3 + k] += turn
        error = universal_joint_angles(close_loop(nominal, loop.q, b)).error
        assert np.abs(np.sin(error[k]) - np.sin(turn)).max() < 1e-12
        assert np.abs(np.sin(error[1 - k])).max() < 1e-12


def test_both_configurations_of_the_joint_close_the_same_loop(
    nominal: Geometry, loop: Loop
) -> None:
    """b4 on the other side of zero and b5 half a turn on hold the rod in the same direction."""
    b = loop.b.copy()
    b[:, 3], b[:, 4] = -b[:, 3], b[:, 4] + np.pi
    found = universal_joint_angles(close_loop(nominal, loop.q, b))
    assert np.abs(np.sin(found.error)).max() < 1e-12
    assert (found.side == -universal_joint_angles(close_loop(nominal, loop.q, loop.b)).side).all()


def test_rows_behind_the_gimbal_move_only_their_own_angle(nominal: Geometry, loop: Loop) -> None:
    angles = universal_joint_angles(close_loop(nominal, loop.q, loop.b))
    for name, expected in (("btheta4", [1, 0]), ("btheta5", [0, 1]), ("ba4", [0, 0])):
        parameter = next(p for p in PARAMETERS if p.name == name)
        motion = parameter_screw(nominal, angles.closure.robot, angles.closure.bar, parameter)
        columns = universal_joint_columns(angles, parameter, motion)
        assert np.array_equal(columns, np.outer(expected, np.ones(9)))
