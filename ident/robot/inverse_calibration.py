"""Inverse calibration: the joint targets that bring the identified robot to where the nominal robot would have gone.

A target q asks for the pose that the nominal model gives it. The joints that take this pose with the identified geometry come
from Newton steps; the target that leaves the joints there, after gears have yielded to the robot's own weight, turned unevenly
and taken up their play, from `q = joints - correction(q)`, which gains two digits a turn.

The whole pose is kept, so what holds for the ball-bar's end of the plate holds for any tool that is fixed to it.
Source: Mooring, Roth & Driels 1991, Fundamentals of Manipulator Calibration (accuracy compensation).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.chain import Chain, Frames, joint_screws
from cell.descriptions import Robot
from cell.geometry import Geometry, robot_frames
from cell.inverse import UnreachableError, pose_error, refine
from cell.robot_angles import joints_to_axes
from ident.robot.unloaded_robot import UnloadedRobot

LARGEST_CORRECTION = (
    0.1  # [rad] thirty times what geometry asks for away from singularities; more is a sign of one
)
_CONVERGED = 1e-11  # [rad] last Newton step; rounding leaves 1e-13 near a singularity
_TURNS = 12  # of the fixed point; gear ripple changes by less than 1 % of the change of its angle, so six reach rounding


class TargetError(ValueError):
    """Targets that cannot be corrected; `faults` says why, by row from 0."""

    def __init__(self, faults: Mapping[int, str]) -> None:
        self.faults = dict(faults)
        first = min(self.faults)
        super().__init__(f"target {first}: {self.faults[first]}")


@dataclass(frozen=True, eq=False)
class CorrectedTargets:
    """Targets for the real robot, and what the identified model says about them."""

    q: Array  # (N, 6) [rad]
    position_before: Array  # (N,) [m] from the wanted pose to where the identified robot goes when told the nominal target
    angle_before: Array  # (N,) [rad]
    position_after: Array  # (N,) [m] when told the corrected one
    angle_after: Array  # (N,) [rad]


def corrected_targets(robot: UnloadedRobot, nominal: Geometry, q: Array) -> CorrectedTargets:
    """Targets that reach the nominal poses.

    robot : as identified. nominal : the geometry that the targets q (N, 6) [rad, DH joint angles] were planned with.

    Raises TargetError for rows out of range, out of reach or too near to a singularity.
    """
    faults = _out_of_range(robot.cell.robot, q, "given") | _singular(robot, nominal, q)
    if faults:
        raise TargetError(faults)
    wanted = robot_frames(nominal, q)
    joints = target = _joints_at(robot.geometry.robot, q, wanted.poses())
    for _ in range(_TURNS):
        target = joints - (robot.joints(target) - target)
    faults = _out_of_range(robot.cell.robot, target, "corrected")
    if faults:
        raise TargetError(faults)
    before, after = (
        _distance(wanted, robot_frames(robot.geometry, robot.joints(told))) for told in (q, target)
    )
    return CorrectedTargets(target, *before, *after)


def _joints_at(chain: Chain, q: Array, poses: Array) -> Array:
    """(N, 6) [rad] joints that bring the chain to poses (N, 4, 4), from q close by. Raises TargetError naming all that fail."""
    try:
        return refine(chain, q, poses, tolerance=_CONVERGED)
    except UnreachableError:
        faults = {}
        for row in range(len(q)):
            try:
                refine(chain, q[row : row + 1], poses[row : row + 1], tolerance=_CONVERGED)
            except UnreachableError:
                faults[row] = (
                    "the identified robot does not reach the wanted pose near this target. Move the target."
                )
        raise TargetError(faults) from None


def _singular(robot: UnloadedRobot, nominal: Geometry, q: Array) -> dict[int, str]:
    """Rows whose first Newton step is out of proportion."""
    faults = {}
    wanted, there = robot_frames(nominal, q), robot_frames(robot.geometry, q)
    mismatch = pose_error(wanted.rotation(), wanted.tip, there)
    u, s, vt = np.linalg.svd(joint_screws(there).transpose(2, 1, 0))
    along = np.einsum("nji,jn->ni", u, mismatch)
    step = np.einsum("nij,ni->nj", vt, along / np.maximum(s, 1e-12))
    for row in np.flatnonzero(np.abs(step).max(axis=1) > LARGEST_CORRECTION):
        joint = int(np.abs(step[row]).argmax())
        asked = f"{min(float(np.degrees(np.abs(step[row, joint]))), 180.0):.0f}"
        faults[int(row)] = (
            f"the robot stands at a singularity or at the edge of its reach: the wanted pose would need a correction of about {asked} deg "
            f"in joint {joint + 1} (joint 5 stands at {np.degrees(q[row, 4]):.1f} deg). Move the target away from it."
        )
    return faults


def _out_of_range(robot: Robot, q: Array, which: str) -> dict[int, str]:
    axes = joints_to_axes(robot, q)
    excess = np.maximum(robot.axis_lower - axes, axes - robot.axis_upper)
    faults = {}
    for row in np.flatnonzero(excess.max(axis=1) > 0.0):
        axis = int(excess[row].argmax())
        lower, upper = np.degrees(robot.axis_lower[axis]), np.degrees(robot.axis_upper[axis])
        value = np.degrees(axes[row, axis])
        faults[int(row)] = (
            f"axis {axis + 1} of the {which} target is {value:.3f} deg, outside its range of {lower:.0f} to {upper:.0f} deg"
        )
    return faults


def _distance(wanted: Frames, there: Frames) -> tuple[Array, Array]:
    mismatch = pose_error(wanted.rotation(), wanted.tip, there)
    return np.linalg.norm(mismatch[:3], axis=0), np.linalg.norm(mismatch[3:], axis=0)
