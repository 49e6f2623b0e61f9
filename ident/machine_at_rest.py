"""A machine identified from recordings, as still poses see it: its flange, without corrections.

The corrections are taken to the logged joint angles, once: what gears, bearings and structure do
at rest under the weight of arm and plate. What remains are DH rows up to the bare flange, as an
`IdentifiedRobot` has them, so still poses are held against it as against a robot that still poses
identified.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward, joint_screws
from ballbar.cell.geometry import Geometry, robot_frames
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseTable
from ballbar.ident.estimator.build_unknowns import bare_flange
from ballbar.ident.least_sizes import WANDER_ZERO
from ballbar.ident.result import Machine
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.pose_covariance import PoseCovariance

FLAT = 1e-3  # of the largest singular value, below which joints do not move the flange


def arm_at_rest(
    machine: Machine, targets: Mapping[str, Placement], observed: float
) -> IdentifiedRobot:
    """The machine up to its flange, with the first of its targets, or else the end of its tool.

    observed : [m] error along each axis of the still poses that it was identified from; 0 where
        there were none. The standard deviation of a pose is at least what the machine states of
        its tool, and what the zeros of its axes wander by.
    """
    robot, bare = machine.robot.cell.robot, _bare(machine.robot)
    flange, tool = (
        forward(chain, np.zeros((1, robot.joints))).poses()[0]
        for chain in (bare.robot, machine.robot.geometry.robot)
    )
    end = np.linalg.solve(flange, tool)
    place = next(iter(targets.values()), Placement(end[:3, :3], end[:3, 3]))
    stated = PoseCovariance(
        seat=Placement(np.eye(3), np.zeros(3)),
        seat_turns=False,
        parameters=np.zeros(0, dtype=np.intp),
        values=np.zeros((6, 6)),
        discrepancy=observed,
        factor=1.0,
    )
    arm = IdentifiedRobot(robot, bare, target=place, stated=stated)
    moves = joint_screws(arm.frames(arm.workspace()))[: robot.joints, :3]
    wander = WANDER_ZERO**2 * float((moves**2).sum(axis=(0, 1)).mean())
    least = float(np.sqrt((machine.tcp_sigma**2 + wander) / 3.0))
    return replace(arm, stated=replace(stated, discrepancy=max(observed, least)))


def table_at_rest(robot: IdentifiedRobot, table: PoseTable) -> PoseTable:
    """Still poses with the joint angles of the bare DH rows in place of those that were logged."""
    groups = (replace(group, q=_bare_angles(robot, group.q)) for group in table.groups)
    return replace(table, groups=tuple(groups))


def _bare_angles(robot: IdentifiedRobot, q: Array) -> Array:
    """(N, J) [rad] at which the DH rows alone stand as the robot does at logged angles q (N, J)."""
    joints, motion = robot.deflected(q)
    if not motion.any():
        return joints
    screws = joint_screws(robot_frames(robot.geometry, joints))[: q.shape[1]]
    inverse = np.linalg.pinv(screws.transpose(2, 1, 0), rcond=FLAT)  # (N, J, 6)
    return np.asarray(joints + np.einsum("njc,cn->nj", inverse, motion))


def _bare(robot: IdentifiedRobot) -> Geometry:
    """The geometry with the bare flange as the robot's last row."""
    rows, values = bare_flange(robot.cell.robot)
    changed = robot.geometry.values.copy()
    changed[rows] = values
    return robot.geometry.with_values(changed)
