"""URDF: the chain between two links, what is refused, and mass properties in the base frame."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.cell.descriptions import Link
from ballbar.cell.errors import DescriptionError
from ballbar.export.into_urdf import ChangedFile, _angle, changed_lines
from ballbar.export.result import Result
from ballbar.robot_file.urdf import parse_urdf, with_round_angles
from ballbar.robot_file.urdf_chain import bodies, chain_between
from tests.helpers.published_urdf import PUBLISHED, Joint, tip_pose, turn
from tests.helpers.urdf_files import INERTIAL, Mass, urdf_text

IRB120 = PUBLISHED["irb120"].joints


def fixed(name: str, parent: str, child: str, origin: str = "") -> str:
    return (
        f'<link name="{child}"/><joint name="{name}" type="fixed">{origin}'
        f'<parent link="{parent}"/><child link="{child}"/></joint>'
    )


def moving(name: str, kind: str, parent: str, child: str, inner: str = "") -> str:
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><axis xyz="0 0 1"/>{inner}'
        f'<parent link="{parent}"/><child link="{child}"/></joint>'
    )


@pytest.mark.parametrize("name", sorted(PUBLISHED))
def test_tip_of_a_urdf_is_that_of_the_plain_product(name: str) -> None:
    joints = PUBLISHED[name].joints
    chain = chain_between(parse_urdf(urdf_text(joints), name))
    assert (chain.base, chain.tip) == ("base", f"link{len(joints)}")
    q = np.random.default_rng(3).uniform(-3.0, 3.0, (5, len(chain.joints)))
    expected = [tip_pose(joints, row) for row in q]
    np.testing.assert_allclose(chain.tip_poses(q), expected, atol=1e-14)


def test_an_axis_need_not_be_a_unit_vector() -> None:
    long = tuple(Joint(j.xyz, j.axis and tuple(3.0 * c for c in j.axis), j.rpy) for j in IRB120)
    q = np.full((1, 6), 0.3)
    short_pose = chain_between(parse_urdf(urdf_text(IRB120), "a")).tip_poses(q)
    long_pose = chain_between(parse_urdf(urdf_text(long), "b")).tip_poses(q)
    np.testing.assert_allclose(long_pose, short_pose, atol=1e-15)


def test_base_may_be_a_frame_beside_the_chain() -> None:
    """The frame of the controller hangs on base_link in the URDFs of ROS-Industrial."""
    extra = fixed("to_world", "base", "world", '<origin xyz="0 0 0.525"/>')
    urdf = parse_urdf(urdf_text(IRB120, extra=extra), "arm.urdf")
    q = np.zeros((1, 6))
    lower = chain_between(urdf, tip="link7").tip_poses(q)[0]
    upper = chain_between(urdf, base="world", tip="link7").tip_poses(q)[0]
    np.testing.assert_allclose(lower[:3, 3] - upper[:3, 3], [0.0, 0.0, 0.525], atol=1e-15)


def test_a_chain_between_links_in_the_middle() -> None:
    joints = PUBLISHED["panda"].joints
    chain = chain_between(parse_urdf(urdf_text(joints), "p"), base="link1", tip="link6")
    assert [joint.name for joint in chain.joints] == [f"joint{i}" for i in range(2, 7)]
    assert len(chain.fixed) == 6


def test_of_several_frames_on_the_last_joint_tool0_is_the_tip() -> None:
    extra = fixed("j_ft", "link7", "ft_frame") + fixed("j_tool", "link7", "tool0")
    assert chain_between(parse_urdf(urdf_text(IRB120, extra=extra), "a")).tip == "tool0"
    extra = fixed("j_ft", "link7", "ft_frame") + fixed("j_cam", "link7", "camera")
    with pytest.raises(DescriptionError, match=r"Name one with --tip: camera, ft_frame\."):
        chain_between(parse_urdf(urdf_text(IRB120, extra=extra), "a"))


def test_a_gripper_and_a_lever_do_not_lengthen_the_chain() -> None:
    finger = moving("finger", "prismatic", "link7", "finger_link")
    mimic = '<mimic joint="joint2" multiplier="-0.25"/>'
    lever = moving("lever", "continuous", "link7", "lever_link", mimic)
    urdf = parse_urdf(
        urdf_text(IRB120, extra=finger + lever + fixed("t", "link7", "tool0")), "arm.urdf"
    )
    assert chain_between(urdf).tip == "tool0"


@pytest.mark.parametrize(
    ("extra", "tip", "message"),
    [
        (moving("slide", "prismatic", "link7", "end"), "end", "joint slide is prismatic"),
        (
            moving("turn", "revolute", "link7", "end", '<mimic joint="joint1"/>'),
            "end",
            "joint turn mimics joint1",
        ),
        ("", "lnk7", r"there is no link lnk7\. Links: base, link1"),
        ("", "base", "no joint turns between base and base"),
    ],
)
def test_a_chain_that_has_no_rows_is_refused_by_name(extra: str, tip: str, message: str) -> None:
    urdf = parse_urdf(urdf_text(IRB120, extra=extra), "arm.urdf")
    with pytest.raises(DescriptionError, match=rf"arm\.urdf: .*{message}"):
        chain_between(urdf, tip=tip)


def test_a_robot_on_a_rail_is_refused_by_the_name_of_the_rail() -> None:
    text = urdf_text(IRB120).replace('name="base"', 'name="carriage"', 1)
    text = text.replace('link="base"', 'link="carriage"').replace(
        "</robot>",
        '<link name="world"/><joint name="rail" type="prismatic"><axis xyz="1 0 0"/>'
        '<parent link="world"/><child link="carriage"/></joint></robot>',
    )
    urdf = parse_urdf(text, "workcell.urdf")
    with pytest.raises(DescriptionError, match=r"joint rail is prismatic.*--base and --tip"):
        chain_between(urdf)
    assert len(chain_between(urdf, base="carriage").joints) == 6


def test_two_arms_of_the_same_length_need_a_tip() -> None:
    second = urdf_text(IRB120).split("\n")
    lines = [line for line in second[2:-2] if 'link name="base"' not in line]
    extra = "\n".join(lines).replace('"link', '"b_link').replace('name="joint', 'name="b_joint')
    urdf = parse_urdf(urdf_text(IRB120, extra=extra), "dual.urdf")
    with pytest.raises(DescriptionError, match=r"end with b_joint6, joint6\. Name .* --tip"):
        chain_between(urdf)
    assert chain_between(urdf, tip="b_link7").joints[0].name == "b_joint1"


BOMB = '<!DOCTYPE robot [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><robot name="x">&b;</robot>'
XACRO = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="a"/></robot>'
TWO = '<link name="a"/><link name="b"/>'


def joined(name: str, parent: str, child: str, inner: str = "", kind: str = "fixed") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{inner}{ends}</joint>'


@pytest.mark.parametrize(
    ("inner", "message"),
    [
        ("", "holds no link"),
        ('<link name="a"/><link name="a"/>', "link a stands here twice"),
        (TWO, r"2 roots \(a, b\)"),
        ("<link/>", "a link has no name"),
        (TWO + joined("j", "a", "b", kind="hinge"), "joint j: type 'hinge' is none of revolute"),
        ('<link name="a"/>' + joined("j", "a", "b"), "joint j: there is no link b"),
        ('<link name="a"/>' + joined("j", "a", ""), "joint j: names no child"),
        (TWO + joined("j", "a", "b") + joined("k", "a", "b"), "b is the child of joints j and k"),
        (
            '<link name="r"/>' + TWO + joined("j", "a", "b") + joined("k", "b", "a"),
            "links a, b form a loop",
        ),
        (TWO + joined("j", "a", "b", '<origin xyz="0 0"/>'), "j: xyz = '0 0'. Write three numbers"),
        (
            TWO + joined("j", "a", "b", '<origin xyz="0 nan 0"/>'),
            "joint j: xyz = 'nan' is no finite number",
        ),
        (
            TWO + joined("j", "a", "b", '<axis xyz="0 0 0"/>', kind="revolute"),
            "joint j: the axis is 0 0 0",
        ),
        (
            '<link name="a"><inertial><mass value="1"/></inertial></link>',
            "link a: its inertial lacks mass or inertia",
        ),
    ],
)
def test_a_tree_that_is_none_is_refused_with_what_and_where(inner: str, message: str) -> None:
    with pytest.raises(DescriptionError, match=rf"^arm.urdf: .*{message}"):
        parse_urdf(f"<robot>{inner}</robot>", "arm.urdf")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not valid XML"),
        ("<robot><link></robot>", "not valid XML"),
        (BOMB, "holds <!DOCTYPE>, which is refused"),
        ("<sdf version='1.6'/>", "outermost element is <sdf>"),
        (XACRO, "holds xacro macros. Expand them first"),
    ],
)
def test_a_malformed_urdf_is_refused_with_what_and_where(text: str, message: str) -> None:
    with pytest.raises(DescriptionError, match=message) as caught:
        parse_urdf(text, "arm.urdf")
    assert str(caught.value).startswith("arm.urdf: ")


def test_more_links_than_a_robot_has_are_refused() -> None:
    links = "".join(f'<link name="l{i}"/>' for i in range(1001))
    with pytest.raises(DescriptionError, match="1001 links, more than 1000"):
        parse_urdf(f"<robot>{links}</robot>", "city.urdf")


def test_printed_quarter_turns_are_taken_as_such_and_others_are_not() -> None:
    joints = (
        Joint((0, 0, 0), (0, 0, 1), (1.5708, -3.1415926, 0.7854)),
        Joint((0, 0, 0), (0, 0, 1), (1.57, 0.1, -0.0)),
    )
    first, second = with_round_angles(parse_urdf(urdf_text(joints), "a")).joints
    np.testing.assert_array_equal(first.rpy, [np.pi / 2, -np.pi, np.pi / 4])
    np.testing.assert_array_equal(second.rpy, [1.57, 0.1, 0.0])


def test_masses_are_in_the_base_frame_and_rigid_links_are_one_body() -> None:
    box = Mass(2.0, (0.1, 0.0, 0.0), (0.02, 0.03, 0.04), rpy=(0.0, 0.0, np.pi / 2))
    masses = [Mass(5.0, (0, 0, 0.05), (0.1, 0.1, 0.1)), *[box] * 7]
    urdf = parse_urdf(urdf_text(IRB120, masses=masses), "a")
    every = bodies(urdf, chain_between(urdf))
    assert not isinstance(every, str)
    assert len(every) == 7
    upper_arm = every[2]  # origin of joint 2 at z 0.29, axes parallel to the base
    np.testing.assert_allclose(upper_arm.com, [0.1, 0.0, 0.29])
    np.testing.assert_allclose(np.diag(upper_arm.inertia), [0.03, 0.02, 0.04], atol=1e-15)
    last = every[6]  # link 6 and the flange frame behind it, turned by 90 deg about y
    assert last.mass == 4.0
    origin, com = np.array([0.374, 0.0, 0.63]), np.array([0.1, 0.0, 0.0])
    coms = [origin + com, origin + turn((0, 1, 0), np.pi / 2)[:3, :3] @ com]
    np.testing.assert_allclose(last.com, np.mean(coms, axis=0), atol=1e-15)
    # two masses of 2 kg at +-half their distance
    half = 0.5 * (coms[0] - coms[1])
    about = 4.0 * ((half @ half) * np.eye(3) - np.outer(half, half))
    turned = turn((0, 1, 0), np.pi / 2)[:3, :3]
    own = np.diag([0.03, 0.02, 0.04])
    np.testing.assert_allclose(last.inertia, own + turned @ own @ turned.T + about, atol=1e-15)


@pytest.mark.parametrize(
    ("masses", "extra", "reason"),
    [
        ([None], "", "the base has no inertial"),
        ([Mass(1, (0, 0, 0), (1, 1, 1))] * 3, "", "the link behind joint3 has no inertial"),
        (
            [Mass(1, (0, 0, 0), (1, 1, 1))] * 8,
            moving("finger", "prismatic", "link7", "claw"),
            "link claw moves beside the chain, on joint finger",
        ),
        ([Mass(1, (0, 0, 0), (1, 1, 3))] * 8, "", "the inertia of the base is not that of a body"),
    ],
)
def test_masses_that_are_not_complete_are_left_out_with_the_reason(
    masses: list[Mass | None], extra: str, reason: str
) -> None:
    urdf = parse_urdf(urdf_text(IRB120, masses=masses, extra=extra), "a")
    assert bodies(urdf, chain_between(urdf, tip="link7")) == reason


def test_a_link_of_mass_zero_is_a_frame() -> None:
    inertial = INERTIAL.format(com="0 0 0", rpy="0 0 0", mass=0, ixx=0, iyy=0, izz=0)
    urdf = parse_urdf(f'<robot><link name="a">{inertial}</link></robot>', "a")
    assert urdf.links == {"a": None}
    solid = inertial.replace('value="0"', 'value="1"')
    with_mass = parse_urdf(f'<robot><link name="a">{solid}</link></robot>', "a")
    assert isinstance(with_mass.links["a"], Link)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 2.0, 3.1])
@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.48, 0.6, 0.64]])
def test_the_angle_of_a_rotation_is_exact_also_where_it_is_small(
    angle: float, axis: list[float]
) -> None:
    rotation = Rotation.from_rotvec(angle * np.array(axis)).as_matrix()
    assert _angle(rotation) == pytest.approx(angle, rel=1e-7, abs=1e-15)


def test_what_moved_is_told_in_mm_and_mrad_by_joint() -> None:
    shift, turn = np.array([1.2345e-3, 0.0]), np.array([0.0, 6.7e-5])
    changed = ChangedFile(b"", ("shoulder", "elbow"), shift, turn, 3e-9, ["a range"])
    result = cast("Result", SimpleNamespace(left_out=["ripple", "sag"]))
    assert changed_lines(changed, result) == [
        "origins of joints, changed by:",
        "  shoulder: 1.234 mm, 0.000 mrad",
        "  elbow: 0.000 mm, 0.067 mrad",
        "read back, the chain agrees with the identified one within 3.0e-09 m",
        "Not in it: ripple; sag",
        "a range",
    ]
