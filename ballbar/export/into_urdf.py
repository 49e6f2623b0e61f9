"""`ballbar export --into`: an existing URDF or xacro with the identified joint origins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbar.export.new_origins import check_new_chain, matched, new_origins
from ballbar.export.result import AnyResult
from ballbar.export.urdf_text import JointText, before_origin, chain_of, joints_in, with_origins
from cell.arrays import Array
from cell.errors import InputError
from cell.urdf import TURNING


@dataclass(frozen=True, eq=False)
class ChangedFile:
    """A robot's file with other joint origins."""

    content: bytes
    joints: tuple[str, ...]  # in the order of the axes
    shift: Array  # (J,) [m] of each origin
    turn: Array  # (J,) [rad]
    error: float  # [m] largest, of the chain as read back against the identified one


def into_file(result: AnyResult, file: Path, joints: Sequence[str] = ()) -> ChangedFile:
    """A URDF or xacro with joint origins of the identified geometry, all else as it was.

    joints : turning joints from base to tip; by default the only chain of as many as the robot has.

    Raises InputError where the file is not of this robot, or a number is an expression.
    """
    if not file.is_file():
        raise InputError(f"{file}: no such file. Name a URDF or xacro of the robot.")
    content = file.read_bytes()
    written = joints_in(content, file)
    names = list(joints) or _only_chain(written, result.robot.joints, file)
    chain, source = chain_of(written, names, file), str(file)
    match = matched(result.robot, result.nominal, chain, source)
    before = before_origin(written, names, file)
    origins, tip = new_origins(match, result.nominal, result.chain, chain, before)
    changed = [written[joint.name] for joint in chain.joints]
    text = with_origins(content, list(zip(changed, origins, strict=True)))
    again = chain_of(joints_in(text, file), names, file)
    error = check_new_chain(result.robot, match, result.chain, tip, again, source)
    pairs = list(zip(origins, (joint.pose for joint in chain.joints), strict=True))
    return ChangedFile(
        content=text,
        joints=tuple(joint.name for joint in chain.joints),
        shift=np.array([np.linalg.norm(new[:3, 3] - old[:3, 3]) for new, old in pairs]),
        turn=np.array([_angle(new[:3, :3].T @ old[:3, :3]) for new, old in pairs]),
        error=error,
    )


def changed_lines(changed: ChangedFile, result: AnyResult) -> list[str]:
    """Lines of text: how far every origin moved, and what the file does not hold."""
    each = [
        f"  {name}: {shift * 1e3:.3f} mm, {turn * 1e3:.3f} mrad"
        for name, shift, turn in zip(changed.joints, changed.shift, changed.turn, strict=True)
    ]
    return [
        "origins of joints, changed by:",
        *each,
        f"read back, the chain agrees with the identified one within {changed.error:.1e} m",
        f"Not in it: {'; '.join(result.left_out)}",
        *result.range_notes,
    ]


def _only_chain(joints: dict[str, JointText], count: int, file: Path) -> list[str]:
    """The turning joints of the only serial chain of `count`; fixed joints may lie between."""
    turning = {n: j for n, j in joints.items() if j.kind in TURNING and not j.mimics}
    by_child = {joint.child: joint for joint in joints.values()}
    chains = []
    for joint in turning.values():
        path = _path_to(joint, by_child)
        names = [j.name for j in path if j.name in turning]
        others = [j for j in path if j.kind != "fixed" and j.name not in turning]
        if len(names) == count and not others:
            chains.append(names)
    if len(chains) != 1:
        what = "several chains" if chains else "no chain"
        raise InputError(
            f"{file}: {what} of {count} turning joints; the file has {', '.join(turning) or 'none'}"
            ". Name them from base to tip with --joints a,b,c."
        )
    return chains[0]


def _path_to(joint: JointText, by_child: dict[str, JointText]) -> list[JointText]:
    """The joints from the root to a joint, itself included."""
    path, seen = [joint], {joint.name}
    while (above := by_child.get(path[-1].parent)) is not None and above.name not in seen:
        path.append(above)
        seen.add(above.name)
    return path[::-1]


def _angle(rotation: Array) -> float:
    """[rad] of a rotation, exact also for small ones."""
    axial = rotation[[2, 0, 1], [1, 2, 0]] - rotation[[1, 2, 0], [2, 0, 1]]
    return float(np.arctan2(np.linalg.norm(axial), np.trace(rotation) - 1.0))
