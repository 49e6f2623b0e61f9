"""Inverse calibration: joint targets that bring the identified robot to the nominal robot's poses.

A target q stands for the pose that the nominal model gives it. The joints that take this pose with
the identified geometry come from Newton steps; the target that leaves the joints there, under
compliance, backlash and transmission error of the gears, from the fixed point `q = joints -
correction(q)`, which gains two digits an iteration.

The whole pose is kept, so what holds for the ball-bar's end of the plate holds for any tool that is
fixed to it. Source: Mooring, Roth & Driels 1991 (accuracy compensation).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, Frames, forward, joint_screws
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.inverse import pose_error, refine_reachable
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.ident.robot.identified import IdentifiedRobot, moved_poses

# [rad] thirty times what geometry needs away from singularities; more is a sign of one
LARGEST_CORRECTION = 0.1
FULL = 6  # axes that a whole pose needs
_CONVERGED = 1e-11  # [rad] last Newton step; rounding leaves 1e-13 near a singularity
# Iterations of the fixed point; transmission error changes by less than 1 % of the change of its
# angle, so six reach rounding.
_ITERATIONS = 12


class TargetError(ValueError):
    """Targets that cannot be corrected; `faults` says why, by row from 0."""

    def __init__(self, faults: Mapping[int, str]) -> None:
        self.faults = dict(faults)
        first = min(self.faults)
        super().__init__(f"target {first}: {self.faults[first]}")


@dataclass(frozen=True, eq=False)
class CorrectedTargets:
    """Targets for the real robot, and the pose errors that the identified model predicts."""

    q: Array  # (N, J) [rad]
    position_before: Array  # (N,) [m] distance from the nominal pose with the nominal target
    angle_before: Array  # (N,) [rad]
    position_after: Array  # (N,) [m] the same with the corrected target
    angle_after: Array  # (N,) [rad]


def corrected_targets(identified: IdentifiedRobot, nominal: Chain, q: Array) -> CorrectedTargets:
    """Targets that reach the nominal poses.

    nominal : the rows that the targets were planned with. q : (N, J) [rad] targets as DH joint
    angles; of seven axes and more the shortest way is taken.

    Raises TargetError for rows out of range, out of reach or too near to a singularity, and
    InputError for fewer than six axes, which cannot keep a whole pose.
    """
    robot = identified.robot
    if robot.joints < FULL:
        raise InputError(
            f"{robot.title}: {robot.joints} axes cannot keep a whole pose, so targets "
            "cannot be corrected"
        )
    chain, deflected = identified.chain, identified.deflected
    faults = _out_of_range(robot, q, "given") | _singular(chain, nominal, q)
    if faults:
        raise TargetError(faults)
    wanted = forward(nominal, q)
    # the structure yields with the posture, which the correction hardly changes
    poses = moved_poses(wanted.poses(), -deflected(q)[1])
    joints, reached = refine_reachable(chain, q, poses, tolerance=_CONVERGED)
    if not reached.all():
        unreached = (
            "the identified robot does not reach the wanted pose near this target. Move the target."
        )
        raise TargetError({int(row): unreached for row in np.flatnonzero(~reached)})
    target = joints
    for _ in range(_ITERATIONS):
        target = joints - (deflected(target)[0] - target)
    faults = _out_of_range(robot, target, "corrected")
    if faults:
        raise TargetError(faults)
    before, after = (_distance(wanted, chain, *deflected(commanded)) for commanded in (q, target))
    return CorrectedTargets(target, *before, *after)


def _singular(chain: Chain, nominal: Chain, q: Array) -> dict[int, str]:
    """Rows whose first Newton step is out of proportion."""
    faults = {}
    wanted, actual = forward(nominal, q), forward(chain, q)
    error = pose_error(wanted.rotation(), wanted.tip, actual)
    u, s, vt = np.linalg.svd(joint_screws(actual).transpose(2, 1, 0), full_matrices=False)
    along = np.einsum("nji,jn->ni", u, error)
    step = np.einsum("nij,ni->nj", vt, along / np.maximum(s, 1e-12))
    for row in np.flatnonzero(np.abs(step).max(axis=1) > LARGEST_CORRECTION):
        joint = int(np.abs(step[row]).argmax())
        size = min(float(np.degrees(np.abs(step[row, joint]))), 180.0)
        faults[int(row)] = (
            "the robot stands at a singularity or at the edge of its reach: the wanted pose would "
            f"need a correction of about {size:.0f} deg in joint {joint + 1} (joint 5 stands at "
            f"{np.degrees(q[row, 4]):.1f} deg). Move the target away from it."
        )
    return faults


def _out_of_range(robot: Robot, q: Array, which: str) -> dict[int, str]:
    """Rows whose axis angles exceed the robot's ranges."""
    axes = joints_to_axes(robot, q)
    excess = np.maximum(robot.axis_lower - axes, axes - robot.axis_upper)
    faults = {}
    for row in np.flatnonzero(excess.max(axis=1) > 0.0):
        axis = int(excess[row].argmax())
        lower, upper = np.degrees(robot.axis_lower[axis]), np.degrees(robot.axis_upper[axis])
        faults[int(row)] = (
            f"axis {axis + 1} of the {which} target is {np.degrees(axes[row, axis]):.3f} deg, "
            f"outside its range of {lower:.0f} to {upper:.0f} deg. Move the target."
        )
    return faults


def _distance(wanted: Frames, chain: Chain, q: Array, motion: Array) -> tuple[Array, Array]:
    """(N,) [m] and (N,) [rad] from the wanted frames to a chain at q that moved a little."""
    error = pose_error(wanted.rotation(), wanted.tip, forward(chain, q)) - motion
    return np.linalg.norm(error[:3], axis=0), np.linalg.norm(error[3:], axis=0)
