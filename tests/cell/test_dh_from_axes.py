"""DH rows of joint axes: the same tip as a plain product of transforms, and the published rows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.dh_from_axes import AxesError, DHForm, JointAxes, dh_from_axes, dh_from_modified
from ballbar.cell.load import load_robot
from tests.helpers.published_urdf import PUBLISHED, Joint, tip_pose, turn

ROUNDING = 1e-12  # [m, -] some ten products of matrices of order 1


def axes_of(joints: tuple[Joint, ...]) -> JointAxes:
    """Axes at zero, from the plain product of transforms."""
    points, directions = [], []
    for i, joint in enumerate(joints):
        if joint.axis is not None:
            pose = tip_pose(joints[: i + 1], np.zeros(len(points) + 1))
            points.append(pose[:3, 3])
            directions.append(pose[:3, :3] @ joint.axis)
    return JointAxes(
        np.array(points), np.array(directions), tip_pose(joints, np.zeros(len(points)))
    )


def turned_about_lines(axes: JointAxes, q: Array) -> Array:
    """(4, 4) tip by the product of exponentials: each turn about its line at zero."""
    pose = np.eye(4)
    for point, direction, angle in zip(axes.point, axes.direction, q, strict=True):
        about = np.eye(4)
        about[:3, :3] = Rotation.from_rotvec(angle * direction).as_matrix()
        about[:3, 3] = point - about[:3, :3] @ point
        pose = pose @ about
    return np.asarray(pose @ axes.T_base_tip)


def largest_difference(form: DHForm, axes: JointAxes, seed: int = 0) -> float:
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (20, len(axes.point)))
    expected = np.array([turned_about_lines(axes, row) for row in q])
    return float(np.abs(form.tip_poses(q) - expected).max())


def random_axes(rng: np.random.Generator, joints: int) -> JointAxes:
    """Axes that are skew, parallel, antiparallel, intersecting and collinear in turn."""
    points, directions = [rng.normal(size=3)], [_unit(rng)]
    while len(points) < joints:
        before, z = points[-1], directions[-1]
        kind = rng.integers(5)
        along = before + rng.normal() * z
        new = {
            0: (rng.normal(size=3), _unit(rng)),  # skew
            1: (rng.normal(size=3), z),  # parallel
            2: (rng.normal(size=3), -z),  # antiparallel
            3: (along, _unit(rng)),  # intersecting
            4: (along, z * rng.choice((-1, 1))),  # collinear
        }[int(kind)]
        points.append(new[0])
        directions.append(new[1])
    tip = np.eye(4)
    tip[:3, :3] = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    tip[:3, 3] = rng.normal(size=3)
    return JointAxes(np.array(points), np.array(directions), tip)


def _unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


@given(st.integers(0, 2**32 - 1), st.integers(5, 8))
def test_rows_of_any_axes_give_the_tip_of_the_product_of_exponentials(
    seed: int, joints: int
) -> None:
    axes = random_axes(np.random.default_rng(seed), joints)
    try:
        form = dh_from_axes(axes)
    except AxesError:  # two random directions within half a degree
        return
    # feet of common normals: 1/sine >= 1e-2 loses two to four digits
    assert largest_difference(form, axes, seed) < 1e-9
    theta, a = form.chain.theta[1:-1], form.chain.a[1:-1]
    assert (np.abs(theta) <= np.pi / 2 + 1e-9).all()
    square = np.abs(np.abs(theta) - np.pi / 2) < 1e-9
    assert (a[square] >= 0.0).all()


# apart from the GP25, whose flange is turned by 1.570796, not pi/2: the reader of URDF rounds that
@pytest.mark.parametrize("name", sorted(set(PUBLISHED) - {"gp25"}))
def test_rows_of_a_published_robot_need_no_transform_around_them(name: str) -> None:
    axes = axes_of(PUBLISHED[name].joints)
    form = dh_from_axes(axes)
    if name.startswith("ur"):  # quarter turns of ten digits
        assert largest_difference(form, axes) < 1e-8
        return
    np.testing.assert_array_equal(form.T_base_dh, np.eye(4))
    np.testing.assert_array_equal(form.T_flange_tip, np.eye(4))
    assert largest_difference(form, axes) < ROUNDING


def test_parallel_axes_have_no_offset_and_the_same_direction() -> None:
    form = dh_from_axes(axes_of(PUBLISHED["m20ia"].joints))
    assert form.sign.tolist() == [1, 1, -1, 1, 1, -1]  # joint 3 is about -y, joint 2 about +y
    np.testing.assert_allclose(form.chain.alpha[1], 0.0, atol=1e-12)
    np.testing.assert_allclose(form.chain.d[1], 0.0, atol=1e-12)


def test_height_and_turn_of_the_base_are_in_row_1_and_its_sideways_shift_is_not() -> None:
    joints = list(PUBLISHED["irb120"].joints)
    joints[0] = Joint((0.0, 0.0, 0.4), (0, 0, 1), (0.0, 0.0, 0.5))
    form = dh_from_axes(axes_of(tuple(joints)))
    np.testing.assert_array_equal(form.T_base_dh, np.eye(4))
    assert form.chain.d[0] == pytest.approx(0.29 + 0.4)
    assert form.chain.theta[0] == pytest.approx(0.5)
    joints[0] = Joint((0.2, -0.1, 0.4), (0, 0, 1))
    form = dh_from_axes(axes_of(tuple(joints)))
    np.testing.assert_allclose(form.T_base_dh[:3, 3], [0.2, -0.1, 0.0])
    np.testing.assert_array_equal(form.T_base_dh[:3, :3], np.eye(3))


def test_a_robot_on_the_wall_has_a_base_transform() -> None:
    joints = list(PUBLISHED["irb120"].joints)
    joints[0] = Joint((0.0, 0.0, 1.0), (0, 0, 1), (0.0, np.pi / 2, 0.0))
    axes = axes_of(tuple(joints))
    form = dh_from_axes(axes)
    np.testing.assert_allclose(form.T_base_dh[:3, 2], [1.0, 0.0, 0.0], atol=1e-15)
    assert largest_difference(form, axes) < ROUNDING


@pytest.mark.parametrize("angle", [1e-3, 1e-7])
def test_nearly_parallel_axes_are_refused_with_their_numbers(angle: float) -> None:
    axes = axes_of(PUBLISHED["irb120"].joints)
    directions = np.array(axes.direction)
    directions[2] = turn((1, 0, 0), angle)[:3, :3] @ directions[2]
    with pytest.raises(AxesError, match=r"axes 2 and 3 are .* deg from parallel.*1\.570796"):
        dh_from_axes(JointAxes(axes.point, directions, axes.T_base_tip))


def test_modified_rows_of_the_panda_give_its_standard_rows() -> None:
    quarter = np.pi / 2
    a = np.array([0, 0, 0, 0.0825, -0.0825, 0, 0.088])
    d = np.array([0.333, 0, 0.316, 0, 0.384, 0, 0])
    alpha = np.array([0, -quarter, quarter, quarter, -quarter, quarter, quarter])
    form = dh_from_modified(a, d, alpha, np.zeros(7))
    np.testing.assert_array_equal(form.chain.a, [0, 0, 0.0825, -0.0825, 0, 0.088, 0])
    np.testing.assert_array_equal(form.chain.alpha[:3], [-quarter, quarter, quarter])
    axes = axes_of(PUBLISHED["panda"].joints[:-1])  # up to link 7
    assert largest_difference(form, axes) < ROUNDING


# The IRB 2400's rows turn joint 5 the other way than its axis 5 (cell/robots/irb2400.yaml).
@pytest.mark.parametrize("name", sorted(set(PUBLISHED) - {"gp25", "irb2400"}))
def test_rows_are_those_of_the_shipped_description(name: str) -> None:
    chain, robot = dh_from_axes(axes_of(PUBLISHED[name].joints)).chain, load_robot(name)
    for key in ("a", "d", "alpha", "theta"):  # 1e-8: quarter turns of ten digits at UR
        np.testing.assert_allclose(getattr(chain, key), getattr(robot, key), atol=1e-8)


def test_a_last_axis_parallel_to_its_neighbour_is_not_turned_to_the_tip() -> None:
    joints = list(PUBLISHED["irb120"].joints)
    joints[5:] = [Joint((0.1, 0, 0), (0, 1, 0)), Joint((0, 0, 0), None, (np.pi / 2, 0, 0))]
    axes = axes_of(tuple(joints))  # axes 5 and 6 along +y, the tip's z along -y
    np.testing.assert_allclose(axes.T_base_tip[:3, 2], [0, -1, 0], atol=1e-15)
    form = dh_from_axes(axes)
    assert form.sign[5] == 1.0
    assert form.chain.alpha[4] == 0.0
    assert largest_difference(form, axes) < ROUNDING
