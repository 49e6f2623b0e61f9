"""Test cube of ISO 9283:1998, clause 6.8, and its five test poses.

The cube lies in the most used part of the workspace, which is where the robot was measured, its
edges parallel to the axes of the base frame. Its corners C1 to C4 bound the lower face, counted
about z from the one nearest to the negative x and y, C5 to C8 stand above them. The poses P1 to P5
lie in the plane C1-C2-C7-C8: P1 in the centre, the others on its diagonals, a tenth of their length
(+- 2 %) from the corners in the order of the plane's name.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.numerical_inverse import length_of
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.identified_kinematics import IdentifiedKinematics
from ballbar.ident.robot.inverse_calibration import FULL

SIDES = (1.0, 0.63, 0.4, 0.25)  # [m] edges that the standard prefers
PLANE = ((-1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (1.0, 1.0, 1.0), (1.0, -1.0, 1.0))  # C1 C2 C7 C8
FROM_END = 0.1  # of a diagonal
# Of the flange's axis from the vertical that are tried, then orientations as they were measured
TILTS = (*np.deg2rad([180.0, 135.0, 90.0]), None)
TRIED = 60  # poses of the workspace whose positions are tried as the centre
ROUNDS = 6  # of moving the centre until the joint angles are about the middle of the ranges
CLEAR = 0.1  # of the length of the robot's chain, between the cube and the axis of the base


@dataclass(frozen=True, eq=False)
class TestCube:
    """A cube whose five poses the nominal robot takes."""

    __test__ = False  # no test of pytest

    side: float  # [m]
    poses: Array  # (5, 4, 4) P1 to P5 of the tool, robot base frame
    q: Array  # (5, J) [rad] joint angles of the nominal robot


def cube_points(side: float, centre: Array) -> Array:
    """(..., 5, 3) [m] positions of P1 to P5 of cubes with an edge [m] about centres (..., 3)."""
    share = 1.0 - 2.0 * FROM_END
    corners = 0.5 * side * share * np.array([(0.0, 0.0, 0.0), *PLANE])
    return np.asarray(centre[..., None, :] + corners)


def fitting_cube(
    nominal: IdentifiedKinematics, identified: IdentifiedRobot, side: float | None = None
) -> TestCube | None:
    """The largest standard cube whose poses the nominal robot takes within the fitted ranges.

    Orientations with the flange's axis downward, leaning outward or level come first, then those of
    poses within the ranges. None where no cube fits, as for fewer than six axes.
    side : [m] of the only cube that is tried, if need be outside the fitted ranges.
    """
    if nominal.robot.joints < FULL:
        return None
    for edge in SIDES if side is None else (side,):
        if (cube := _fitting(nominal, identified, edge)) is not None:
            return cube
    if side is None or identified.ranges is None:
        return None
    return fitting_cube(nominal, replace(identified, ranges=None), side)


def _fitting(
    nominal: IdentifiedKinematics, identified: IdentifiedRobot, edge: float
) -> TestCube | None:
    """The cube of an edge [m] with the first of TILTS that fits, all tried at a time."""
    within, cube = identified.workspace(), None
    middle = 0.5 * (within.min(axis=0) + within.max(axis=0))
    starts = np.vstack((middle, within[:TRIED]))
    q, tilt = np.tile(starts, (len(TILTS), 1)), np.repeat(range(len(TILTS)), len(starts))
    for _ in range(ROUNDS):
        ends = nominal.forward(q)
        for k, angle in enumerate(TILTS):
            if angle is not None and (rows := tilt == k).any():
                ends[rows, :3, :3] = _upright(nominal, ends[rows], angle)
        rows, poses, taken = _taken(nominal, ends, middle, edge)
        tilt = tilt[rows]
        inside = identified.covered(taken.reshape(-1, q.shape[1])).reshape(-1, 5).all(axis=1)
        # the least motion, which keeps to one configuration where one can
        motion = np.where(inside, np.abs(taken - taken[:, :1]).max(axis=(1, 2)), np.inf)
        if inside.any():
            first = tilt[inside].min()
            best = np.where(tilt == first, motion, np.inf).argmin()
            cube = TestCube(edge, poses[best], taken[best])
            taken, tilt = taken[tilt < first], tilt[tilt < first]
        # from here the angles at the five poses are about the middle
        q = taken[:, 0] + middle - 0.5 * (taken.min(axis=1) + taken.max(axis=1))
        if not q.size:
            break
    return cube


def _upright(nominal: IdentifiedKinematics, ends: Array, tilt: float) -> Array:
    """(K, 3, 3) orientations of the tool at poses (K, 4, 4), the flange's axis by a tilt [rad] from
    the vertical, away from the robot.
    """
    tool = nominal.identified.tool_matrix[:3, :3]
    azimuth = np.arctan2(ends[:, 1, 3], ends[:, 0, 3])
    ahead = matrix_from_rotvec(np.outer((0.0, 0.0, 1.0), azimuth)).transpose(2, 0, 1)
    lean = matrix_from_rotvec(np.array([[0.0], [tilt], [0.0]]))[..., 0]
    return np.asarray(ahead @ lean @ tool)


def _taken(
    nominal: IdentifiedKinematics, ends: Array, middle: Array, edge: float
) -> tuple[NDArray[np.intp], Array, Array]:
    """Cubes about K centres that the robot takes away from singular postures: which they are, their
    poses (., 5, 4, 4), and joint angles (., 5, J) [rad], the nearest to those of P1.

    ends : (K, 4, 4) of P1; middle : (J,) [rad] to which its joint angles are the nearest ones. No
    cube reaches below the base or holds the robot's column.
    """
    centre, solutions = ends[:, :3, 3], list[Array]()
    column = np.abs(centre[:, :2]).max(axis=1) - 0.5 * edge
    clear = (column >= CLEAR * length_of(nominal.nominal)) & (centre[:, 2] >= 0.5 * edge)
    rows = np.flatnonzero(clear)
    poses = np.tile(ends[:, None], (1, 5, 1, 1))
    poses[:, :, :3, 3] = cube_points(edge, centre)
    first = np.tile(middle, (rows.size, 1))
    for k in range(poses.shape[1]):
        solved = nominal.nearest(poses[rows, k], first)
        taken = solved.reached & solved.within & ~solved.singular
        rows, solutions = rows[taken], [each[taken] for each in (*solutions, solved.q)]
        first = solutions[0]
    return rows, poses[rows], np.stack(solutions, axis=1)
