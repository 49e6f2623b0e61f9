"""Test cube of ISO 9283:1998, clause 6.8, and its five test poses.

The cube lies in the most used part of the workspace, its edges parallel to the axes of the base
frame. Its corners C1 to C4 bound the lower face, counted about z from the one nearest to the
negative x and y, C5 to C8 stand above them. The poses P1 to P5 lie in the plane C1-C2-C7-C8: P1 in
the centre, the others on its diagonals, a tenth of their length (+- 2 %) from the corners in the
order of the plane's name.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.numerical_inverse import length_of
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.identified_kinematics import IdentifiedKinematics

SIDES = (1.0, 0.63, 0.4, 0.25)  # [m] edges that the standard prefers
PLANE = ((-1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (1.0, 1.0, 1.0), (1.0, -1.0, 1.0))  # C1 C2 C7 C8
FROM_END = 0.1  # of a diagonal
TILTS = np.deg2rad([180.0, 135.0, 90.0])  # of the flange's axis from the vertical that are tried
STEPS = range(-6, 7)  # of the centre that are tried
STEP = 0.12  # of half the length of the robot's chain
CLEAR = 0.1  # of the same, between the cube and the axis of the base


@dataclass(frozen=True, eq=False)
class TestCube:
    """A cube whose five poses the nominal robot takes."""

    __test__ = False  # no test of pytest

    side: float  # [m]
    poses: Array  # (5, 4, 4) P1 to P5 of the tool, robot base frame
    q: Array  # (5, J) [rad] joint angles of the nominal robot


def cube_points(side: float, centre: Array) -> Array:
    """(5, 3) [m] positions of P1 to P5 of a cube with an edge [m] about a centre (3,) [m]."""
    share = 1.0 - 2.0 * FROM_END
    return np.asarray(centre + 0.5 * side * share * np.array([(0.0, 0.0, 0.0), *PLANE]))


def fitting_cube(
    nominal: IdentifiedKinematics, identified: IdentifiedRobot, side: float | None = None
) -> TestCube | None:
    """The largest standard cube whose poses the nominal robot takes within its ranges.

    Preferred are those within the fitted ranges of the identified robot, where something is stated.
    side : [m] of the only cube that is tried. None where no cube fits.
    """
    sides, outside = SIDES if side is None else (side,), None
    for edge, tilt in product(sides, TILTS):
        poses = np.array(list(_candidates(nominal, edge, tilt))).reshape(-1, 5, 4, 4)
        taken, q = _taken(nominal, poses)
        covered = identified.covered(q.reshape(-1, q.shape[-1])).reshape(-1, 5).all(axis=1)
        for k in taken[covered][:1]:
            return TestCube(edge, poses[k], q[covered][0])
        if outside is None and taken.size:
            outside = TestCube(edge, poses[taken[0]], q[0])
    return outside


def _candidates(nominal: IdentifiedKinematics, side: float, tilt: float) -> Iterator[Array]:
    """Poses (5, 4, 4) of cubes in front of the robot, those nearest to the middle first.

    No cube reaches below the base or holds the robot's column.
    """
    reach = length_of(nominal.nominal)
    ends = nominal.forward(accuracy_grid(nominal.robot))[:, :3, 3]
    away, height = (float(np.median(v)) for v in (np.linalg.norm(ends[:, :2], axis=1), ends[:, 2]))
    front = nominal.forward(_home(nominal)[None])[0, :2, 3]
    size = float(np.linalg.norm(front))
    ahead = front / size if size > CLEAR * reach else np.array([1.0, 0.0])
    azimuth = float(np.arctan2(ahead[1], ahead[0]))
    # the flange's axis, upward at no tilt, leans ahead
    lean, turn = matrix_from_rotvec(np.array([[0.0, 0.0], [tilt, 0.0], [0.0, azimuth]])).T
    turn = (lean @ turn).T
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :3, :3] = turn @ nominal.identified.tool_matrix[:3, :3]
    for out, up in sorted(product(STEPS, STEPS), key=lambda s: s[0] ** 2 + s[1] ** 2):
        centre = np.array([*((away + STEP * reach * out) * ahead), height + STEP * reach * up])
        column = float(np.abs(centre[:2]).max()) - 0.5 * side
        if column >= CLEAR * reach and centre[2] >= 0.5 * side:
            poses[:, :3, 3] = cube_points(side, centre)
            yield poses.copy()


def _home(nominal: IdentifiedKinematics) -> Array:
    """(J,) [rad] joint angles in the middle of the ranges of the accuracy grid."""
    robot = nominal.robot
    return controller_to_joints(robot, 0.5 * (robot.accuracy_lower + robot.accuracy_upper))


def _taken(nominal: IdentifiedKinematics, poses: Array) -> tuple[NDArray[np.intp], Array]:
    """Which of K cubes the robot takes, away from singular postures, and their joint angles (., 5,
    J) [rad] in one configuration each. poses : (K, 5, 4, 4)
    """
    q = np.full((*poses.shape[:2], nominal.robot.joints), np.nan)
    rows, previous = np.arange(len(poses)), np.tile(_home(nominal), (len(poses), 1))
    for k in range(poses.shape[1]):
        solved = nominal.nearest(poses[rows, k], previous)
        q[rows, k] = solved.q
        taken = solved.reached & solved.within & ~solved.singular
        rows, previous = rows[taken], solved.q[taken]
    return rows, q[rows]
