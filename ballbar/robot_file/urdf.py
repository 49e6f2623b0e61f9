"""Robots described in URDF, the XML format of ROS: elements, links and joints of a file.

Source: the URDF XML specification of ROS (wiki.ros.org/urdf/XML). Read are the kinematic tree, the
limits of the joints and the inertials of the links; meshes, materials and transmissions are not.
Document types are refused: no URDF needs them, and a few lines of their entities expand to
gigabytes. `xml_tree`, `joints_in` and `joint_of` read xacro too, as far as it is written out.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Link
from ballbar.cell.errors import DescriptionError

TURNING = ("revolute", "continuous")
_KINDS = (*TURNING, "prismatic", "fixed", "floating", "planar")
# Angles of origins this near to a multiple of 15 deg stand for it: files print them with 6 to 10
# digits (1.5708, 1.570796327).
ROUND_ANGLE, ROUNDING = np.pi / 12.0, 1e-5  # [rad]
MAX_LINKS = 1000  # far above any robot in its cell
_TAG = re.compile(rb"<(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")  # a > within quotes does not end it
_REFUSALS = {
    "no XML": "not valid XML: {}. Export the file again.",
    "document type": "holds <!DOCTYPE>, which is refused. A robot's file needs none: remove it.",
    "other root": "the outermost element is <{}>, a URDF has <robot>. Name the URDF.",
    "xacro": "holds xacro macros. Expand them first: xacro FILE.xacro > robot.urdf",
    "twice": "{} {} stands here twice. Rename one.",
    "no link": "holds no link. Name the URDF of the robot.",
    "many links": f"{{}} links, more than {MAX_LINKS}. Leave out all but the robot.",
    "no name": "a {} has no name. Give it one.",
    "other kind": f"type {{!r}} is none of {', '.join(_KINDS)}.",
    "no axis": "the axis is 0 0 0. Write its direction.",
    "not connected": 'names no {0}. Write <{0} link="..."/>.',
    "half an inertial": "its inertial lacks mass or inertia. Complete or remove it.",
    "expression": "{} = {!r} is an expression. Only numbers are read, and changed in place: expand "
    "the file (xacro FILE.xacro > robot.urdf), or write the numbers.",
    "not three": "{} = {!r}. Write three numbers.",
    "no number": "{} = {!r} is no finite number. Correct it.",
    "unknown link": "joint {}: there is no link {}. Correct the name.",
    "two parents": "link {} is the child of joints {} and {}. A URDF is a tree: remove one.",
    "roots": "the links have {}. A URDF is one tree: connect them with joints.",
    "loop": "links {} form a loop. A URDF is a tree: open it.",
}


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """One joint. Its frame is that of the child link."""

    name: str
    kind: str  # revolute, continuous, prismatic, fixed, floating or planar
    parent: str  # names of links
    child: str
    xyz: tuple[float, ...]  # [m] origin in the parent link's frame, at joint position zero
    rpy: tuple[float, ...]  # [rad] Rz(yaw) Ry(pitch) Rx(roll)
    axis: tuple[float, ...]  # in the joint's frame, not normalised
    mimics: str | None = None  # joint that this one follows
    lower: float | None = None  # [rad]
    upper: float | None = None  # [rad]
    speed: float | None = None  # [rad/s]

    @property
    def turns(self) -> bool:
        """Whether it is an axis of its own."""
        return self.kind in TURNING and self.mimics is None

    @property
    def pose(self) -> Array:
        """(4, 4) [m] pose T_parent_child at joint position zero."""
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("xyz", self.rpy).as_matrix()
        pose[:3, 3] = self.xyz
        return pose


@dataclass(frozen=True, eq=False)
class Urdf:
    """Links and joints of a file; every link but the root is the child of one joint."""

    source: str  # named in messages
    name: str
    links: Mapping[str, Link | None]  # inertial in the link's frame, None if there is none
    joints: tuple[UrdfJoint, ...]
    parent_joint: Mapping[str, UrdfJoint] = field(init=False)  # by child link

    def __post_init__(self) -> None:
        object.__setattr__(self, "parent_joint", {j.child: j for j in self.joints})

    @property
    def root(self) -> str:
        """The link that is no child."""
        return next(name for name in self.links if name not in self.parent_joint)

    def joints_to(self, link: str) -> list[UrdfJoint]:
        """The joints from the root to a link, in this order."""
        path = []
        while joint := self.parent_joint.get(link):
            path.append(joint)
            link = joint.parent
        return path[::-1]

    def below(self, body_joints: Iterable[str] | None = None) -> list[UrdfJoint]:
        """Joints that are reached from the root, each after the one above it.

        body_joints : moving joints that are followed; by default all.
        """
        children: dict[str, list[UrdfJoint]] = {}
        for joint in self.joints:
            children.setdefault(joint.parent, []).append(joint)
        followed = {j.name for j in self.joints} if body_joints is None else set(body_joints)
        reached, waiting = list[UrdfJoint](), [self.root]
        while waiting:
            for joint in children.get(waiting.pop(), ()):
                if joint.kind == "fixed" or joint.name in followed:
                    reached.append(joint)
                    waiting.append(joint.child)
        return reached


def parse_urdf(text: str, source: str) -> Urdf:
    """The robot of a URDF text; source : its file, for messages.

    Raises DescriptionError if the text is no URDF, or its joints do not form a tree.
    """
    root, _ = xml_tree(text, source)
    _require(root.tag == "robot", source, "other root", root.tag)
    _require(not any("xacro" in element.tag for element in root.iter()), source, "xacro")
    links: dict[str, Link | None] = {}
    for element in root.findall("link"):
        name = _name(element, source)
        _require(name not in links, source, "twice", "link", name)
        links[name] = _inertial(element, f"{source}: link {name}")
    _require(links, source, "no link")
    _require(len(links) <= MAX_LINKS, source, "many links", len(links))
    joints = tuple(_limited_joint(element, source) for element in root.findall("joint"))
    urdf = Urdf(source, root.get("name") or "robot", links, joints)
    _check_tree(urdf)
    return urdf


def xml_tree(
    content: str | bytes, source: str
) -> tuple[ET.Element, dict[ET.Element, tuple[int, int]]]:
    """The elements of a text, and where each one's start tag begins and ends, in bytes.

    Raises DescriptionError if the text is no XML, or declares a document type.
    """
    builder, parser = ET.TreeBuilder(), expat.ParserCreate()
    places: dict[ET.Element, tuple[int, int]] = {}
    raw = content.encode() if isinstance(content, str) else content

    def begin(tag: str, attributes: dict[str, str]) -> None:
        place = parser.CurrentByteIndex
        match = _TAG.match(raw, place)
        assert match is not None  # expat has read it
        places[builder.start(tag, attributes)] = place, match.end()

    parser.StartElementHandler, parser.EndElementHandler = begin, builder.end
    parser.StartDoctypeDeclHandler = lambda *_: _require(None, source, "document type")
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        _require(None, source, "no XML", error)
    return builder.close(), places


def joints_in(root: ET.Element, source: str) -> dict[str, ET.Element]:
    """Joints by name, wherever they stand; those of ros2_control or a transmission have no links.

    Raises DescriptionError if a name stands there twice.
    """
    joints: dict[str, ET.Element] = {}
    for element in root.iter("joint"):
        if all(linked(element, tag) for tag in ("parent", "child")):
            name = element.get("name", "")
            _require(name not in joints, source, "twice", "joint", name)
            joints[name] = element
    return joints


def joint_of(element: ET.Element, source: str) -> UrdfJoint:
    """A joint without its limits.

    Raises DescriptionError that names the joint where something is missing or no number.
    """
    name, kind = _name(element, source), element.get("type", "")
    where = f"{source}: joint {name}"
    _require(kind in _KINDS, where, "other kind", kind)
    origin, mimic = element.find("origin"), element.find("mimic")
    axis = _triple(element.find("axis"), "xyz", where, default=(1.0, 0.0, 0.0))
    _require(kind not in TURNING or np.linalg.norm(axis) > 0.0, where, "no axis")
    for tag in ("parent", "child"):
        _require(linked(element, tag), where, "not connected", tag)
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=linked(element, "parent"),
        child=linked(element, "child"),
        xyz=_triple(origin, "xyz", where),
        rpy=_triple(origin, "rpy", where),
        axis=axis,
        mimics=None if mimic is None else mimic.get("joint", "another joint"),
    )


def linked(joint: ET.Element, tag: str) -> str:
    """The link that a joint names as its parent or child; empty where there is none."""
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")


def with_round_angles(urdf: Urdf) -> Urdf:
    """The same robot with angles of origins put to multiples of 15 deg within ROUNDING."""

    def rounded(angle: float) -> float:
        nearest = round(angle / ROUND_ANGLE) * ROUND_ANGLE
        return float(nearest) if abs(angle - nearest) < ROUNDING else angle

    return replace(
        urdf, joints=tuple(replace(j, rpy=tuple(map(rounded, j.rpy))) for j in urdf.joints)
    )


def listed(names: Iterable[str]) -> str:
    """At most eight names."""
    ordered, most = sorted(names), 8
    more = f" and {len(ordered) - most} more" if len(ordered) > most else ""
    return ", ".join(ordered[:most]) + more


def _check_tree(urdf: Urdf) -> None:
    """Refuse joints of unknown links, links with two parents, loops, and several roots."""
    parent: dict[str, str] = {}
    for joint in urdf.joints:
        for link in (joint.parent, joint.child):
            _require(link in urdf.links, urdf.source, "unknown link", joint.name, link)
        above = parent.get(joint.child)
        _require(above is None, urdf.source, "two parents", joint.child, above, joint.name)
        _require(joint.name not in parent.values(), urdf.source, "twice", "joint", joint.name)
        parent[joint.child] = joint.name
    roots = [name for name in urdf.links if name not in parent]
    what = f"{len(roots)} roots ({listed(roots)})" if roots else "no root: its joints are a loop"
    _require(len(roots) == 1, urdf.source, "roots", what)
    loose = urdf.links.keys() - {urdf.root} - {joint.child for joint in urdf.below()}
    _require(not loose, urdf.source, "loop", listed(loose))


def _limited_joint(element: ET.Element, source: str) -> UrdfJoint:
    joint, limit = joint_of(element, source), element.find("limit")
    where = f"{source}: joint {joint.name}"
    bounded = limit if joint.kind == "revolute" else None
    return replace(
        joint,
        lower=_number(bounded, "lower", where),
        upper=_number(bounded, "upper", where),
        speed=_number(limit, "velocity", where),
    )


def _inertial(element: ET.Element, where: str) -> Link | None:
    inertial = element.find("inertial")
    if inertial is None:
        return None
    tensor, origin = inertial.find("inertia"), inertial.find("origin")
    mass = _number(inertial.find("mass"), "value", where)
    _require(mass is not None and tensor is not None, where, "half an inertial")
    if not mass or mass < 0.0:
        return None  # a mere frame; the specification asks for none
    xx, yy, zz, xy, xz, yz = (
        _number(tensor, key, where) or 0.0 for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    turn = Rotation.from_euler("xyz", _triple(origin, "rpy", where)).as_matrix()
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return Link(mass, np.array(_triple(origin, "xyz", where)), inertia)


def _name(element: ET.Element, source: str) -> str:
    name = element.get("name", "")
    _require(name, source, "no name", element.tag)
    return name


def _triple(
    element: ET.Element | None, key: str, where: str, default: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> tuple[float, ...]:
    text = None if element is None else element.get(key)
    if text is None:
        return default
    _require(not re.search(r"\$[{(]", text), where, "expression", key, text)
    words = text.split()
    _require(len(words) == 3, where, "not three", key, text)
    return tuple(_to_number(word, key, where) for word in words)


def _number(element: ET.Element | None, key: str, where: str) -> float | None:
    text = None if element is None else element.get(key)
    return None if text is None else _to_number(text, key, where)


def _to_number(text: str, key: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    _require(np.isfinite(value), where, "no number", key, text)
    return value


def _require(condition: object, where: str, refusal: str, *values: object) -> None:
    """Raises DescriptionError of a kind of _REFUSALS where a condition does not hold."""
    if not condition:
        raise DescriptionError(f"{where}: {_REFUSALS[refusal].format(*values)}")
