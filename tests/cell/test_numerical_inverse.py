"""Inverse kinematics without a closed form: poses are reached, and paths are followed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.chain import Chain, forward
from ballbar.cell.closed_form import arm_branches, has_arm_branches, has_closed_form, robot_branches
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import nominal_geometry
from ballbar.cell.load import load_plate, load_robot, load_telescoping_bar, robot_names
from ballbar.cell.numerical_inverse import REACHED, dexterity, in_range, pose_branches, turned_near
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes
from ballbar.sim.path import Lissajous, branches_along, tool_poses

CLOSED = {"irb120", "irb1600", "irb2400", "irb4400", "irb4600", "irb6640", "nj220"}


def cell_of(robot: str) -> Cell:
    bar, plate = load_telescoping_bar("qc20w_300"), load_plate("plate_250")
    return Cell(load_robot(robot), bar, plate)


def chain_of(robot: str) -> Chain:
    return nominal_geometry(cell_of(robot), np.zeros(3)).robot


def apart(q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """[rad] largest difference of two postures, whole turns left out."""
    return np.abs(np.angle(np.exp(1j * (q - other)))).max(axis=-1)


def test_arms_of_one_structure_alone_have_a_closed_form() -> None:
    assert {name for name in robot_names() if has_closed_form(chain_of(name))} == CLOSED


@pytest.mark.parametrize("offset", ["d2", "d5", "a4", "alpha3"])
def test_an_arm_with_one_more_offset_is_not_taken_for_one_without(offset: str) -> None:
    """Regression: angles of such arms were returned unchecked, with the tool up to 0.7 m off."""
    chain = chain_of("irb2400")
    values = getattr(chain, offset[:-1]).copy()
    values[int(offset[-1]) - 1] += 0.05
    beside = replace(chain, **{offset[:-1]: values})
    poses = forward(beside, np.full((1, 6), 0.4)).poses()
    assert not has_closed_form(beside)
    with pytest.raises(InputError, match="this robot is built otherwise"):
        robot_branches(beside, poses)
    found = pose_branches(beside, poses)[:, 0]
    assert np.nanmin(apart(found, np.full(6, 0.4))) < 1e-6


def test_a_wrist_that_is_exactly_singular_has_no_angles_in_closed_form() -> None:
    """Regression: the two wrist angles that only their sum tells were returned off the pose."""
    chain = chain_of("irb2400")
    q = np.array([[0.2, 0.3, -0.1, 0.7, 0.0, 0.4]])
    poses = forward(chain, q).poses()
    for branch in robot_branches(chain, poses):
        if not np.isnan(branch).any():
            assert np.abs(forward(chain, branch).poses() - poses).max() < REACHED


@pytest.mark.parametrize("robot", ["ur10e", "kr10_r1100", "gp25", "panda"])
def test_every_configuration_found_reaches_the_pose(robot: str) -> None:
    chain = chain_of(robot)
    q = np.random.default_rng(3).uniform(-2.0, 2.0, (60, chain.rows))
    poses = forward(chain, q).poses()
    found = pose_branches(chain, poses)
    there = ~np.isnan(found).any(axis=2)
    assert there.any(axis=0).all()
    every = forward(chain, found[there]).poses()
    wanted = np.broadcast_to(poses, (len(found), *poses.shape))[there]
    assert np.abs(every - wanted).max() < 1e-8
    if chain.rows == 6:  # seven axes take a pose in ever so many postures
        known = np.array([np.nanmin(apart(found[:, k], q[k])) < 1e-6 for k in range(len(q))])
        assert known.mean() > 0.85  # starts are random: not all configurations are found


def test_the_configurations_in_closed_form_are_found_by_number_too() -> None:
    chain = chain_of("irb2400")
    q = np.random.default_rng(8).uniform(-0.8, 0.8, (60, 6)) + np.array([0, 0, 0, 0, 1.0, 0])
    poses = forward(chain, q).poses()
    closed, found = robot_branches(chain, poses), pose_branches(chain, poses)
    off = [
        np.nanmin(apart(found[:, k], branch[k]))
        for branch in closed
        for k in range(len(q))
        if not np.isnan(branch[k]).any()
    ]
    assert np.mean(np.array(off) < 1e-6) > 0.9


@pytest.mark.parametrize(
    "robot",
    ["irb2400", "nj220", "kr10_r1100", "kr210", "gp25", "m20ia", "ur5", "ur5e", "ur10", "ur10e"],
)
def test_axes_counted_in_either_direction_have_all_configurations_in_closed_form(
    robot: str,
) -> None:
    """Regression: of KUKA and UR arms the search missed up to one posture in twenty."""
    chain = chain_of(robot)
    q = np.random.default_rng(4).uniform(-3.0, 3.0, (400, 6))
    poses = forward(chain, q).poses()
    found = arm_branches(chain, poses)
    assert has_arm_branches(chain)
    assert found is not None
    assert np.nanmin(apart(found, q), axis=0).max() < 1e-6
    there = ~np.isnan(found).any(axis=2)
    wanted = np.broadcast_to(poses, (8, *poses.shape))[there]
    assert np.abs(forward(chain, found[there]).poses() - wanted).max() < REACHED


@pytest.mark.parametrize("robot", ["iiwa14", "panda"])
def test_arms_of_other_structures_have_no_closed_form_in_either_direction(robot: str) -> None:
    chain = chain_of(robot)
    assert not has_arm_branches(chain)
    assert arm_branches(chain, np.eye(4)[None]) is None


@pytest.mark.parametrize(("robot", "seat"), [("ur10e", 0.5), ("kr10_r1100", 0.5), ("panda", 0.4)])
def test_a_path_is_followed_without_a_jump(robot: str, seat: float) -> None:
    cell = cell_of(robot)
    nominal = nominal_geometry(cell, np.array([seat, 0.0, 0.2]))
    rng, phases, followed = np.random.default_rng(2), np.linspace(0.0, 1.0, 400), 0
    for _ in range(8):
        shape = Lissajous(
            centre=rng.uniform(-2.0, 0.0, 5),
            amplitude=rng.uniform(0.1, 0.6, 5),
            cycles=rng.integers(1, 4, 5).astype(float),
            phase=rng.uniform(0.0, 6.0, 5),
        )
        for q in branches_along(cell.robot, nominal, shape, phases):
            followed += 1
            wanted = tool_poses(nominal, shape, phases)
            assert np.abs(forward(nominal.robot, q).poses() - wanted).max() < 1e-8
            assert np.abs(np.diff(q, axis=0)).max() < 0.3
            assert np.abs(q[-1] - q[0]).max() < 1e-6  # the path closes, and so do the joints
    assert followed >= 3


def test_a_stretched_arm_has_a_singular_value_of_zero() -> None:
    chain = chain_of("ur10e")
    stretched, bent = np.array([0.3, -0.7, 0.0, 0.4, 1.0, 0.2]), np.full(6, 0.9)
    value = dexterity(chain, np.stack((stretched, bent)))
    assert value[0] < 1e-12
    assert value[1] > 0.05


def test_axes_are_turned_to_where_they_were_before_as_far_as_their_ranges_allow() -> None:
    """Whole turns are all that changes; half a turn away is as near as an axis may be left."""
    robot, turn = load_robot("ur5e"), 2.0 * np.pi
    robot = replace(robot, axis_lower=np.full(6, -4.0), axis_upper=np.full(6, 5.0))
    rng = np.random.default_rng(8)
    before, after = rng.uniform(-4.0, 5.0, (2, 500, 6))
    away = after + turn * rng.integers(-3, 4, after.shape)
    q = turned_near(robot, controller_to_joints(robot, away), controller_to_joints(robot, before))
    axes = joints_to_axes(robot, q)
    turns = (axes - after) / turn
    assert np.abs(turns - np.round(turns)).max() < 1e-12
    assert (axes > -4.0 - 1e-12).all()
    assert (axes < 5.0 + 1e-12).all()
    nearest = after + turn * np.round((before - after) / turn)
    allowed = (nearest >= -4.0) & (nearest <= 5.0)
    assert axes[allowed] == pytest.approx(nearest[allowed], abs=1e-12)
    assert 0.5 < allowed.mean() < 1.0


def test_a_path_turns_as_a_whole_to_the_centre_of_each_axis_range() -> None:
    robot, turn = load_robot("ur5e"), 2.0 * np.pi
    robot = replace(robot, axis_lower=np.full(6, -2.0), axis_upper=np.full(6, 12.0))
    path = 5.0 + np.random.default_rng(9).uniform(-1.0, 1.0, (3, 50, 6))
    turns = np.array([-2, -1, 0, 1, 2, 3])
    q = controller_to_joints(robot, (path + turn * turns).reshape(-1, 6)).reshape(path.shape)
    assert joints_to_axes(robot, in_range(robot, q)) == pytest.approx(path, abs=1e-12)
    kept = joints_to_axes(robot, in_range(robot, q, first=2))
    assert kept[..., 2:] == pytest.approx(path[..., 2:], abs=1e-12)
    assert kept[..., :2] == pytest.approx((path + turn * turns)[..., :2], abs=1e-12)
