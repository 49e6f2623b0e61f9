"""The identified robot as URDF and MJCF: J links, with masses where they are known, and its tools.

Link i turns about its own z axis; its frame is the end of DH row i-1 at joint angle zero. Joint
angles are those of the DH model: a parallel rod or wrist coupling is not in the tree, so the
motors' angles must be multiplied by the robot file's matrix first.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, row_placements
from ballbar.cell.descriptions import Link, Robot
from ballbar.cell.foreign_text import printable
from ballbar.cell.rotation import quat_wxyz, roll_pitch_yaw
from ballbar.export.result import Result, notes, number, numbers

_LIMITS = (
    "Joint limits: the range of each DH joint over the box of axis limits; effort or velocity 0: "
    "the cell files state none."
)
_NO_MASSES = "Masses and inertias: the robot's file states none, so none are in this file."
_BOUNDS = (
    "MuJoCo refuses moving bodies without mass: boundmass and boundinertia make the model load. "
    "They are no masses of the robot: the model serves kinematics, not dynamics."
)
_LEAST_MASS, _LEAST_INERTIA = 1e-6, 1e-9  # [kg], [kg m^2] so small that nobody takes them for any
_INERTIA_DIGITS = 12  # decimals of [kg m^2]; what is beyond is rounding of turned tensors


def urdf(result: Result) -> str:
    """URDF with plain names and without references to files: fit for xacro's include."""
    robot = ET.Element("robot", name=result.name)
    links = result.links
    robot.append(_comment([*notes(result), _LIMITS, *([] if links else [_NO_MASSES])]))
    ET.SubElement(robot, "link", name="base_link")
    poses, (lower, upper) = _placements(result.chain), _joint_range(result.robot)
    # of each joint; 0 where the robot's file states none
    axis_speed = np.nan_to_num(result.robot.axis_speed_max, posinf=0.0)
    speed = np.abs(result.robot.controller_to_joint.T) @ axis_speed
    parent = "base_link"
    for i in range(result.robot.joints):
        link = ET.SubElement(robot, "link", name=f"link_{i + 1}")
        if links:
            _urdf_inertial(link, links[i])
        joint = _urdf_joint(robot, f"joint_{i + 1}", "revolute", parent, f"link_{i + 1}", poses[i])
        ET.SubElement(joint, "axis", xyz="0 0 1")
        bounds = {"lower": number(lower[i]), "upper": number(upper[i])}
        ET.SubElement(joint, "limit", bounds | {"effort": "0", "velocity": number(speed[i])})
        parent = f"link_{i + 1}"
    _urdf_tools(robot, result, parent, poses[-1])
    return _text(robot)


def _urdf_tools(robot: ET.Element, result: Result, parent: str, pose: tuple[Array, Array]) -> None:
    """The first tool at a pose in the last link, the others in its frame."""
    first, *others = result.tools
    ET.SubElement(robot, "link", name=first)
    _urdf_joint(robot, "tool_joint", "fixed", parent, first, pose)
    for name in others:
        ET.SubElement(robot, "link", name=name)
        own = (result.tools[name].rotation, result.tools[name].origin)
        _urdf_joint(robot, f"{name}_joint", "fixed", first, name, own)


def mjcf(result: Result) -> str:
    """MJCF of the unloaded robot, with a site for each tool; that of logs is named `tool`."""
    root = ET.Element("mujoco", model=result.name)
    links = result.links
    root.append(_comment([*notes(result), *([] if links else [_NO_MASSES, _BOUNDS])]))
    options = {"angle": "radian", "autolimits": "true"}
    if not links:
        options |= {"boundmass": number(_LEAST_MASS), "boundinertia": number(_LEAST_INERTIA)}
    ET.SubElement(root, "compiler", options)
    ET.SubElement(root, "option", gravity=numbers(result.robot.gravity))
    parent: ET.Element = ET.SubElement(root, "worldbody")
    poses, (lower, upper) = _placements(result.chain), _joint_range(result.robot)
    for i in range(result.robot.joints):
        rotation, place = poses[i]
        parent = ET.SubElement(
            parent,
            "body",
            name=f"link_{i + 1}",
            pos=numbers(place),
            quat=numbers(quat_wxyz(rotation)),
        )
        if links:
            _mjcf_inertial(parent, links[i])
        ET.SubElement(
            parent,
            "joint",
            name=f"joint_{i + 1}",
            axis="0 0 1",
            range=numbers([lower[i], upper[i]]),
        )
    turn, shift = poses[-1]
    for name, tool in result.tools.items():
        ET.SubElement(
            parent,
            "site",
            name="tool" if name == "tool0" else name,
            pos=numbers(shift + turn @ tool.origin),
            quat=numbers(quat_wxyz(turn @ tool.rotation)),
        )
    return _text(root)


def _urdf_inertial(link: ET.Element, body: Link) -> None:
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=numbers(body.com), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=number(body.mass))
    tensor = {
        f"i{'xyz'[r]}{'xyz'[c]}": number(round(float(body.inertia[r, c]), _INERTIA_DIGITS))
        for r in range(3)
        for c in range(r, 3)
    }
    ET.SubElement(inertial, "inertia", tensor)


def _mjcf_inertial(parent: ET.Element, body: Link) -> None:
    tensor = body.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].round(_INERTIA_DIGITS)
    ET.SubElement(
        parent,
        "inertial",
        pos=numbers(body.com),
        mass=number(body.mass),
        fullinertia=numbers(tensor),
    )


def _placements(chain: Chain) -> list[tuple[Array, Array]]:
    """Pose of links 1 to J and of the flange or tool, each in the frame before it.

    Returns J + 1 of (rotation (3, 3), translation (3,) [m]).
    """
    return [(np.eye(3), np.zeros(3)), *row_placements(chain)]


def _joint_range(robot: Robot) -> tuple[Array, Array]:
    """Smallest and largest angle (J,) [rad] of each joint over the box of axis limits."""
    shares, offset = robot.controller_to_joint, robot.controller_offset
    ends = np.stack((robot.axis_lower[:, None] * shares, robot.axis_upper[:, None] * shares))
    return offset + ends.min(axis=0).sum(axis=0), offset + ends.max(axis=0).sum(axis=0)


def _urdf_joint(
    robot: ET.Element, name: str, kind: str, parent: str, child: str, pose: tuple[Array, Array]
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=numbers(pose[1]), rpy=numbers(roll_pitch_yaw(pose[0])))
    return joint


def _comment(lines: list[str]) -> ET.Element[Any]:
    text = re.sub("-(?=-)", "- ", "\n".join(printable(line) for line in lines))
    return ET.Comment(f"\n{text}\n")


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'
