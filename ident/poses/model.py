"""Still poses against a model of robot, seats and targets: whitened residual and Jacobian.

The covariance of a pose's error is that of its measurement, of the rounding of the joint angles,
and of what the model leaves unexplained (`Discrepancy`): on real robots the last is ten times the
first (docs/real_robots).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cell.arrays import Array
from cell.chain import Frames, forward, joint_screws, screw
from cell.poses import PoseGroup, PoseTable
from cell.rotation import inverse_left_jacobian
from ident.corrections.base import Correction
from ident.estimator.whitening import Whitening, covariance, whitening
from ident.poses.closure import (
    Placement,
    PoseClosure,
    close_pose_loop,
    error_of_target_motion,
    seat_columns,
    target_columns,
    target_frames,
)
from ident.poses.joint_corrections import channel_columns, joint_displacements, regressors_at
from ident.poses.unknowns import PoseUnknowns


@dataclass(frozen=True)
class Discrepancy:
    """Standard deviation of what the model leaves unexplained, along each axis."""

    position: float  # [m]
    rotation: float = 0.0  # [rad]


@dataclass(frozen=True, eq=False)
class GroupPoint:
    """One group of N poses at one value of the unknowns."""

    group: PoseGroup
    seat: Placement
    target: Frames  # of the robot, the last one that of the target
    closure: PoseClosure
    regressors: Array  # (C, N) of the corrections' coefficients

    @cached_property
    def joint_columns(self) -> Array:
        """(J, 6, N) change of the error per radian of each joint."""
        rows = self.target.x_link.shape[0]
        return error_of_target_motion(self.closure, joint_screws(self.target)[:rows])


@dataclass(frozen=True, eq=False)
class PoseModel:
    """Poses, unknowns and corrections of an identification."""

    table: PoseTable
    unknowns: PoseUnknowns
    corrections: tuple[Correction, ...]
    angle_noise: Array  # (J,) [rad] of the joint angles, by their rounding

    @cached_property
    def regressors(self) -> tuple[Array, ...]:
        """(C, N) of every group, at the angles as given."""
        robot = self.table.robot
        return tuple(regressors_at(robot, self.corrections, g.q) for g in self.table.groups)

    def evaluate(self, x: Array) -> tuple[GroupPoint, ...]:
        """Every group at the unknowns x (P,)."""
        layout, robot = self.unknowns, self.table.robot
        chain, values = layout.robot(x), x[layout.coefficients]
        out = []
        for group, regressors in zip(self.table.groups, self.regressors, strict=True):
            q = group.q + joint_displacements(robot, self.corrections, values, regressors)
            frames = target_frames(forward(chain, q), layout.target(x, group.target))
            seat = layout.seat(x, group.seat)
            closure = close_pose_loop(group.measured, group.values, seat, frames)
            out.append(GroupPoint(group, seat, frames, closure, regressors))
        return tuple(out)

    def weights(self, point: GroupPoint, discrepancy: Discrepancy) -> Whitening:
        """Weights of one group: covariance of the error, joints without sensor eliminated."""
        n = point.group.size
        unexplained = np.zeros((6, 6, n))
        unexplained[np.arange(6), np.arange(6)] = np.repeat(
            [discrepancy.position, discrepancy.rotation], 3
        )[:, None]
        columns = np.concatenate((unexplained, self.noise_columns(point)))
        return whitening(covariance(columns), point.closure.free)

    def noise_columns(self, point: GroupPoint) -> Array:
        """(K, 6, N) change of the error for one standard deviation of angles and measurement."""
        angles = self.angle_noise[:, None, None] * point.joint_columns
        return np.concatenate((angles, sensor_columns(point)))

    def jacobian(self, x: Array, point: GroupPoint, weights: Whitening) -> Array:
        """(P, E, N) derivative of one group's whitened residual."""
        layout, closure, group = self.unknowns, point.closure, point.group
        out = np.zeros((layout.count, weights.matrix.shape[0], group.size))
        seat, target = layout.seats[group.seat], layout.targets[group.target]
        whole_seat, whole_target = (part.stop - part.start == 6 for part in (seat, target))
        columns = seat_columns(closure, point.seat, turns=whole_seat)
        out[seat] = weights(_of_rotation_vector(columns, x[seat], 1.0))
        columns = target_columns(closure, turns=whole_target)
        out[target] = weights(_of_rotation_vector(columns, x[target], -1.0))
        screws = np.stack([screw(point.target, p.kind, p.row) for p in layout.parameters])
        out[layout.geometry] = weights(error_of_target_motion(closure, screws))
        if self.corrections:
            channels = channel_columns(self.table.robot, self.corrections, point.joint_columns)
            np.multiply(weights(channels), point.regressors[:, None], out=out[layout.coefficients])
        return out


def sensor_columns(point: GroupPoint) -> Array:
    """(K, 6, N) change of the error for one standard deviation of each measured value."""
    group, n = point.group, point.group.size
    if group.measured == "length":
        rod = point.closure.measured - point.seat.origin[:, None]
        out = np.zeros((1, 6, n))
        out[0, :3] = group.sigma[:, 0] * rod / np.linalg.norm(rod, axis=0)
        return out
    count = group.sigma.shape[1]
    out = np.zeros((count, 6, n))
    for k in range(count):
        first = 3 * (k // 3)
        out[k, first : first + 3] = point.seat.rotation[:, k % 3, None] * group.sigma[:, k]
    return out


def _of_rotation_vector(columns: Array, change: Array, side: float) -> Array:
    """Columns per turn as columns per unit of the rotation vector that stands in x; in place.

    side : 1 where the vector turns about the outer axes, -1 about the inner ones.
    """
    if len(columns) == 6:
        rotvec = side * change[3:, None]
        turning = np.linalg.inv(inverse_left_jacobian(rotvec, np.eye(3)[:, :, None])[:, :, 0].T)
        columns[3:] = np.einsum("ij,icn->jcn", turning, columns[3:])
    return columns
