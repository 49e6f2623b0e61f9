"""An identified robot: where it puts its tool, at rest and free of the instrument.

Joint angles q are those that the controller shows, as angles of the DH model. Gears that yield
under the weight of what they carry, backlash on the flank that the weight presses it to,
transmission error and joint errors lie between them and the pose. Whatever measured the robot, its
position is what compares calibrations; how uncertain it is comes from a covariance of recordings
(ballbar.ident.robot.tool_covariance) or of still poses (ballbar.ident.robot.pose_covariance).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import compress
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, Frames, cross, forward, joint_screws, screw
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, Parameter
from ballbar.cell.placement import Placement, target_frames
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.cell.statistics import chi_square_quantile
from ballbar.ident.corrections.base import BAR, BEHIND_GEARS, GEAR, Correction
from ballbar.ident.cross_validation import LEVEL
from ballbar.ident.loads.at_rest import regressors_at_rest

WORKSPACE = 800  # poses, as many as the accuracy grid of a moving robot
_WORKSPACE_SEED = 2400  # the poses are part of the metric
RANGE_MARGIN = np.deg2rad(1.0)  # [rad] past the last fitted angle that still counts as inside


@dataclass(frozen=True, eq=False)
class PositionUncertainty:
    """Uncertainty of the tool's position at N poses, robot base frame.

    An ellipsoid of k standard deviations has the square roots of the eigenvalues of a covariance
    times k as half axes, along the eigenvectors.
    """

    covariance: Array  # (N, 3, 3) [m^2] the scale's own uncertainty included
    # (N, 3, 3) [m^2] the best common factor on all positions removed; None where unknown
    covariance_without_scale: Array | None
    covered: NDArray[np.bool_]  # (N,) whether every joint is within the range that was fitted

    @property
    def sigma(self) -> Array:
        """(N,) [m] standard deviation, all directions together (root of the sum of variances)."""
        return np.asarray(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2)))


class StatedUncertainty(Protocol):
    """Uncertainty of an identified robot."""

    @property
    def discrepancy(self) -> float:
        """[m] standard deviation along each axis that the model leaves unexplained."""

    @property
    def factor(self) -> float:
        """Squared size of the region that holds 95 % of poses, over that of chi-square."""

    @property
    def inside_only(self) -> bool:
        """Whether nothing is known of the error outside the fitted ranges."""

    def of(self, robot: IdentifiedRobot) -> Callable[[Array], PositionUncertainty]:
        """Uncertainty of the tool's position as a function of q (N, J) [rad]."""

    def poses(self, robot: IdentifiedRobot) -> Array:
        """(G, J) [rad] poses over which the uncertainty of the tool is stated."""

    def draws(self, robot: IdentifiedRobot, count: int, rng: np.random.Generator) -> Array:
        """(D, G, 3) [m] draws of the tool's error at `poses`."""


@dataclass(frozen=True, eq=False)
class IdentifiedRobot:
    """Geometry and corrections of a robot, its tool, and what is stated of their uncertainty."""

    # What loads the gears: links, plate and instrument of a cell, or the nominal robot's links
    # alone. The end of the geometry's last row is the plate's, or the bare flange.
    description: Cell | Robot
    geometry: Geometry
    corrections: tuple[Correction, ...] = ()
    # (C,) of all coefficients, correction after correction
    values: Array = field(default_factory=lambda: np.zeros(0))
    target: Placement | None = None  # the tool in the last row's frame; None: that frame itself
    ranges: Array | None = None  # (J, 2) [rad] of each joint that were fitted; None: not stated
    stated: StatedUncertainty | None = None

    def __getstate__(self) -> dict[str, object]:
        """The fields alone: a cached `uncertainty` is a function, which cannot be pickled."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @property
    def robot(self) -> Robot:
        described = self.description
        return described.robot if isinstance(described, Cell) else described

    @property
    def cell(self) -> Cell:
        """The cell of a robot that was identified from recordings."""
        assert isinstance(self.description, Cell), "a robot of still poses has no cell"
        return self.description

    @property
    def chain(self) -> Chain:
        return self.geometry.robot

    @property
    def lower(self) -> Array:
        """(J,) [rad] least fitted angle of each joint; minus infinity where not stated."""
        return np.full(self.robot.joints, -np.inf) if self.ranges is None else self.ranges[:, 0]

    @property
    def upper(self) -> Array:
        """(J,) [rad] largest fitted angle of each joint; infinity where not stated."""
        return np.full(self.robot.joints, np.inf) if self.ranges is None else self.ranges[:, 1]

    @cached_property
    def tool_matrix(self) -> Array:
        """(4, 4) frame of the tool in that of the last row."""
        matrix = np.eye(4)
        if self.target is not None:
            matrix[:3, :3], matrix[:3, 3] = self.target.rotation, self.target.origin
        return matrix

    def rigid(self, geometry: Geometry | None = None) -> IdentifiedRobot:
        """The robot without corrections, by default of the same geometry."""
        return replace(self, geometry=geometry or self.geometry, corrections=(), values=np.zeros(0))

    def joints(self, q: Array) -> Array:
        """(N, J) [rad] actual joint angles at logged ones q (N, J) [rad]."""
        return self.deflected(q)[0]

    def deflected(self, q: Array) -> tuple[Array, Array]:
        """Actual joint angles (N, J) [rad] at logged ones q (N, J) [rad], and the arm's own motion.

        The latter (6, N) [m, rad], base frame, is what the structure of the arm yields in addition
        to its joints, at the end of the last row; to first order.
        """
        motion = np.zeros((6, len(q)))
        if not self.corrections:
            return q, motion
        robot, frames = self.robot, forward(self.chain, q)
        displaced = np.zeros((robot.joints + BEHIND_GEARS, len(q)))
        pairs = regressors_at_rest(self.description, self.geometry, self.corrections, q)
        for value, (channel, regressor) in zip(self.values, pairs, strict=True):
            if isinstance(channel, Parameter):
                motion += value * regressor * screw(frames, channel.kind, channel.row)
            else:
                displaced[channel] += value * regressor
        return np.asarray(q + displaced[GEAR:BAR].T @ robot.gear_to_joint), motion

    def frames(self, q: Array) -> Frames:
        """Frames of the rows at logged angles q (N, J) [rad], then that of a target.

        The motion of the arm's structure is not in them.
        """
        frames = forward(self.chain, self.joints(q))
        return frames if self.target is None else target_frames(frames, self.target)

    def ends(self, q: Array) -> Array:
        """(N, 4, 4) frames of the last row, robot base frame, at logged angles q (N, J) [rad]."""
        joints, motion = self.deflected(q)
        return moved_poses(forward(self.chain, joints).poses(), motion)

    def poses(self, q: Array) -> Array:
        """(N, 4, 4) tool frames, robot base frame, at logged joint angles q (N, J) [rad]."""
        ends = self.ends(q)
        return ends if self.target is None else ends @ self.tool_matrix

    def tool(self, q: Array) -> Array:
        """(N, 3) [m] tool position, robot base frame, at logged joint angles q (N, J) [rad].

        Warns of poses outside the range of an axis that was fitted, where nothing is known of the
        error there.
        """
        if self.stated is not None and self.stated.inside_only and (axes := self.out_of_range(q)):
            warnings.warn(f"some poses are {range_sentence(axes)}", stacklevel=2)
        return self.poses(q)[:, :3, 3]

    def jacobian(self, q: Array, parameters: NDArray[np.intp]) -> Array:
        """(P + C, 3, N) change of the tool position [m] per unit of each unknown.

        q : (N, J) [rad]. The unknowns are the `parameters` (P,), indices into the table, then the
        coefficients; those off the robot do not move the free tool.
        """
        return self.tool_moves(self.pose_jacobian(q, parameters), q)

    def pose_jacobian(self, q: Array, parameters: NDArray[np.intp]) -> Array:
        """(P + C, 6, N) change of the last row's pose [m, rad], base frame, per unit of each."""
        frames, none = forward(self.chain, self.joints(q)), np.zeros((6, len(q)))
        columns = []
        for parameter in (self.geometry.table.parameters[i] for i in parameters):
            on_robot = parameter.side == "robot"
            columns.append(screw(frames, parameter.kind, parameter.row) if on_robot else none)
        if self.corrections:
            gears = np.einsum("gj,jcn->gcn", self.robot.gear_to_joint, joint_screws(frames))
            pairs = regressors_at_rest(self.description, self.geometry, self.corrections, q)
            for channel, regressor in pairs:
                if isinstance(channel, Parameter):
                    columns.append(regressor * screw(frames, channel.kind, channel.row))
                else:
                    columns.append(gears[channel] * regressor if channel >= GEAR else none)
        return np.array(columns).reshape(len(columns), *none.shape)

    def tool_moves(self, moves: Array, q: Array) -> Array:
        """(K, 3, N) [m] motion of the tool with motions (K, 6, N) [m, rad] of the last row."""
        if self.target is None:
            return moves[:, :3]
        arm = (self.ends(q)[:, :3, :3] @ self.target.origin).T
        shifts = [move[:3] + cross(move[3:], arm) for move in moves]
        return np.array(shifts).reshape(len(shifts), 3, len(q))

    def moved_by_masses(self, cells: Sequence[Cell], q: Array) -> Array:
        """(K, 3, N) [m] how the tool moves at q (N, J) [rad] if its masses are those of K cells.

        Joints turn the tool to first order.
        """
        return self.tool_moves(self.pose_moved_by_masses(cells, q), q)

    def pose_moved_by_masses(self, cells: Sequence[Cell], q: Array) -> Array:
        """(K, 6, N) [m, rad] how the last row's pose moves, base frame, with masses of K cells."""
        loaded = [c.slopes is not None for c in self.corrections]
        counts = np.array([len(c.coefficients) for c in self.corrections], dtype=np.intp)
        carrying = replace(
            self,
            corrections=tuple(compress(self.corrections, loaded)),
            values=self.values[np.repeat(np.array(loaded, dtype=np.bool_), counts)],
        )
        joints, motion = carrying.deflected(q)
        screws = joint_screws(forward(self.chain, self.joints(q)))
        moves = []
        for cell in cells:
            others, other_motion = replace(carrying, description=cell).deflected(q)
            by_joints = np.einsum("nj,jcn->cn", others - joints, screws)
            moves.append(by_joints + other_motion - motion)
        return np.stack(moves)

    @cached_property
    def uncertainty(self) -> Callable[[Array], PositionUncertainty]:
        """Uncertainty of the tool's position as a function of q (N, J) [rad]."""
        return self._stated.of(self)

    def position_covariance(self, q: Array) -> Array:
        """(N, 3, 3) [m^2] of the tool's position at q (N, J) [rad].

        It is infinite outside the fitted ranges where nothing is known of the error there. Raises
        InputError where no uncertainty is stated.
        """
        return self.uncertainty(q).covariance

    def error_draws(self, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """(G, J) [rad] poses over which the uncertainty is stated, and (D, G, 3) [m] draws of the
        tool's error there.

        Raises InputError where no uncertainty is stated.
        """
        return self._stated.poses(self), self._stated.draws(self, count, rng)

    def sigma(self, q: Array) -> Array:
        """(N,) [m] standard deviation of the position, all axes together."""
        return self.uncertainty(q).sigma

    @property
    def discrepancy(self) -> float:
        """[m] standard deviation along each axis that the model leaves unexplained."""
        return self._stated.discrepancy

    @property
    def factor(self) -> float:
        """Squared size of the region that holds 95 % of poses, over that of chi-square."""
        return self._stated.factor

    def within(self, q: Array, error: Array) -> NDArray[np.bool_]:
        """(N,) whether errors (N, 3) [m] of poses q (N, J) lie in their stated 95 % regions."""
        covariance, inside = self.position_covariance(q), self.covered(q)
        covariance[~inside] = np.eye(3)
        square = np.einsum("nc,nc->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
        limit = self.factor * chi_square_quantile(LEVEL, 3)
        return np.asarray(np.where(inside, square <= limit, True))

    def covered(self, q: Array) -> NDArray[np.bool_]:
        """(N,) whether every angle of q (N, J) [rad] is within the fitted range of its axis."""
        return np.asarray(~self._outside(q).any(axis=1))

    def out_of_range(self, q: Array) -> dict[int, tuple[float, float]]:
        """Axes, from 1, that leave their fitted range [rad] at some of the poses q (N, J)."""
        return {
            int(j) + 1: (float(self.lower[j]), float(self.upper[j]))
            for j in np.flatnonzero(self._outside(q).any(axis=0))
        }

    def workspace(self) -> Array:
        """(G, J) [rad] the same random angles within the fitted ranges for everyone.

        Where nothing was fitted yet, within the ranges of the axes.
        """
        robot = self.robot
        shares = np.random.default_rng(_WORKSPACE_SEED).uniform(size=(WORKSPACE, robot.joints))
        low = np.where(np.isfinite(self.lower), self.lower, robot.axis_lower)
        high = np.where(np.isfinite(self.upper), self.upper, robot.axis_upper)
        return np.asarray(low + shares * (high - low))

    def _outside(self, q: Array) -> NDArray[np.bool_]:
        """(N, J) whether angles q (N, J) [rad] leave the fitted ranges."""
        return np.asarray((q < self.lower - RANGE_MARGIN) | (q > self.upper + RANGE_MARGIN))

    @property
    def _stated(self) -> StatedUncertainty:
        if self.stated is None:
            raise InputError(
                "the calibration states neither covariance nor fitted ranges, so the uncertainty "
                "of a pose is not known; identify the recording again with this version"
            )
        return self.stated


def moved_poses(poses: Array, motion: Array) -> Array:
    """(N, 4, 4) poses after small motions (6, N) [m, rad] of the base frame."""
    if not motion.any():
        return poses
    result = poses.copy()
    result[:, :3, :3] = matrix_from_rotvec(motion[3:]).transpose(2, 0, 1) @ poses[:, :3, :3]
    result[:, :3, 3] += motion[:3].T
    return result


def range_sentence(axes: dict[int, tuple[float, float]]) -> str:
    """Axes that `IdentifiedRobot.out_of_range` names, with their fitted ranges, as a sentence."""
    parts = [
        f"axis {axis} ({np.rad2deg(low):.1f} to {np.rad2deg(high):.1f} deg)"
        for axis, (low, high) in axes.items()
    ]
    return (
        f"outside the fitted range of {', '.join(parts)}: the error there is unknown and may "
        "exceed that of the nominal robot"
    )
