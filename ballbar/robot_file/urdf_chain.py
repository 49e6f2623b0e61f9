"""One serial chain of turning joints of a URDF, its axes, and the bodies that turn with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.bodies import joined_link
from ballbar.cell.descriptions import Link
from ballbar.cell.dh_from_axes import JointAxes
from ballbar.cell.errors import DescriptionError
from ballbar.robot_file.urdf import TURNING, Urdf, UrdfJoint, listed


@dataclass(frozen=True, eq=False)
class UrdfChain:
    """A serial chain of turning joints between two links of a URDF."""

    base: str
    tip: str
    joints: tuple[UrdfJoint, ...]  # J turning joints
    # J + 1 poses (4, 4) [m] of each joint's parent link, in the base or the child link of the joint
    # before; the last of the tip
    before: tuple[Array, ...]

    @property
    def fixed(self) -> tuple[Array, ...]:
        """J + 1 poses (4, 4) [m]: up to each joint, and from the last to the tip."""
        joints = zip(self.before, self.joints, strict=False)
        return (*(pose @ joint.pose for pose, joint in joints), self.before[-1])

    def tip_poses(self, q: Array) -> Array:
        """(N, 4, 4) [m] poses T_base_tip at joint positions q (N, J) [rad]."""
        first, *behind = self.fixed
        poses = np.broadcast_to(first, (len(q), 4, 4))
        for i, joint in enumerate(self.joints):
            unit = np.array(joint.axis) / np.linalg.norm(joint.axis)
            turn = np.tile(np.eye(4), (len(q), 1, 1))
            turn[:, :3, :3] = Rotation.from_rotvec(q[:, i : i + 1] * unit).as_matrix()
            poses = poses @ turn @ behind[i]
        return np.asarray(poses)

    def axes(self) -> JointAxes:
        """Points (J, 3) [m] and directions (J, 3) of the joint axes at joint positions zero."""
        pose, points, directions, fixed = np.eye(4), [], [], self.fixed
        for i, joint in enumerate(self.joints):
            pose = pose @ fixed[i]
            points.append(pose[:3, 3])
            directions.append(pose[:3, :3] @ joint.axis / np.linalg.norm(joint.axis))
        return JointAxes(np.array(points), np.array(directions), pose @ fixed[-1])


def chain_between(urdf: Urdf, base: str | None = None, tip: str | None = None) -> UrdfChain:
    """The chain of turning joints from link `base` to link `tip`; fixed joints are folded in.

    base : by default the root. Any link that is rigidly connected with the chain's beginning.
    tip : by default the end of the longest chain of turning joints; tool0 where several frames are
        fixed to the last joint.

    Raises DescriptionError if there is no such chain, it is ambiguous, or holds another joint.
    """
    for link in (base, tip):
        if link is not None and link not in urdf.links:
            raise _refused(urdf, f"there is no link {link}. Links: {listed(urdf.links)}.")
    start, end = base or urdf.root, tip or _longest_tip(urdf)
    to_base, to_tip = urdf.joints_to(start), urdf.joints_to(end)
    while to_base and to_tip and to_base[0] is to_tip[0]:
        to_base, to_tip = to_base[1:], to_tip[1:]
    pose = np.eye(4)
    for joint in to_base:
        if joint.kind != "fixed":
            raise _refused(
                urdf,
                f"link {base} hangs on the {joint.kind} joint {joint.name}, beside the chain to "
                f"{end}. Choose a --base that does not move.",
            )
        pose = pose @ joint.pose
    before: list[Array] = [inverse_pose(pose)]
    moving = []
    for joint in to_tip:
        if joint.kind == "fixed":
            before[-1] = before[-1] @ joint.pose
            continue
        if not joint.turns:
            fault = (
                f"is {joint.kind}; only turning joints have rows here. Choose --base and --tip on "
                "the same side of it."
                if joint.kind not in TURNING
                else f"mimics {joint.mimics}, so it is no axis of its own. Describe the arm "
                "without the coupled joint."
            )
            raise _refused(urdf, f"joint {joint.name} {fault}")
        moving.append(joint)
        before.append(np.eye(4))
    if not moving:
        raise _refused(urdf, f"no joint turns between {start} and {end}. Name --base and --tip.")
    return UrdfChain(start, end, tuple(moving), tuple(before))


def bodies(urdf: Urdf, chain: UrdfChain) -> tuple[Link, ...] | str:
    """Mass properties of base and links 1 to J, in the chain's base frame at joint angles zero.

    What is rigidly connected is one body. Returns the reason as a sentence where they are not
    known: a body without inertial, or a link that moves beside the chain.
    """
    number = {joint.name: i + 1 for i, joint in enumerate(chain.joints)}
    T_root_base = np.eye(4)
    for joint in urdf.joints_to(chain.base):
        T_root_base = T_root_base @ joint.pose
    placed = {urdf.root: (0, inverse_pose(T_root_base))}  # body, 0 the base, and pose T_base_link
    for joint in urdf.below(number):
        body, pose = placed[joint.parent]
        placed[joint.child] = number.get(joint.name, body), pose @ joint.pose
    parts: list[list[Link]] = [[] for _ in range(len(chain.joints) + 1)]
    for name, link in urdf.links.items():
        if name not in placed:
            return f"link {name} moves beside the chain, on joint {urdf.parent_joint[name].name}"
        if link is not None:
            body, pose = placed[name]
            turn = pose[:3, :3]
            com, inertia = turn @ link.com + pose[:3, 3], turn @ link.inertia @ turn.T
            parts[body].append(Link(link.mass, com, inertia))
    names = ["the base", *(f"the link behind {joint.name}" for joint in chain.joints)]
    if empty := [name for name, members in zip(names, parts, strict=True) if not members]:
        return f"{empty[0]} has no inertial"
    combined = tuple(joined_link(members) for members in parts)
    for name, body_link in zip(names, combined, strict=True):
        moments = np.linalg.eigvalsh(body_link.inertia)
        if moments[0] <= 0.0 or moments[2] > moments[0] + moments[1]:
            return f"the inertia of {name} is not that of a body"
    return combined


def _longest_tip(urdf: Urdf) -> str:
    """The last link of the longest chain of turning joints from the root."""
    paths = {link: urdf.joints_to(link) for link in urdf.links}
    turning = {link: [j for j in path if j.turns] for link, path in paths.items()}
    moving = {link: [j for j in path if j.kind != "fixed"] for link, path in paths.items()}
    plain = {link for link in paths if turning[link] == moving[link]}
    longest = max(len(joints) for joints in turning.values())
    most = max(len(turning[link]) for link in plain)
    if most < longest:  # it holds another joint, which is then named
        plain, most = set(paths), longest
    ends = [link for link in paths if link in plain and len(turning[link]) == most]
    last = {turning[link][-1].name for link in ends if turning[link]}
    if len(last) > 1:
        raise _refused(
            urdf,
            f"several chains have {most} turning joints; they end with {listed(last)}. Name the "
            "end of one with --tip.",
        )
    parents = {joint.parent for joint in urdf.joints}
    leaves = [link for link in ends if link not in parents] or ends
    tools = [link for link in ends if link.endswith("tool0")]
    if len(leaves) > 1 and len(tools) != 1:
        raise _refused(
            urdf, f"several links are the end of the chain. Name one with --tip: {listed(leaves)}."
        )
    return (tools or leaves)[0]


def inverse_pose(pose: Array) -> Array:
    """(4, 4) [m] inverse of a pose (4, 4) [m]."""
    return np.asarray(np.linalg.inv(pose), dtype=np.float64)


def _refused(urdf: Urdf, text: str) -> DescriptionError:
    return DescriptionError(f"{urdf.source}: {text}")
