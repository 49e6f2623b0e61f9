"""A URDF with what pictures identified, against the result and against the truth."""

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from ballbar import load
from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from tests.helpers.command_line import ballbar
from tests.helpers.pictures import NOMINAL, draw, position_errors, workspace, write
from tests.helpers.published_urdf import PUBLISHED, Joint, tip_pose


def urdf(joints: Sequence[Joint]) -> str:
    parts = [
        f'<link name="l{k + 1}"/><joint name="j{k + 1}" type="revolute"><parent link="l{k}"/>'
        f'<child link="l{k + 1}"/><origin xyz="{_text(joint.xyz)}" rpy="{_text(joint.rpy)}"/>'
        f'<axis xyz="{_text(joint.axis or ())}"/></joint>'
        for k, joint in enumerate(joints)
    ]
    return '<robot name="x"><link name="l0"/>' + "\n".join(parts) + "</robot>\n"


def _text(values: Sequence[float]) -> str:
    return " ".join(map(repr, values))


def joints_of(text: str) -> list[Joint]:
    """Joints of a URDF in the order of the file."""
    out = []
    for joint in ET.fromstring(text).iter("joint"):
        origin, axis = joint.find("origin"), joint.find("axis")
        assert origin is not None
        assert axis is not None
        xyz, rpy, along = (
            tuple(float(v) for v in e.get(k, "0 0 0").split())
            for e, k in ((origin, "xyz"), (origin, "rpy"), (axis, "xyz"))
        )
        out.append(Joint(xyz, along, rpy))
    return out


def tools(joints: Sequence[Joint], q: Array, point: Array) -> Array:
    """(N, 3) [m] places of a point (3,) [m] on the last link."""
    return np.array([(tip_pose(joints, angles) @ [*point, 1.0])[:3] for angles in q])


def test_a_urdf_has_the_robot_that_pictures_identified(tmp_path: Path) -> None:
    drawn = draw(3, 30, noise=0.1)
    before = tmp_path / "ur5e.urdf"
    before.write_text(urdf(PUBLISHED["ur5e"].joints))
    write(drawn, tmp_path / "poses")
    ballbar("identify", str(tmp_path / "poses"), "--out", str(tmp_path / "result"))
    after = tmp_path / "new.urdf"
    ballbar("export", str(tmp_path / "result"), "--into", str(before), "--out", str(after))

    robot, q = load(tmp_path / "result").identified_robot(), workspace(drawn, 100)
    assert robot.target is not None
    joints, point = joints_of(after.read_text()), robot.target.origin
    frames = forward(robot.chain, q)
    expected = frames.tip.T + np.einsum("ijn,j->ni", frames.rotation(), point)
    assert position_errors(tools(joints, q, point), expected).max() < 1e-6
    assert re.sub(r"<origin[^>]*/>", "", after.read_text()) == re.sub(
        r"<origin[^>]*/>", "", before.read_text()
    )
    error = position_errors(tools(joints, q, point), drawn.tcp(q))
    nominal = position_errors((NOMINAL.flange(q) @ drawn.target)[:, :3, 3], drawn.tcp(q))
    assert np.sqrt((error**2).mean()) < 0.3 * np.sqrt((nominal**2).mean())
