"""The universal joint's angles against those that the robot's pose asks for (thesis eq. 2.3)."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, Parameter, bar_frames, parameter_screw, robot_frames
from ballbar.cell.inverse import UnreachableError, bar_angles
from ballbar.ident.estimator.closure import Closure, close_loop
from ballbar.ident.thesis.universal_joint import universal_joint_angles, universal_joint_columns
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


def test_the_angles_are_those_of_the_ballbars_inverse_kinematics(
    nominal: Geometry, loop: Loop
) -> None:
    """Eq. 2.3: b4hat, b5hat come from the robot's pose alone, whatever b1 and b2 were measured."""
    poses = robot_frames(nominal, loop.q).poses()
    b = loop.b + np.random.default_rng(3).uniform(-0.1, 0.1, loop.b.shape)
    flipped = bool((np.sin(b[:, 1]) < 0.0).all()), bool((np.sin(b[:, 3]) < 0.0).all())
    predicted = bar_angles(poses, nominal.origin, flipped=flipped)
    angles = universal_joint_angles(close_loop(nominal, loop.q, b))
    expected = b[:, 3:] + nominal.bar.theta[3:] - predicted[:, 3:]
    assert np.abs(np.sin(angles.error.T - expected)).max() < 1e-12


def test_a_rod_along_the_first_axis_is_refused(nominal: Geometry, loop: Loop) -> None:
    b = loop.b.copy()
    b[0, 1] = 0.0
    frames = bar_frames(nominal, b)
    with pytest.raises(UnreachableError, match="the rod lies along its first axis"):
        universal_joint_angles(Closure(nominal, frames, frames, np.empty((6, 0))))


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


@pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda p: p.name)
def test_the_columns_are_the_central_differences_of_the_error(
    nominal: Geometry, loop: Loop, parameter: Parameter
) -> None:
    b = loop.b + np.random.default_rng(5).uniform(-0.02, 0.02, loop.b.shape)
    step = 1e-6  # [m, rad] rounding leaves 1e-10 of the quotient, curvature 1e-11

    def error(sign: float) -> Array:
        changed = nominal.replaced({parameter.name: nominal[parameter.name] + sign * step})
        return universal_joint_angles(close_loop(changed, loop.q, b)).error

    difference = error(1.0) - error(-1.0)
    expected = np.angle(np.exp(1j * difference)) / (2.0 * step)
    angles = universal_joint_angles(close_loop(nominal, loop.q, b))
    motion = parameter_screw(nominal, angles.closure.robot, angles.closure.bar, parameter)
    motion = -motion if parameter.side == "robot" else motion
    columns = universal_joint_columns(angles, parameter, motion)
    assert columns == pytest.approx(expected, abs=1e-7 * max(1.0, np.abs(expected).max()))
