"""What is not known of an identified robot, and what that means for its tool at any pose.

The unknowns are kinematic parameters, coefficients of corrections and masses that a fit took as
given, with one covariance. The position error of the tool is linear in them, e(q) = A(q) x. No
recording shows where the robot's base stands, so the rigid motion that fits e best over the
accuracy grid is removed from it at every pose, as in the stated TCP uncertainty
(ident.robot.accuracy). With the best common factor on all positions removed too, what remains is
the uncertainty without scale: the scale is what plate, rod or sensor were measured to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.chain import cross
from cell.payload import TOOL, with_deviations
from ident.robot.accuracy import accuracy_grid
from ident.robot.unloaded_robot import UnloadedRobot


@dataclass(frozen=True, eq=False)
class ToolCovariance:
    """Covariance of the unknowns of robot and instrument; the latter do not move the tool."""

    names: tuple[str, ...]  # (P,) parameters, then all coefficients, correction after correction
    # (K, 4 + 4 J) independent directions of the masses, one standard deviation each, as
    # cell.payload.with_deviations takes them
    masses: Array
    values: Array  # (U, U) [SI] of the named unknowns, of `held`, and of the directions' sizes
    held: tuple[str, ...] = ()  # (H,) parameters of the instrument that the fit took as exact

    @property
    def of_names(self) -> Array:
        """(P, P) [SI] of the named unknowns alone, where `held` is exact.

        Of one machine's recordings with one instrument it is, for they share what its lengths and
        angles are off by.
        """
        count, last = len(self.names), len(self.names) + len(self.held)
        variances = np.diag(self.values)[count:last]
        known = count + np.flatnonzero(variances)  # what has no tolerance is exact already
        own, cross = self.values[:count, :count], self.values[:count, known]
        scale = np.sqrt(self.values[known, known])
        cross = cross / scale
        held = self.values[np.ix_(known, known)] / np.outer(scale, scale)
        given = own - cross @ np.linalg.solve(held, cross.T)
        return np.asarray(0.5 * (given + given.T))

    @property
    def root(self) -> Array:
        """(U, U) matrix R with R R' the covariance."""
        values, vectors = np.linalg.eigh(self.values)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


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

    @property
    def sigma_without_scale(self) -> Array | None:
        """(N,) [m] likewise without scale."""
        if self.covariance_without_scale is None:
            return None
        return np.asarray(np.sqrt(np.trace(self.covariance_without_scale, axis1=1, axis2=2)))


@dataclass(frozen=True, eq=False)
class ErrorFields:
    """Position errors of the tool, base aligned, for one standard deviation of each direction."""

    robot: UnloadedRobot
    covariance: ToolCovariance
    tool: Array  # (3,) [m] point in the frame of the robot's last row
    centre: Array  # (3,) [m] mean of the tool's positions over the accuracy grid
    twists: Array  # (6, R) [m, rad] rigid motion of each direction about the centre
    factors: Array  # (R,) [-] common factor of each

    def at(self, q: Array) -> tuple[Array, Array]:
        """(N, 3, R) [m] errors at q (N, J) [rad], and the same without scale."""
        position, errors = _errors(self.robot, self.covariance, self.tool, q)
        arm = position - self.centre
        rigid = self.twists[:3] + np.cross(self.twists[3:].T, arm[:, None]).transpose(0, 2, 1)
        aligned = errors - rigid
        return aligned, aligned - arm[:, :, None] * self.factors

    def uncertainty(self, q: Array, covered: NDArray[np.bool_]) -> PositionUncertainty:
        """Of the tool's position at q (N, J) [rad]."""
        both = [field @ field.transpose(0, 2, 1) for field in self.at(q)]
        return PositionUncertainty(both[0], both[1], covered)


def error_fields(robot: UnloadedRobot, covariance: ToolCovariance, tool: Array) -> ErrorFields:
    """The errors of a point (3,) [m] in the frame of the last row of an identified robot."""
    position, errors = _errors(robot, covariance, tool, accuracy_grid(robot.cell.robot))
    centre = position.mean(axis=0)
    arm = position - centre
    motions = np.zeros((len(arm), 3, 6))
    motions[:, :, :3] = np.eye(3)
    motions[:, :, 3:] = np.cross(np.eye(3), arm[:, None]).transpose(0, 2, 1)
    columns, stacked = motions.reshape(-1, 6), errors.reshape(arm.size, -1)
    twists = np.linalg.lstsq(columns, stacked, rcond=None)[0]
    factors = arm.ravel() @ (stacked - columns @ twists) / (arm * arm).sum()
    return ErrorFields(robot, covariance, tool, centre, np.asarray(twists), np.asarray(factors))


def _errors(
    robot: UnloadedRobot, covariance: ToolCovariance, tool: Array, q: Array
) -> tuple[Array, Array]:
    """(N, 3) [m] positions of a point of the tool, and (N, 3, R) [m] their errors."""
    table = robot.geometry.table
    parameters = [table.index[name] for name in covariance.names if name in table.index]
    moves = robot.pose_jacobian(q, np.array(parameters, dtype=np.intp))
    if covariance.held:
        rigid = UnloadedRobot(robot.cell, robot.geometry)
        held = np.array([table.index[name] for name in covariance.held], dtype=np.intp)
        moves = np.concatenate((moves, rigid.pose_jacobian(robot.joints(q), held)))
    if len(covariance.masses):
        cells = [with_deviations(robot.cell, row) for row in covariance.masses]
        moves = np.concatenate((moves, robot.pose_moved_by_masses(cells, q)))
    pose = robot.poses(q)
    arm = pose[:, :3, :3] @ tool
    shifts = np.stack([move[:3] + cross(move[3:], arm.T) for move in moves])
    return pose[:, :3, 3] + arm, shifts.transpose(2, 1, 0) @ covariance.root


def with_exact_tool(covariance: ToolCovariance) -> ToolCovariance:
    """The covariance for a robot whose tool is another one, of exactly known mass."""
    masses = covariance.masses.copy()
    masses[:, :TOOL] = 0.0
    return replace(covariance, masses=masses)
