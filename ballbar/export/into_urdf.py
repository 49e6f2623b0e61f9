"""`ballbar export --into`: an existing URDF or xacro with the identified joint origins.

Only the values of `xyz` and `rpy` change; comments, order, spaces and everything else stay byte for
byte. Of xacro only what is written as numbers can be changed: nothing is expanded.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.rotation import roll_pitch_yaw
from ballbar.export.new_origins import check_new_chain, matched, new_origins
from ballbar.export.result import Result, numbers
from ballbar.robot_file.urdf import TURNING, Urdf, UrdfJoint, joint_of, joints_in, linked, xml_tree
from ballbar.robot_file.urdf_chain import UrdfChain, chain_between


@dataclass(frozen=True, eq=False)
class ChangedFile:
    """A robot's file with other joint origins."""

    content: bytes
    joints: tuple[str, ...]  # in the order of the axes
    shift: Array  # (J,) [m] of each origin
    turn: Array  # (J,) [rad]
    error: float  # [m] largest, of the chain as read back against the identified one
    ranges: list[str]  # lines of text: fitted ranges of the file's joints


def into_file(result: Result, file: Path, joints: Sequence[str] = ()) -> ChangedFile:
    """A URDF or xacro with joint origins of the identified geometry, all else as it was.

    joints : turning joints from base to tip; by default the only chain of as many as the robot has.

    Raises InputError where the file is not of this robot, or a number is an expression.
    """
    if not file.is_file():
        raise InputError(f"{file}: no such file. Name a URDF or xacro of the robot.")
    content, source = file.read_bytes(), str(file)
    root, places = xml_tree(content, source)
    written = joints_in(root, source)
    names = list(joints) or _only_chain(written, result.robot.joints, source)
    names = [_full_name(written, name, source) for name in names]
    chain = _chain_of(written, names, source)
    match = matched(result.robot, result.nominal, chain, source)
    origins, tip = new_origins(match, result.nominal, result.chain, chain)
    edits = [
        _edit(content, written[name], places, pose)
        for name, pose in zip(names, origins, strict=True)
    ]
    text = content
    for begin, end, tag in sorted(edits, reverse=True):
        text = text[:begin] + tag + text[end:]
    again = _chain_of(joints_in(xml_tree(text, source)[0], source), names, source)
    error = check_new_chain(result.robot, match, result.chain, tip, again, source)
    pairs = list(zip(origins, (joint.pose for joint in chain.joints), strict=True))
    return ChangedFile(
        content=text,
        joints=tuple(names),
        shift=np.array([np.linalg.norm(new[:3, 3] - old[:3, 3]) for new, old in pairs]),
        turn=np.array([_angle(new[:3, :3].T @ old[:3, :3]) for new, old in pairs]),
        error=error,
        ranges=result.ranges_of(names, match.sign),
    )


def changed_lines(changed: ChangedFile, result: Result) -> list[str]:
    """Lines of text: how far every origin moved, and what the file does not hold."""
    changes = [
        f"  {name}: {shift * 1e3:.3f} mm, {turn * 1e3:.3f} mrad"
        for name, shift, turn in zip(changed.joints, changed.shift, changed.turn, strict=True)
    ]
    return [
        "origins of joints, changed by:",
        *changes,
        f"read back, the chain agrees with the identified one within {changed.error:.1e} m",
        f"Not in it: {'; '.join(result.left_out)}",
        *changed.ranges,
    ]


def _turns(joint: ET.Element) -> bool:
    return joint.get("type") in TURNING and joint.find("mimic") is None


def _only_chain(joints: Mapping[str, ET.Element], count: int, source: str) -> list[str]:
    """The turning joints of the only serial chain of `count`; fixed joints may lie between."""
    by_child = {linked(joint, "child"): name for name, joint in joints.items()}
    turning = [name for name, joint in joints.items() if _turns(joint)]
    chains = []
    for name in turning:
        path = [name]  # from the joint to the root
        while (above := by_child.get(linked(joints[path[-1]], "parent"))) and above not in path:
            path.append(above)
        moving = [inner for inner in path[::-1] if joints[inner].get("type") != "fixed"]
        if len(moving) == count and all(_turns(joints[inner]) for inner in moving):
            chains.append(moving)
    if len(chains) != 1:
        what = "several chains" if chains else "no chain"
        wrong = f"{what} of {count} turning joints; the file has {', '.join(turning) or 'none'}."
        raise InputError.at(source, wrong, "Name them from base to tip with --joints a,b,c.")
    return chains[0]


def _full_name(joints: Mapping[str, ET.Element], name: str, source: str) -> str:
    """A joint's name, which may be given without the expressions of xacro in it."""
    plain = {re.sub(r"\$[{(].*?[})]", "", full): full for full in joints}
    full = name if name in joints else plain.get(name)
    if full is None:
        raise InputError(
            f"{source}: there is no joint {name}. Joints that turn: "
            f"{', '.join(n for n, j in joints.items() if j.get('type') in TURNING)}."
        )
    if not _turns(joints[full]):
        raise InputError(f"{source}: joint {full} is no turning joint of its own.")
    return full


def _chain_of(joints: Mapping[str, ET.Element], names: Sequence[str], source: str) -> UrdfChain:
    """The serial chain of named joints, from the first one's parent to the last one's child.

    Raises InputError where other joints move between them, or they do not follow each other.
    """
    by_child = {linked(joint, "child"): joint for joint in joints.values()}
    base, tip = linked(joints[names[0]], "parent"), linked(joints[names[-1]], "child")
    link, path = tip, list[UrdfJoint]()
    while link != base and link in by_child and len(path) < len(joints):
        path.insert(0, joint_of(by_child[link], source))
        link = path[0].parent
    moving = [f"{joint.name} ({joint.kind})" for joint in path if joint.kind != "fixed"]
    if link != base or [joint.name for joint in path if joint.kind != "fixed"] != list(names):
        raise InputError(
            f"{source}: {', '.join(names)} are not all joints that move from {base} to {tip}, in "
            f"their order; above {tip} are {', '.join(moving)}. Name all turning joints from the "
            "base to the tip with --joints."
        )
    links = dict.fromkeys((base, *(joint.child for joint in path)))
    return chain_between(Urdf(source, "", links, tuple(path)), base, tip)


def _edit(
    content: bytes, joint: ET.Element, places: Mapping[ET.Element, tuple[int, int]], pose: Array
) -> tuple[int, int, bytes]:
    """Place of a joint's origin in the text, and the tag that goes there; pose : (4, 4) [m]."""
    values = {"xyz": pose[:3, 3], "rpy": roll_pitch_yaw(pose[:3, :3])}
    texts = {key: numbers(value) for key, value in values.items()}
    origin = joint.find("origin")
    if origin is None:
        _, end = places[joint]
        return end, end, f'<origin xyz="{texts["xyz"]}" rpy="{texts["rpy"]}"/>'.encode()
    begin, end = places[origin]
    tag = content[begin:end]
    for key, text in texts.items():
        match = re.search(rb"(\s" + key.encode() + rb"\s*=\s*)([\"'])(.*?)\2", tag, re.DOTALL)
        if match is None:  # absent: it is added after the tag's name
            name = re.match(rb"<[^\s/>]+", tag)
            assert name is not None
            tag = tag[: name.end()] + f' {key}="{text}"'.encode() + tag[name.end() :]
        else:
            tag = tag[: match.start(3)] + text.encode() + tag[match.end(3) :]
    return begin, end, tag


def _angle(rotation: Array) -> float:
    """[rad] of a rotation, exact also for small ones."""
    axial = rotation[[2, 0, 1], [1, 2, 0]] - rotation[[1, 2, 0], [2, 0, 1]]
    return float(np.arctan2(np.linalg.norm(axial), np.trace(rotation) - 1.0))
