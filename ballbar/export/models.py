"""The identified robot as URDF and MJCF: six links with the masses of the cell files, and a tool.

Link i turns about its own z axis; its frame is the end of DH row i-1 at joint angle zero. Joint
angles are those of the DH model: a parallel rod or wrist coupling is not in the tree, so the
motors' angles must be multiplied by the robot file's matrix first.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from typing import Any

import numpy as np

from ballbar.export.result import Result, notes
from ballbar.export.tables import number
from cell.arrays import Array
from cell.bodies import carried_bodies
from cell.chain import Chain, row_placements
from cell.descriptions import Link, Robot
from cell.rotation import quat_wxyz

_LIMITS = (
    "Joint limits: the range of each DH joint over the box of axis limits; effort or velocity 0: "
    "the cell files state none."
)
_INERTIA_DIGITS = 12  # decimals of [kg m^2]; what is beyond is rounding of turned tensors


def urdf(result: Result) -> str:
    """URDF with plain names and without references to files: fit for xacro's include."""
    robot = ET.Element("robot", name=result.name)
    robot.append(_comment([*notes(result), _LIMITS]))
    ET.SubElement(robot, "link", name="base_link")
    poses, (lower, upper) = _placements(result.chain), _joint_range(result.cell.robot)
    known = np.isfinite(result.cell.robot.axis_speed_max).all()
    fastest = result.cell.robot.axis_speed_max if known else np.zeros(result.chain.rows)
    speed = np.abs(result.cell.robot.controller_to_joint.T) @ fastest
    parent = "base_link"
    for i, body in enumerate(_bodies(result)):
        link = ET.SubElement(robot, "link", name=f"link_{i + 1}")
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=_numbers(body.com), rpy="0 0 0")
        ET.SubElement(inertial, "mass", value=number(body.mass))
        tensor = {
            f"i{'xyz'[r]}{'xyz'[c]}": number(round(float(body.inertia[r, c]), _INERTIA_DIGITS))
            for r in range(3)
            for c in range(r, 3)
        }
        ET.SubElement(inertial, "inertia", tensor)
        joint = _urdf_joint(robot, f"joint_{i + 1}", "revolute", parent, f"link_{i + 1}", poses[i])
        ET.SubElement(joint, "axis", xyz="0 0 1")
        bounds = {"lower": number(lower[i]), "upper": number(upper[i])}
        ET.SubElement(joint, "limit", bounds | {"effort": "0", "velocity": number(speed[i])})
        parent = f"link_{i + 1}"
    ET.SubElement(robot, "link", name="tool0")
    _urdf_joint(robot, "tool_joint", "fixed", parent, "tool0", poses[-1])
    return _text(robot)


def mjcf(result: Result) -> str:
    """MJCF of the unloaded robot, with a site `tool`."""
    root = ET.Element("mujoco", model=result.name)
    root.append(_comment(notes(result)))
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(root, "option", gravity=_numbers(result.cell.robot.gravity))
    parent: ET.Element = ET.SubElement(root, "worldbody")
    poses, (lower, upper) = _placements(result.chain), _joint_range(result.cell.robot)
    for i, body in enumerate(_bodies(result)):
        rotation, place = poses[i]
        parent = ET.SubElement(
            parent,
            "body",
            name=f"link_{i + 1}",
            pos=_numbers(place),
            quat=_numbers(quat_wxyz(rotation)),
        )
        tensor = body.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].round(_INERTIA_DIGITS)
        ET.SubElement(
            parent,
            "inertial",
            pos=_numbers(body.com),
            mass=number(body.mass),
            fullinertia=_numbers(tensor),
        )
        ET.SubElement(
            parent,
            "joint",
            name=f"joint_{i + 1}",
            axis="0 0 1",
            range=_numbers([lower[i], upper[i]]),
        )
    rotation, place = poses[-1]
    ET.SubElement(
        parent, "site", name="tool", pos=_numbers(place), quat=_numbers(quat_wxyz(rotation))
    )
    return _text(root)


def _placements(chain: Chain) -> list[tuple[Array, Array]]:
    """Pose of links 1 to J and of the tool, each in the frame before it.

    Returns J + 1 of (rotation (3, 3), translation (3,) [m]).
    """
    return [(np.eye(3), np.zeros(3)), *row_placements(chain)]


def _bodies(result: Result) -> list[Link]:
    """Links 1 to J, the plate merged into the last."""
    return [_joined(links) for links in carried_bodies(result.cell)]


def _joined(links: list[Link]) -> Link:
    """Several rigid links as one."""
    mass = sum(link.mass for link in links)
    com = sum((link.mass * link.com for link in links), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for link in links:
        arm = link.com - com
        inertia += link.inertia + link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Link(mass, com, inertia)


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
    ET.SubElement(joint, "origin", xyz=_numbers(pose[1]), rpy=_numbers(_roll_pitch_yaw(pose[0])))
    return joint


def _roll_pitch_yaw(rotation: Array) -> Array:
    """(3,) [rad] roll, pitch, yaw of a rotation (3, 3) = Rz(yaw) Ry(pitch) Rx(roll)."""
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])


def _numbers(values: Iterable[float]) -> str:
    return " ".join(number(v) for v in values)


def _comment(lines: list[str]) -> ET.Element[Any]:
    text = "\n".join(lines).replace("--", "- -")
    return ET.Comment(f"\n{text}\n")


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'
