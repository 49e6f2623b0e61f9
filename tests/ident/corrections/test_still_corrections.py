"""Corrections of still poses: unit weights against potential energy, orders against their wave."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.chain import forward
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import nominal_chain, robot_geometry
from ballbar.cell.load import load_robot
from ballbar.ident.corrections import SUBSTITUTES, as_in_result, supported_corrections
from ballbar.ident.corrections.joint_harmonics import joint_harmonics, orders_of
from ballbar.ident.corrections.unit_weights import torques, unit_weights
from ballbar.ident.loads.at_rest import regressors_at_rest
from ballbar.ident.robot.identified import IdentifiedRobot

DOWN = np.array([0.0, 0.0, -1.0])


@pytest.mark.parametrize("name", ["ur5", "panda", "irb120"])
def test_the_torque_of_a_unit_weight_is_the_slope_of_its_height(name: str) -> None:
    """Virtual work: torque about an axis = change of `down . O_k` per radian of that joint."""
    chain = nominal_chain(load_robot(name))
    q = np.random.default_rng(3).uniform(-2.0, 2.0, (5, chain.rows))
    levers = torques(forward(chain, q), DOWN)
    step = 1e-6
    for j in range(chain.rows):
        ahead, behind = (forward(chain, q + s * np.eye(chain.rows)[j]) for s in (step, -step))
        slope = np.einsum("c,kcn->kn", DOWN, ahead.origin - behind.origin) / (2.0 * step)
        assert np.abs(levers[j] - slope[1:]).max() < 1e-9


@pytest.mark.parametrize(
    ("orders", "named", "said"),
    [
        ([(1, 17)], ["joint2_17_sin", "joint2_17_cos"], "1 is joint2_17_sin, expected joint2_17_c"),
        ([(1, 17)], ["joint2_17_cos"], "coefficient 2 is nothing, expected joint2_17_sin of robot"),
        ([(6, 2)], ["joint7_2_cos", "joint7_2_sin"], "joint7_2_cos: robot .* has 6 joints"),
    ],
)
def test_a_result_names_the_coefficients_of_its_robot_in_their_order(
    orders: list[tuple[int, float]], named: list[str], said: str
) -> None:
    """Values go by their place: in another order each would be another coefficient's."""
    with pytest.raises(InputError, match=said):
        as_in_result(joint_harmonics(orders), named, load_robot("ur5"))


def test_joints_are_counted_from_1() -> None:
    """Joint 0 was the last channel, the bending of the plate."""
    with pytest.raises(InputError, match="expected joint2_17_cos or similar"):
        orders_of(["joint0_2_cos"])


def test_every_axis_that_feels_a_weight_has_a_coefficient_and_the_vertical_one_has_none() -> None:
    correction = unit_weights(load_robot("ur5"))
    joints = {c.name[-1] for c in correction.coefficients}
    assert joints == {"2", "3", "4", "5"}  # axis 6: its frame's origin lies on it


def test_a_coefficient_is_named_after_the_frame_of_its_weight_and_the_joint_that_sags() -> None:
    robot = load_robot("ur5")
    q = np.random.default_rng(8).uniform(-2.0, 2.0, (4, 6))
    levers, correction = torques(forward(nominal_chain(robot), q), DOWN), unit_weights(robot)
    nominal = robot_geometry(robot)
    rows = [row for _, row in regressors_at_rest(robot, nominal, [correction], q)]
    for i, coefficient in enumerate(correction.coefficients):
        frame, joint = (int(part[-1]) - 1 for part in coefficient.name.split("_"))
        assert np.allclose(rows[i], levers[joint, frame])
        sagging = IdentifiedRobot(robot, nominal, (correction,), np.eye(len(rows))[i])
        sag = sagging.joints(q) - q
        assert np.allclose(sag, np.outer(rows[i], np.eye(6)[joint]))


def test_the_terms_of_an_order_are_its_cosine_and_sine() -> None:
    robot = load_robot("ur5")
    q = np.random.default_rng(5).uniform(-2.0, 2.0, (7, 6))
    correction = joint_harmonics([(1, 17)])
    nominal = robot_geometry(robot)
    rows = [row for _, row in regressors_at_rest(robot, nominal, [correction], q)]
    assert np.allclose(rows, [np.cos(17.0 * q[:, 1]), np.sin(17.0 * q[:, 1])])
    wavy = IdentifiedRobot(robot, nominal, (correction,), np.array([1e-4, 2e-4]))
    moved = wavy.joints(q) - q
    assert np.allclose(moved[:, 1], 1e-4 * rows[0] + 2e-4 * rows[1])
    assert not moved[:, [0, 2, 3, 4, 5]].any()


def test_the_names_of_coefficients_hold_the_orders() -> None:
    orders = [(1, 17), (5, 3), (0, 129.6)]
    names = [c.name for c in joint_harmonics(orders).coefficients]
    assert names[:2] == ["joint2_17_cos", "joint2_17_sin"]
    assert orders_of(names) == orders


def test_unit_weights_stand_for_the_compliance_of_a_robot_without_masses_and_for_no_other() -> None:
    known, unknown = (supported_corrections(load_robot(name)) for name in ("irb2400", "ur10e"))
    assert "joint_compliance" in known
    assert "unit_weights" not in known
    substitutes = ["unit_weights", "typical_compliance", "typical_backlash", "typical_friction"]
    assert unknown == ["encoder_harmonics", "rod_strain", "plate_bending", *substitutes]
    assert set(SUBSTITUTES) == set(substitutes)
