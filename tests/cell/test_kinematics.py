"""DH kinematics against MuJoCo, against central differences, and against its own inverse."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ballbar.cell.chain import KINDS, Chain, forward, screw
from ballbar.cell.closed_form import robot_branches
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import (
    Geometry,
    bar_frames,
    mirrored,
    nominal_geometry,
    parameter_screw,
    robot_frames,
)
from ballbar.cell.inverse import UnreachableError, bar_angles, refine
from ballbar.cell.load import load_cell
from ballbar.cell.rotation import (
    inverse_left_jacobian,
    left_jacobian,
    matrix_from_rotvec,
    quat_wxyz,
    rotvec_from_matrix,
)
from ballbar.sim.plant.effects import Plant, PlantEffects
from ballbar.sim.plant.mjcf import PlantModel, plant_model
from tests.helpers.simulated_recordings import perturbed
from tests.helpers.six_axes import NAMES, PARAMETERS

STEP = 1e-6  # central differences: truncation 1e-12, cancellation 1e-10
TOLERANCE = 2e-9


def mujoco_pose(plant: PlantModel, data: mujoco.MjData, site: str) -> np.ndarray:
    mujoco.mj_kinematics(plant.model, data)
    pose = np.eye(4)
    pose[:3, :3] = data.site(site).xmat.reshape(3, 3)
    pose[:3, 3] = data.site(site).xpos
    return pose


@pytest.mark.parametrize("robot", ["irb2400", "nj220"])
def test_mujoco_and_dh_agree_to_1e_12_on_60_perturbed_models(robot: str) -> None:
    cell = load_cell(robot, "lund_900", "plate_250")
    rng = np.random.default_rng(60)
    worst = 0.0
    for _ in range(60):
        geometry = perturbed(nominal_geometry(cell, rng.uniform(-1, 1, 3)), rng)
        perfect = Plant(cell, geometry, PlantEffects(), cell.robot.servo["soft"])
        plant = plant_model(perfect, timestep=1e-3)
        data = mujoco.MjData(plant.model)
        q, b = rng.uniform(-np.pi, np.pi, (3, 6)), rng.uniform(-np.pi, np.pi, (3, 5))
        robot_poses, bar_poses = robot_frames(geometry, q).poses(), bar_frames(geometry, b).poses()
        for k in range(3):
            data.qpos[plant.joints], data.qpos[plant.bar] = q[k], b[k]
            worst = max(worst, np.abs(mujoco_pose(plant, data, "tool") - robot_poses[k]).max())
            worst = max(worst, np.abs(mujoco_pose(plant, data, "bar_end") - bar_poses[k]).max())
    assert worst < 1e-12


def test_every_parameter_screw_is_the_central_difference_of_the_pose(nominal: Geometry) -> None:
    rng = np.random.default_rng(5)
    geometry = perturbed(nominal, rng, 0.05)
    q, b = rng.uniform(-2, 2, (7, 6)), rng.uniform(-2, 2, (7, 5))
    robot, bar = robot_frames(geometry, q), bar_frames(geometry, b)
    for parameter, name in zip(PARAMETERS, NAMES, strict=True):
        frames, angles = (robot_frames, q) if parameter.side == "robot" else (bar_frames, b)
        ahead = frames(geometry.replaced({name: geometry[name] + STEP}), angles)
        behind = frames(geometry.replaced({name: geometry[name] - STEP}), angles)
        turned = np.einsum("ikn,jkn->ijn", ahead.rotation(), behind.rotation())
        numeric = np.concatenate((ahead.tip - behind.tip, rotvec_from_matrix(turned))) / (2 * STEP)
        assert (
            np.abs(parameter_screw(geometry, robot, bar, parameter) - numeric).max() < TOLERANCE
        ), name


def test_an_unknown_parameter_kind_is_refused(nominal: Geometry) -> None:
    with pytest.raises(ValueError, match="'gamma' is none of"):
        screw(robot_frames(nominal, np.zeros((1, 6))), "gamma", 0)
    assert KINDS == ("a", "d", "alpha", "theta", "beta")


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3), st.floats(1e-9, 3.14159))
def test_the_rotation_vector_survives_the_way_to_the_matrix_and_back(
    direction: list[float], angle: float
) -> None:
    """To 1e-14 rad at every angle.

    The entries of the matrix are rounded to 2.2e-16. Up to 3 rad the axis is read off the skew
    part, whose size is sin(angle): the rounding grows by angle / sin(angle) <= 21, to 5e-15. Beyond
    3 rad the quaternion is used, which keeps the axis at a half turn.
    """
    axis = np.array(direction)
    assume(np.linalg.norm(axis) > 1e-3)
    rotvec = (angle * axis / np.linalg.norm(axis))[:, None]
    assert np.abs(rotvec_from_matrix(matrix_from_rotvec(rotvec)) - rotvec).max() < 1e-14


def test_a_turn_on_the_left_changes_the_rotation_vector_by_the_inverse_left_jacobian() -> None:
    rng = np.random.default_rng(3)
    for size in (1e-6, 5e-3, 0.3, 2.5):
        rotvec, turn = rng.normal(0, size, (3, 4)), rng.normal(0, 1, (3, 4))
        moved = [
            Rotation.from_rotvec(s * STEP * turn.T) * Rotation.from_rotvec(rotvec.T)
            for s in (1, -1)
        ]
        base = Rotation.from_rotvec(rotvec.T).as_rotvec().T
        numeric = (moved[0].as_rotvec() - moved[1].as_rotvec()).T / (2 * STEP)
        assert np.abs(inverse_left_jacobian(base, turn) - numeric).max() < 1e-8


@pytest.mark.parametrize("size", [1e-6, 0.3, 2.5])
def test_a_rotation_vector_that_changes_turns_by_the_left_jacobian(size: float) -> None:
    rotvec, rate = np.random.default_rng(4).normal(0.0, 1.0, (2, 3)) * [[size], [1.0]]
    ends = [Rotation.from_rotvec(rotvec + s * STEP * rate) for s in (1, -1)]
    numeric = (ends[0] * ends[1].inv()).as_rotvec() / (2 * STEP)
    assert np.abs(left_jacobian(rotvec) @ rate - numeric).max() < 1e-8


def test_a_quaternion_is_that_of_mujoco_to_the_last_digit() -> None:
    cube = np.round(Rotation.create_group("O").as_matrix())  # ties between components
    for rotation in (*Rotation.random(500, random_state=4).as_matrix(), *cube):
        expected = np.zeros(4)
        mujoco.mju_mat2Quat(expected, rotation.ravel())
        np.testing.assert_array_equal(quat_wxyz(rotation), expected)


@pytest.mark.parametrize("robot", ["irb2400", "nj220"])
def test_every_branch_of_the_robot_inverse_reaches_the_pose(robot: str) -> None:
    cell = load_cell(robot, "lund_600", "plate_250")
    chain = nominal_geometry(cell, np.zeros(3)).robot
    q = np.random.default_rng(8).uniform(-0.8, 0.8, (100, 6)) + np.array([0, 0, 0, 0, 1.0, 0])
    poses = forward(chain, q).poses()
    branches = robot_branches(chain, poses)
    apart = np.abs(np.angle(np.exp(1j * (branches - q)))).max(axis=2)
    in_front = np.hypot(*poses[:, :2, 3].T) > 0.8
    assert (apart.min(axis=0) < 1e-9)[in_front].all()
    for branch in branches:
        reached = ~np.isnan(branch).any(axis=1)
        assert np.abs(forward(chain, branch[reached]).poses() - poses[reached]).max() < 1e-12


def test_the_imperfect_robot_is_brought_exactly_to_a_pose(nominal: Geometry) -> None:
    rng = np.random.default_rng(9)
    chain = perturbed(nominal, rng, 2e-3).robot
    q = rng.uniform(-0.5, 0.5, (50, 6)) + np.array([0, 0, 0, 0, 1.0, 0])
    poses = forward(nominal.robot, q).poses()
    assert np.abs(forward(chain, refine(chain, q, poses)).poses() - poses).max() < 1e-12
    poses[3, :3, 3] += 5.0
    with pytest.raises(UnreachableError, match=r"pose 3 of 50 .* is not reached"):
        refine(chain, q, poses)


def test_newton_steps_from_a_singular_pose_are_refused_in_words() -> None:
    """Regression: numpy's LinAlgError came through where the joint Jacobian is singular."""
    zero = np.zeros(6)
    in_one_line = Chain(zero, zero, zero, zero, zero)  # all axes coincide at any angle
    q = np.radians([[0.0, 10.0, 20.0, 30.0, 40.0, 50.0]])
    poses = forward(in_one_line, q + 0.01).poses()
    with pytest.raises(
        UnreachableError, match=r"pose 0 of 1 .* singular .* 0\.0 10\.0 20\.0 .* deg"
    ):
        refine(in_one_line, q, poses)


@pytest.mark.parametrize("flipped", [(False, False), (True, False), (False, True), (True, True)])
def test_ball_bar_angles_hold_the_pose_in_all_four_configurations(
    nominal: Geometry, flipped: tuple[bool, bool]
) -> None:
    rng = np.random.default_rng(10)
    b = rng.uniform(0.2, 2.8, (60, 5)) * np.array([-1, 1, 1, -1, 1])
    poses = bar_frames(nominal, b).poses()
    angles = bar_angles(poses, nominal.origin, flipped=flipped)
    assert np.abs(bar_frames(nominal, angles).poses() - poses).max() < 1e-12
    assert (np.sign(angles[:, 1]) == (-1 if flipped[0] else 1)).all()
    assert (np.sign(angles[:, 3]) == (-1 if flipped[1] else 1)).all()


@pytest.mark.parametrize("joint", [2, 4])
def test_the_direction_of_b2_and_b4_is_a_gauge_even_of_an_imperfect_ball_bar(
    nominal: Geometry, joint: int
) -> None:
    rng = np.random.default_rng(11)
    geometry = perturbed(nominal, rng, 0.02)
    b = rng.uniform(-3, 3, (40, 5))
    other = b * np.where(np.arange(5) == joint - 1, -1.0, 1.0)
    assert (
        np.abs(
            bar_frames(mirrored(geometry, joint), other).poses() - bar_frames(geometry, b).poses()
        ).max()
        < 1e-12
    )
    with pytest.raises(ValueError, match="only b2 and b4"):
        mirrored(geometry, 3)


def test_a_site_that_nearly_coincides_with_its_body_is_not_snapped_onto_it(
    cell: Cell, nominal: Geometry
) -> None:
    """Regression: MuJoCo takes a site within 1e-6 of its body for identical.

    One trial in sixty had 0.9 urad of silent error.
    """
    flat = nominal.replaced({"ra6": 5e-7, "rd6": 0.0})
    perfect = Plant(cell, flat, PlantEffects(), cell.robot.servo["soft"])
    plant = plant_model(perfect, timestep=1e-3)
    data = mujoco.MjData(plant.model)
    assert (
        np.abs(
            mujoco_pose(plant, data, "tool") - robot_frames(flat, np.zeros((1, 6))).poses()[0]
        ).max()
        < 1e-12
    )


def test_joint_angles_of_another_robot_are_refused(nominal: Geometry) -> None:
    with pytest.raises(ValueError, match=r"joint angles \(2, 7\) do not fit a chain of 6 rows"):
        forward(nominal.robot, np.zeros((2, 7)))
