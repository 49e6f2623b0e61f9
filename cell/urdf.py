"""Robots described in URDF, the XML format of ROS: links, joints, and one serial chain of them.

Source: the URDF XML specification of ROS (wiki.ros.org/urdf/XML). Read are the kinematic tree, the
limits of the joints and the inertials of the links; meshes, materials and transmissions are not.
Document types and entities are refused: no URDF needs them, and a few lines of them expand to
gigabytes.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from cell.arrays import Array
from cell.descriptions import Link
from cell.dh_from_axes import JointAxes
from cell.errors import DescriptionError

TURNING = ("revolute", "continuous")
# Angles of origins this near to a multiple of 15 deg stand for it: files print them with 6 to 10
# digits (1.5708, 1.570796327).
ROUND_ANGLE, ROUNDING = np.pi / 12.0, 1e-5  # [rad]
MAX_LINKS = 1000  # far above any robot in its cell


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
    lower: float | None  # [rad]
    upper: float | None  # [rad]
    speed: float | None  # [rad/s]
    mimics: str | None  # joint that this one follows

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

    def joints_to(self, link: str) -> list[UrdfJoint]:
        """The joints from the root to a link, in this order."""
        path = []
        while joint := self.parent_joint.get(link):
            path.append(joint)
            link = joint.parent
        return path[::-1]


@dataclass(frozen=True, eq=False)
class UrdfChain:
    """A serial chain of turning joints between two links of a URDF."""

    base: str
    tip: str
    joints: tuple[UrdfJoint, ...]  # J turning joints
    fixed: tuple[Array, ...]  # J + 1 poses (4, 4) [m]: up to each joint, and from the last to tip

    def tip_poses(self, q: Array) -> Array:
        """(N, 4, 4) [m] poses T_base_tip at joint positions q (N, J) [rad]."""
        poses = np.broadcast_to(self.fixed[0], (len(q), 4, 4))
        for i, joint in enumerate(self.joints):
            unit = np.array(joint.axis) / np.linalg.norm(joint.axis)
            turned = np.tile(np.eye(4), (len(q), 1, 1))
            turned[:, :3, :3] = Rotation.from_rotvec(q[:, i : i + 1] * unit).as_matrix()
            poses = poses @ turned @ self.fixed[i + 1]
        return np.asarray(poses)

    def axes(self) -> JointAxes:
        """Points (J, 3) [m] and directions (J, 3) of the joint axes at joint positions zero."""
        pose, points, directions = np.eye(4), [], []
        for i, joint in enumerate(self.joints):
            pose = pose @ self.fixed[i]
            points.append(pose[:3, 3])
            directions.append(pose[:3, :3] @ joint.axis / np.linalg.norm(joint.axis))
        return JointAxes(np.array(points), np.array(directions), pose @ self.fixed[-1])


def parse_urdf(text: str, source: str) -> Urdf:
    """The robot of a URDF text; source : its file, for messages.

    Raises DescriptionError if the text is no URDF, or its joints do not form a tree.
    """
    if declared := re.search(r"<!(DOCTYPE|ENTITY)", text):
        raise DescriptionError(
            f"{source}: holds <!{declared[1]}>, which is refused. A URDF needs none: remove it."
        )
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError) as error:
        raise DescriptionError(
            f"{source}: not valid XML: {error}. Export the file again."
        ) from None
    if root.tag != "robot":
        raise DescriptionError(
            f"{source}: the outermost element is <{root.tag}>, a URDF has <robot>. Name the URDF."
        )
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise DescriptionError(
            f"{source}: holds xacro macros. Expand them first: xacro FILE.xacro > robot.urdf"
        )
    links = {}
    for element in root.findall("link"):
        name = _name(element, source)
        if name in links:
            raise DescriptionError(f"{source}: link {name} stands here twice. Rename one.")
        links[name] = _inertial(element, f"{source}: link {name}")
    if not links:
        raise DescriptionError(f"{source}: holds no link. Name the URDF of the robot.")
    if len(links) > MAX_LINKS:
        raise DescriptionError(
            f"{source}: {len(links)} links, more than {MAX_LINKS}. Leave out all but the robot."
        )
    joints = tuple(_joint(element, source) for element in root.findall("joint"))
    urdf = Urdf(source, root.get("name") or "robot", links, joints)
    _check_tree(urdf)
    return urdf


def with_round_angles(urdf: Urdf) -> Urdf:
    """The same robot with angles of origins put to multiples of 15 deg within ROUNDING."""
    return replace(
        urdf,
        joints=tuple(replace(j, rpy=tuple(_round_angle(a) for a in j.rpy)) for j in urdf.joints),
    )


def chain_between(urdf: Urdf, base: str | None = None, tip: str | None = None) -> UrdfChain:
    """The chain of turning joints from link `base` to link `tip`; fixed joints are folded in.

    base : by default the root. Any link that is rigidly connected with the chain's beginning.
    tip : by default the end of the longest chain of turning joints; tool0 where several frames are
        fixed to the last joint.

    Raises DescriptionError if there is no such chain, it is ambiguous, or holds another joint.
    """
    for link in (base, tip):
        if link is not None and link not in urdf.links:
            raise DescriptionError(
                f"{urdf.source}: there is no link {link}. Links: {_listed(urdf.links)}."
            )
    (root,) = [name for name in urdf.links if name not in urdf.parent_joint]
    end = tip or _longest_tip(urdf)
    to_base, to_tip = urdf.joints_to(base or root), urdf.joints_to(end)
    while to_base and to_tip and to_base[0] is to_tip[0]:
        to_base, to_tip = to_base[1:], to_tip[1:]
    for joint in to_base:
        if joint.kind != "fixed":
            raise DescriptionError(
                f"{urdf.source}: link {base} hangs on the {joint.kind} joint {joint.name}, beside "
                f"the chain to {end}. Choose a --base that does not move."
            )
    pose = np.eye(4)
    for joint in to_base:
        pose = pose @ joint.pose
    fixed: list[Array] = [_inverse(pose)]
    moving = []
    for joint in to_tip:
        fixed[-1] = fixed[-1] @ joint.pose
        if joint.kind != "fixed":
            _check_turning(urdf, joint)
            moving.append(joint)
            fixed.append(np.eye(4))
    if not moving:
        raise DescriptionError(
            f"{urdf.source}: no joint turns between {base or root} and {end}. "
            "Name --base and --tip."
        )
    return UrdfChain(base or root, end, tuple(moving), tuple(fixed))


def bodies(urdf: Urdf, chain: UrdfChain) -> tuple[Link, ...] | str:
    """Mass properties of base and links 1 to J, in the chain's base frame at joint angles zero.

    What is rigidly connected is one body. Returns the reason as a sentence where they are not
    known: a body without inertial, or a link that moves beside the chain.
    """
    body_of, pose_of = _placed(urdf, chain)
    parts: list[list[tuple[Link, Array]]] = [[] for _ in range(len(chain.joints) + 1)]
    for name, link in urdf.links.items():
        if name not in body_of:
            return f"link {name} moves beside the chain, on joint {urdf.parent_joint[name].name}"
        if link is not None:
            parts[body_of[name]].append((link, pose_of[name]))
    names = ["the base", *(f"the link behind {joint.name}" for joint in chain.joints)]
    for name, members in zip(names, parts, strict=True):
        if not members:
            return f"{name} has no inertial"
    combined = tuple(_combined(members) for members in parts)
    for name, body in zip(names, combined, strict=True):
        moments = np.linalg.eigvalsh(body.inertia)
        if moments[0] <= 0.0 or moments[2] > moments[0] + moments[1]:
            return f"the inertia of {name} is not that of a body"
    return combined


def _placed(urdf: Urdf, chain: UrdfChain) -> tuple[dict[str, int], dict[str, Array]]:
    """Body (0 is the base) and pose T_base_link at zero of every link that belongs to one."""
    number = {joint.name: i + 1 for i, joint in enumerate(chain.joints)}
    (root,) = [name for name in urdf.links if name not in urdf.parent_joint]
    T_root_base = np.eye(4)
    for joint in urdf.joints_to(chain.base):
        T_root_base = T_root_base @ joint.pose
    body_of, pose_of = {root: 0}, {root: _inverse(T_root_base)}
    children: dict[str, list[UrdfJoint]] = {}
    for joint in urdf.joints:
        children.setdefault(joint.parent, []).append(joint)
    open_links = [root]
    while open_links:
        link = open_links.pop()
        for joint in children.get(link, ()):
            if joint.kind != "fixed" and joint.name not in number:
                continue
            body_of[joint.child] = number.get(joint.name, body_of[link])
            pose_of[joint.child] = pose_of[link] @ joint.pose
            open_links.append(joint.child)
    return body_of, pose_of


def _combined(members: list[tuple[Link, Array]]) -> Link:
    """One body of several: inertias about the common centre of mass (parallel axes)."""
    mass = sum(link.mass for link, _ in members)
    coms = [pose[:3, :3] @ link.com + pose[:3, 3] for link, pose in members]
    com = sum((link.mass * c for (link, _), c in zip(members, coms, strict=True)), np.zeros(3))
    com = com / mass
    inertia = np.zeros((3, 3))
    for (link, pose), c in zip(members, coms, strict=True):
        turned = pose[:3, :3] @ link.inertia @ pose[:3, :3].T
        r = c - com
        inertia += turned + link.mass * ((r @ r) * np.eye(3) - np.outer(r, r))
    return Link(mass, com, 0.5 * (inertia + inertia.T))


def _inverse(pose: Array) -> Array:
    return np.asarray(np.linalg.inv(pose), dtype=np.float64)


def _longest_tip(urdf: Urdf) -> str:
    """The last link of the longest chain of turning joints from the root."""
    paths = {link: urdf.joints_to(link) for link in urdf.links}
    turning = {
        link: [j for j in path if j.kind in TURNING and j.mimics is None]
        for link, path in paths.items()
    }
    plain = {link for link in paths if len(turning[link]) == _moving_count(paths[link])}
    most = max(len(turning[link]) for link in plain)
    if most < max(len(joints) for joints in turning.values()):  # the longest holds another joint
        plain = set(paths)
        most = max(len(joints) for joints in turning.values())
    ends = [link for link in paths if link in plain and len(turning[link]) == most]
    last = {turning[link][-1].name for link in ends if turning[link]}
    if len(last) > 1:
        raise DescriptionError(
            f"{urdf.source}: several chains have {most} turning joints; they end with "
            f"{_listed(last)}. Name the end of one with --tip."
        )
    parents = {joint.parent for joint in urdf.joints}
    leaves = [link for link in ends if link not in parents] or ends
    tools = [link for link in ends if link.endswith("tool0")]
    if len(leaves) > 1 and len(tools) != 1:
        raise DescriptionError(
            f"{urdf.source}: several links are the end of the chain. Name one with --tip: "
            f"{_listed(leaves)}."
        )
    return (tools or leaves)[0]


def _moving_count(path: list[UrdfJoint]) -> int:
    return sum(joint.kind != "fixed" for joint in path)


def _check_turning(urdf: Urdf, joint: UrdfJoint) -> None:
    if joint.kind not in TURNING:
        raise DescriptionError(
            f"{urdf.source}: joint {joint.name} is {joint.kind}; only turning joints have rows "
            "here. Choose --base and --tip on the same side of it."
        )
    if joint.mimics is not None:
        raise DescriptionError(
            f"{urdf.source}: joint {joint.name} mimics {joint.mimics}, so it is no axis of its "
            "own. Describe the arm without the coupled joint."
        )


def _check_tree(urdf: Urdf) -> None:
    """Refuse joints of unknown links, links with two parents, loops, and several roots."""
    seen: dict[str, str] = {}
    names: set[str] = set()
    for joint in urdf.joints:
        for link in (joint.parent, joint.child):
            if link not in urdf.links:
                raise DescriptionError(
                    f"{urdf.source}: joint {joint.name}: there is no link {link}. Correct the name."
                )
        if joint.child in seen:
            raise DescriptionError(
                f"{urdf.source}: link {joint.child} is the child of joints {seen[joint.child]} and "
                f"{joint.name}. A URDF is a tree: remove one."
            )
        if joint.name in names:
            raise DescriptionError(f"{urdf.source}: joint {joint.name} stands here twice. Rename.")
        seen[joint.child] = joint.name
        names.add(joint.name)
    roots = [name for name in urdf.links if name not in urdf.parent_joint]
    if len(roots) != 1:
        what = (
            f"{len(roots)} roots ({_listed(roots)})" if roots else "no root: its joints are a loop"
        )
        raise DescriptionError(
            f"{urdf.source}: the links have {what}. A URDF is one tree: connect them with joints."
        )
    reached = {roots[0]}
    children: dict[str, list[str]] = {}
    for joint in urdf.joints:
        children.setdefault(joint.parent, []).append(joint.child)
    waiting = [roots[0]]
    while waiting:
        below = children.get(waiting.pop(), [])
        reached.update(below)
        waiting += below
    if loose := [name for name in urdf.links if name not in reached]:
        raise DescriptionError(
            f"{urdf.source}: links {_listed(loose)} form a loop. A URDF is a tree: open it."
        )


def _joint(element: ET.Element, source: str) -> UrdfJoint:
    name = _name(element, source)
    where = f"{source}: joint {name}"
    kind = element.get("type", "")
    kinds = (*TURNING, "prismatic", "fixed", "floating", "planar")
    if kind not in kinds:
        raise DescriptionError(f"{where}: type {kind!r} is none of {', '.join(kinds)}.")
    origin, axis, limit = element.find("origin"), element.find("axis"), element.find("limit")
    mimic = element.find("mimic")
    direction = _triple(axis, "xyz", where, default=(1.0, 0.0, 0.0))
    if kind in TURNING and not np.linalg.norm(direction) > 0.0:
        raise DescriptionError(f"{where}: the axis is 0 0 0. Write its direction.")
    bounded = limit is not None and kind == "revolute"
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=_linked(element, "parent", where),
        child=_linked(element, "child", where),
        xyz=_triple(origin, "xyz", where),
        rpy=_triple(origin, "rpy", where),
        axis=direction,
        lower=_number(limit, "lower", where) if bounded else None,
        upper=_number(limit, "upper", where) if bounded else None,
        speed=_number(limit, "velocity", where),
        mimics=None if mimic is None else mimic.get("joint", "another joint"),
    )


def _inertial(element: ET.Element, where: str) -> Link | None:
    inertial = element.find("inertial")
    if inertial is None:
        return None
    mass, tensor = _number(inertial.find("mass"), "value", where), inertial.find("inertia")
    if mass is None or tensor is None:
        raise DescriptionError(
            f"{where}: its inertial lacks mass or inertia. Complete or remove it."
        )
    if mass <= 0.0:
        return None  # a mere frame; the specification asks for none
    xx, yy, zz, xy, xz, yz = (
        _number(tensor, key, where) or 0.0 for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    origin = inertial.find("origin")
    turn = Rotation.from_euler("xyz", _triple(origin, "rpy", where)).as_matrix()
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return Link(mass, np.array(_triple(origin, "xyz", where)), inertia)


def _name(element: ET.Element, source: str) -> str:
    name = element.get("name")
    if not name:
        raise DescriptionError(f"{source}: a {element.tag} has no name. Give it one.")
    return name


def _linked(element: ET.Element, tag: str, where: str) -> str:
    link = element.find(tag)
    name = None if link is None else link.get("link")
    if not name:
        raise DescriptionError(f'{where}: names no {tag}. Write <{tag} link="..."/>.')
    return name


def _triple(
    element: ET.Element | None, key: str, where: str, default: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> tuple[float, ...]:
    text = None if element is None else element.get(key)
    if text is None:
        return default
    words = text.split()
    if len(words) != 3:
        raise DescriptionError(f"{where}: {key} = {text!r}. Write three numbers.")
    return tuple(_to_number(word, key, where) for word in words)


def _number(element: ET.Element | None, key: str, where: str) -> float | None:
    text = None if element is None else element.get(key)
    return None if text is None else _to_number(text, key, where)


def _to_number(text: str, key: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise DescriptionError(f"{where}: {key} = {text!r} is no finite number. Correct it.")
    return value


def _round_angle(angle: float) -> float:
    nearest = round(angle / ROUND_ANGLE) * ROUND_ANGLE
    return float(nearest) if abs(angle - nearest) < ROUNDING else angle


def _listed(names: Mapping[str, object] | Iterator[str] | set[str] | list[str]) -> str:
    """At most eight names."""
    every = sorted(names)
    return ", ".join(every[:8]) + (f" and {len(every) - 8} more" if len(every) > 8 else "")
