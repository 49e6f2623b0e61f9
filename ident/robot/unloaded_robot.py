"""Where an identified robot puts its tool when it stands free: geometry, gears, its own weight.

The position of the tool at logged joint angles, without ball-bar, at rest, is what compares
calibrations. Elastic gears deflect under the weight of arm and plate; backlash lies on the flank
that the weight presses it to.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.chain import joint_screws, screw
from cell.descriptions import Cell
from cell.geometry import Geometry, Parameter, robot_frames
from cell.rotation import matrix_from_rotvec
from ident.corrections.base import BAR, BEHIND_GEARS, GEAR, Channel, Correction, backlash_transition
from ident.loads.at_rest import state_at_rest
from ident.loads.gear_loads import mass_model


@dataclass(frozen=True, eq=False)
class UnloadedRobot:
    """A robot without ball-bar, with the corrections that were identified."""

    cell: Cell
    geometry: Geometry
    corrections: tuple[Correction, ...] = ()
    values: Array | None = None  # of all coefficients, correction after correction

    def tool(self, q: Array) -> Array:
        """(N, 3) [m] tool position, robot base frame, at logged joint angles q (N, J) [rad]."""
        joints, motion = self.deflected(q)
        return (robot_frames(self.geometry, joints).tip + motion[:3]).T

    def poses(self, q: Array) -> Array:
        """(N, 4, 4) tool frames, robot base frame, likewise."""
        joints, motion = self.deflected(q)
        return moved_poses(robot_frames(self.geometry, joints).poses(), motion)

    def joints(self, q: Array) -> Array:
        """(N, J) [rad] actual joint angles at logged ones q (N, J) [rad]."""
        return self.deflected(q)[0]

    def deflected(self, q: Array) -> tuple[Array, Array]:
        """Actual joint angles (N, J) [rad] at logged ones q (N, J) [rad], and the tool's motion.

        The latter (6, N) [m, rad], base frame, is what the structure of the arm yields beside its
        joints; to first order.
        """
        motion = np.zeros((6, len(q)))
        if self.values is None or not self.corrections:
            return q, motion
        moved = np.zeros((self.cell.robot.joints + BEHIND_GEARS, len(q)))
        frames = robot_frames(self.geometry, q)
        for value, (channel, regressor) in zip(self.values, self._regressors(q), strict=True):
            if isinstance(channel, Parameter):
                motion += value * regressor * screw(frames, channel.kind, channel.row)
            else:
                moved[channel] += value * regressor
        return np.asarray(q + moved[GEAR:BAR].T @ self.cell.robot.gear_to_joint), motion

    def jacobian(self, q: Array, parameters: NDArray[np.intp]) -> Array:
        """(P + C, 3, N) change of the tool position [m] per unit of each unknown.

        q : (N, J) [rad]. The unknowns are the `parameters` (P,), indices into the table, then the
        coefficients; those off the robot do not move the unloaded tool.
        """
        return self.pose_jacobian(q, parameters)[:, :3]

    def pose_jacobian(self, q: Array, parameters: NDArray[np.intp]) -> Array:
        """(P + C, 6, N) likewise of the tool's pose [m, rad], base frame."""
        frames, none = robot_frames(self.geometry, self.joints(q)), np.zeros((6, len(q)))
        columns = []
        for parameter in (self.geometry.table.parameters[i] for i in parameters):
            on_robot = parameter.side == "robot"
            columns.append(screw(frames, parameter.kind, parameter.row) if on_robot else none)
        if self.corrections:
            to_joint = self.cell.robot.gear_to_joint
            gears = np.einsum("gj,jcn->gcn", to_joint, joint_screws(frames))
            for channel, regressor in self._regressors(q):
                if isinstance(channel, Parameter):
                    columns.append(regressor * screw(frames, channel.kind, channel.row))
                else:
                    columns.append(gears[channel] * regressor if channel >= GEAR else none)
        return np.array(columns).reshape(-1, *none.shape)

    def moved_by_masses(self, cells: Sequence[Cell], q: Array) -> Array:
        """(K, 3, N) [m] how the tool moves at q (N, J) [rad] if its masses are those of K cells.

        Joints turn the tool to first order.
        """
        return self.pose_moved_by_masses(cells, q)[:, :3]

    def pose_moved_by_masses(self, cells: Sequence[Cell], q: Array) -> Array:
        """(K, 6, N) [m, rad] likewise of its pose, base frame."""
        carrying = self._carrying()
        joints, motion = carrying.deflected(q)
        screws = joint_screws(robot_frames(self.geometry, self.joints(q)))
        moves = []
        for cell in cells:
            others, other_motion = replace(carrying, cell=cell).deflected(q)
            turned = np.einsum("nj,jcn->cn", others - joints, screws)
            moves.append(turned + other_motion - motion)
        return np.stack(moves)

    def _carrying(self) -> UnloadedRobot:
        """The robot with no other corrections than those that depend on loads."""
        if self.values is None:
            return self
        loaded = [c.slopes is not None for c in self.corrections]
        counts = np.array([len(c.coefficients) for c in self.corrections], dtype=np.intp)
        chosen = np.repeat(np.array(loaded, dtype=np.bool_), counts)
        corrections = tuple(compress(self.corrections, loaded))
        return replace(self, corrections=corrections, values=self.values[chosen])

    def _regressors(self, q: Array) -> Iterator[tuple[Channel, Array]]:
        """Channel and regressor (N,) of every coefficient, at rest under the robot's own weight."""
        robot = self.cell.robot
        state = state_at_rest(
            mass_model(self.cell), self.geometry, q, robot.joint_to_gear, backlash_transition(robot)
        )
        for correction in self.corrections:
            regressors = correction.regressors(state)
            for coefficient, regressor in zip(correction.coefficients, regressors, strict=True):
                yield coefficient.channel, regressor


def moved_poses(poses: Array, motion: Array) -> Array:
    """(N, 4, 4) poses after small motions (6, N) [m, rad] of the base frame."""
    if not motion.any():
        return poses
    out = poses.copy()
    out[:, :3, :3] = matrix_from_rotvec(motion[3:]).transpose(2, 0, 1) @ poses[:, :3, :3]
    out[:, :3, 3] += motion[:3].T
    return out
