"""Other contents that the columns of the robot's log may have than those declared.

Two of its motors, axes or joints exchanged; one that counts backwards; angles of another kind or
in another unit. Each is an affine map of the joint angles as read,

    q' = q matrix + offset,

because joint angles are an affine map of motor angles, of the controller's axis angles and of
themselves, and a unit is a factor.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot

PLURAL = {"axis": "axes", "motor": "motors", "joint": "joints"}
# What a number in the log counts for, once read in the right unit, and the unit that it is in.
UNITS = ((np.pi / 180.0, "degrees", "rad"), (1.0, "", ""), (180.0 / np.pi, "rad", "degrees"))


@dataclass(frozen=True, eq=False)
class OtherAngles:
    """One mistake in the robot's log, and the joint angles once it is corrected."""

    cause: str
    matrix: Array  # (J, J)
    offset: Array  # (J,) [rad]

    def joints(self, q: Array) -> Array:
        """(N, J) [rad] corrected joint angles of those that were read, (N, J) [rad]."""
        return np.asarray(q @ self.matrix + self.offset)

    def is_as(self, other: OtherAngles) -> bool:
        """Whether both correct the log in the same way."""
        same = np.allclose(self.matrix, other.matrix)
        return same and np.allclose(self.offset, other.offset)


def other_angles(robot: Robot) -> list[OtherAngles]:
    """Every mistake in a robot's log that is tried; no two of them have the same correction."""
    tried, distinct = list[OtherAngles](), list[OtherAngles]()
    for kind, (to_joint, zero) in angle_kinds(robot).items():
        for cause, change in _changes(kind, robot.joints):
            matrix = np.linalg.inv(to_joint) @ change @ to_joint
            tried.append(OtherAngles(cause, matrix, zero - zero @ matrix))
    for mistake in (*tried, *_other_kinds(robot)):
        if not any(mistake.is_as(other) for other in distinct):
            distinct.append(mistake)
    return distinct


def angle_kinds(robot: Robot) -> dict[str, tuple[Array, Array]]:
    """(J, J) matrix and (J,) [rad] zero of each kind of angles: joints = angles matrix + zero."""
    none = np.zeros(robot.joints)
    return {
        "axis": (robot.controller_to_joint, robot.controller_offset),
        "motor": (robot.transmission, none),
        "joint": (np.eye(robot.joints), none),
    }


def _changes(kind: str, n: int) -> Iterator[tuple[str, Array]]:
    for i in range(n):
        signs = np.ones(n)
        signs[i] = -1.0
        yield f"{kind} {i + 1} of the robot's log counts backwards", np.diag(signs)
    for i, j in combinations(range(n), 2):
        order = np.arange(n)
        order[[i, j]] = j, i
        cause = (
            f"the columns of {PLURAL[kind]} {i + 1} and {j + 1} of the robot's log are exchanged"
        )
        yield cause, np.eye(n)[order]


def _other_kinds(robot: Robot) -> Iterator[OtherAngles]:
    """Angles of each kind that were read as those of each kind, in either unit."""
    identity = OtherAngles("", np.eye(robot.joints), np.zeros(robot.joints))
    kinds = angle_kinds(robot).items()
    for (read, (to_joint, zero)), (kind, (matrix, offset)) in product(kinds, repeat=2):
        for factor, unit, declared in UNITS:
            if kind == read:
                cause = f"the robot's log is in {unit} and was read as {declared}"
            elif unit:
                cause = f"the robot's log holds {kind} angles in {unit}, and was read otherwise"
            else:
                cause = f"the robot's log holds {kind} angles, and was read otherwise"
            change = factor * np.linalg.inv(to_joint) @ matrix
            mistake = OtherAngles(cause, change, offset - zero @ change)
            if not mistake.is_as(identity):
                yield mistake
