"""Joints of a URDF or xacro as they stand in its text, and their origins written anew in place.

Only the values of `xyz` and `rpy` change; comments, order, spaces and everything else stay byte for
byte. Of xacro only what is written as numbers can be changed: nothing is expanded.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.parsers import expat

import numpy as np

from cell.arrays import Array
from cell.errors import InputError
from cell.rotation import roll_pitch_yaw
from cell.urdf import TURNING, UrdfChain, UrdfJoint

_MACRO = re.compile(r"\$[{(]")


@dataclass(frozen=True)
class JointText:
    """One joint of a robot's tree, and the places of its tags in the text, in bytes."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Mapping[str, str]  # attributes as written
    axis: str | None
    mimics: bool
    start: tuple[int, int]  # of the tag <joint ...>
    origin_tag: tuple[int, int] | None

    def values(self, file: Path, key: str, default: str = "0 0 0") -> tuple[float, ...]:
        """Three numbers of the origin, or of the axis.

        Raises InputError that names the joint where an expression or something else stands there.
        """
        text = (self.axis if key == "axis" else self.origin.get(key)) or default
        if _MACRO.search(text):
            raise InputError(
                f"{file}: joint {self.name}: {key} = {text!r} is an expression. Only numbers can "
                "be changed in place: expand the file (xacro FILE.xacro > robot.urdf), or write "
                "the numbers."
            )
        try:
            numbers = tuple(float(word) for word in text.split())
        except ValueError:
            numbers = ()
        if len(numbers) != 3 or not np.isfinite(numbers).all():
            raise InputError(f"{file}: joint {self.name}: {key} = {text!r}. Write three numbers.")
        return numbers


def joints_in(content: bytes, file: Path) -> dict[str, JointText]:
    """Joints of a URDF or xacro by name, each with a parent and a child; file : for messages.

    Raises InputError if the text is no XML, declares a document type, or repeats a joint.
    """
    reader = _Reader(content)
    try:
        reader.run()
    except expat.ExpatError as error:
        raise InputError(f"{file}: not valid XML: {error}. Export the file again.") from None
    if reader.refused:
        raise InputError(f"{file}: {reader.refused}. A robot's file needs none: remove it.")
    joints: dict[str, JointText] = {}
    for joint in reader.joints:
        if joint.name in joints:
            raise InputError(f"{file}: joint {joint.name} stands here twice. Rename one.")
        joints[joint.name] = joint
    return joints


def chain_of(joints: Mapping[str, JointText], names: Sequence[str], file: Path) -> UrdfChain:
    """The serial chain of named turning joints, from the first one's parent to the last's child.

    Raises InputError for joints that are not there, do not turn, or do not follow each other.
    """
    by_child = {joint.child: joint for joint in joints.values()}
    turning = list[JointText]()
    fixed = [np.eye(4)]
    for k, name in enumerate(names):
        joint = _named(joints, name, file)
        if joint.kind not in TURNING or joint.mimics:
            raise InputError(f"{file}: joint {joint.name} is no turning joint of its own.")
        if k > 0:
            fixed[k] = _between(by_child, turning[k - 1], joint, file)
        turning.append(joint)
        fixed.append(np.eye(4))
    parts = [_as_read(joint, file) for joint in turning]
    with_origins = [rest @ part.pose for rest, part in zip(fixed[:-1], parts, strict=True)]
    return UrdfChain(turning[0].parent, turning[-1].child, tuple(parts), (*with_origins, fixed[-1]))


def before_origin(joints: Mapping[str, JointText], names: Sequence[str], file: Path) -> list[Array]:
    """(4, 4) [m] pose of each joint's parent link in the child link of the joint before it."""
    by_child = {joint.child: joint for joint in joints.values()}
    chosen = [_named(joints, name, file) for name in names]
    return [np.eye(4), *(_between(by_child, a, b, file) for a, b in pairwise(chosen))]


def with_origins(content: bytes, origins: Sequence[tuple[JointText, Array]]) -> bytes:
    """The text with other origins of joints: poses (4, 4) [m] in the frames of their parents."""
    edits = []
    for joint, pose in origins:
        values = {"xyz": _numbers(pose[:3, 3]), "rpy": _numbers(roll_pitch_yaw(pose[:3, :3]))}
        if joint.origin_tag is None:
            tag = f'<origin xyz="{values["xyz"]}" rpy="{values["rpy"]}"/>'
            edits.append((joint.start[1], joint.start[1], tag.encode()))
            continue
        begin, end = joint.origin_tag
        edits.append((begin, end, _with_values(content[begin:end], values)))
    for begin, end, text in sorted(edits, reverse=True):
        content = content[:begin] + text + content[end:]
    return content


def _with_values(tag: bytes, values: Mapping[str, str]) -> bytes:
    """A tag with other values of its attributes; absent ones are added after its name."""
    for key, value in values.items():
        match = re.search(rb"(\s" + key.encode() + rb"\s*=\s*)([\"'])(.*?)\2", tag, re.DOTALL)
        if match is None:
            name = re.match(rb"<[^\s/>]+", tag)
            assert name is not None  # it is a tag
            tag = tag[: name.end()] + f' {key}="{value}"'.encode() + tag[name.end() :]
        else:
            tag = tag[: match.start(3)] + value.encode() + tag[match.end(3) :]
    return tag


def _between(
    by_child: Mapping[str, JointText], before: JointText, joint: JointText, file: Path
) -> Array:
    """Pose of a joint's parent link in the child link of another one, over fixed joints."""
    pose, link, seen = np.eye(4), joint.parent, set[str]()
    while link != before.child:
        inner = by_child.get(link)
        if inner is None or link in seen:
            raise InputError(
                f"{file}: joint {joint.name} does not hang on {before.name}. Name the turning "
                "joints from the base to the tip with --joints."
            )
        if inner.kind != "fixed":
            raise InputError(
                f"{file}: joint {inner.name} ({inner.kind}) lies between {before.name} and "
                f"{joint.name}. Name all turning joints from the base to the tip with --joints."
            )
        seen.add(link)
        pose, link = _as_read(inner, file).pose @ pose, inner.parent
    return np.asarray(pose)


def _as_read(joint: JointText, file: Path) -> UrdfJoint:
    return UrdfJoint(
        name=joint.name,
        kind=joint.kind,
        parent=joint.parent,
        child=joint.child,
        xyz=joint.values(file, "xyz"),
        rpy=joint.values(file, "rpy"),
        axis=joint.values(file, "axis", "1 0 0"),
        lower=None,
        upper=None,
        speed=None,
        mimics=None,
    )


def _named(joints: Mapping[str, JointText], name: str, file: Path) -> JointText:
    """A joint by its name, which may be given without the expressions of xacro in it."""
    plain = {re.sub(r"\$[{(].*?[})]", "", full): full for full in joints}
    full = name if name in joints else plain.get(name)
    if full is None:
        raise InputError(
            f"{file}: there is no joint {name}. Joints that turn: "
            f"{', '.join(n for n, j in joints.items() if j.kind in TURNING)}."
        )
    return joints[full]


def _numbers(values: Array) -> str:
    return " ".join(repr(float(v) + 0.0) for v in values)


class _Reader:
    """One pass over the XML that notes every joint with a parent and a child."""

    def __init__(self, content: bytes) -> None:
        self.content, self.joints, self.refused = content, list[JointText](), ""
        self._tags = list[str]()
        self._open: dict[str, str] | None = None  # attributes of the joint around
        self._parts: dict[str, dict[str, str]] = {}
        self._start = (0, 0)
        self._origin: tuple[int, int] | None = None
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._begin
        self._parser.EndElementHandler = self._end
        self._parser.StartDoctypeDeclHandler = self._declared

    def run(self) -> None:
        self._parser.Parse(self.content, True)

    def _declared(self, *_: object) -> None:
        self.refused = "holds <!DOCTYPE>, which is refused"

    def _begin(self, tag: str, attributes: dict[str, str]) -> None:
        self._tags.append(tag)
        if tag == "joint" and self._open is None:
            self._open, self._parts, self._origin = attributes, {}, None
            self._start, self._depth = self._tag_place(), len(self._tags)
        elif self._open is not None and len(self._tags) == self._depth + 1:
            self._parts.setdefault(tag, attributes)
            if tag == "origin" and self._origin is None:
                self._origin = self._tag_place()

    def _end(self, tag: str) -> None:
        if tag == "joint" and self._open is not None and len(self._tags) == self._depth:
            self._close(self._open)
            self._open = None
        self._tags.pop()

    def _close(self, attributes: dict[str, str]) -> None:
        parts = self._parts
        links = [parts.get(tag, {}).get("link") for tag in ("parent", "child")]
        if links[0] is None or links[1] is None:
            return  # of ros2_control or a transmission
        self.joints.append(
            JointText(
                name=attributes.get("name", ""),
                kind=attributes.get("type", ""),
                parent=links[0],
                child=links[1],
                origin=parts.get("origin", {}),
                axis=parts.get("axis", {}).get("xyz"),
                mimics="mimic" in parts,
                start=self._start,
                origin_tag=self._origin,
            )
        )

    def _tag_place(self) -> tuple[int, int]:
        """Begin and end of the tag that is read now; a > within quotes does not end it."""
        begin = self._parser.CurrentByteIndex
        match = re.compile(rb"<(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>").match(self.content, begin)
        assert match is not None  # expat has read it
        return begin, match.end()
