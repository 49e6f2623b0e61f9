"""Uncertainty of an identified robot: its unknowns, and its tool at any pose.

The unknowns are kinematic parameters, coefficients of corrections and masses that a fit took as
given, with one covariance. The position error of the tool is linear in them, e(q) = A(q) x. No
recording shows where the robot's base stands, so the rigid motion that fits e best over the
accuracy grid is removed from it at every pose, as in the stated TCP uncertainty
(ballbar.ident.robot.accuracy). With the best common factor on all positions removed too, what
remains is the uncertainty without scale: the scale is what plate, rod or sensor were measured to.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.payload import TOOL, with_deviations
from ballbar.cell.statistics import covariance_root
from ballbar.ident.robot.accuracy import accuracy_grid, aligned_columns
from ballbar.ident.robot.identified import IdentifiedRobot, PositionUncertainty


@dataclass(frozen=True, eq=False)
class ToolCovariance:
    """Covariance of the unknowns of robot and instrument; the latter do not move the tool."""

    names: tuple[str, ...]  # (P,) parameters, then all coefficients, correction after correction
    # (K, 4 + 4 J) independent directions of the masses, one standard deviation each, as
    # cell.payload.with_deviations takes them
    masses: Array
    values: Array  # (U, U) [SI] of the named unknowns, of `held`, and of the directions' sizes
    held: tuple[str, ...] = ()  # (H,) parameters of the instrument that the fit took as exact
    # (P,) [SI] standard deviation of a repetition of each named unknown, of the noise of the data
    # alone: what priors, lengths and masses are off by is the same again. Empty if not stated
    repeated: Array = field(default_factory=lambda: np.zeros(0))

    # All that is stated is in the covariance, inside and outside the fitted ranges
    discrepancy: ClassVar[float] = 0.0
    factor: ClassVar[float] = 1.0
    inside_only: ClassVar[bool] = False

    def of(self, robot: IdentifiedRobot) -> Callable[[Array], PositionUncertainty]:
        """Uncertainty of the tool's position as a function of q (N, J) [rad]."""
        return error_fields(robot, self).uncertainty

    def poses(self, robot: IdentifiedRobot) -> Array:
        """(G, J) [rad] the accuracy grid, over which the TCP uncertainty is stated."""
        return accuracy_grid(robot.robot)

    def columns(self, robot: IdentifiedRobot) -> Array:
        """(3G, U) [m] error of the tool at `poses` per unit of each unknown, base aligned."""
        grid = self.poses(robot)
        return aligned_columns(robot.poses(grid)[:, :3, 3], _moves(robot, self, grid))

    def draws(self, robot: IdentifiedRobot, count: int, rng: np.random.Generator) -> Array:
        """(D, G, 3) [m] draws of the tool's error at `poses`, base aligned."""
        unknowns = covariance_root(self.values) @ rng.standard_normal((len(self.values), count))
        return np.asarray((self.columns(robot) @ unknowns).T.reshape(count, -1, 3))

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
class ErrorFields:
    """Position errors of the tool, base aligned, for one standard deviation of each direction."""

    robot: IdentifiedRobot
    covariance: ToolCovariance
    centre: Array  # (3,) [m] mean of the tool's positions over the accuracy grid
    twists: Array  # (6, R) [m, rad] rigid motion of each direction about the centre
    factors: Array  # (R,) [-] common factor of each

    def at(self, q: Array) -> tuple[Array, Array]:
        """(N, 3, R) [m] errors at q (N, J) [rad], and the same without scale."""
        position, errors = _errors(self.robot, self.covariance, q)
        arm = position - self.centre
        rigid = self.twists[:3] + np.cross(self.twists[3:].T, arm[:, None]).transpose(0, 2, 1)
        aligned = errors - rigid
        return aligned, aligned - arm[:, :, None] * self.factors

    def uncertainty(self, q: Array) -> PositionUncertainty:
        """Uncertainty of the tool's position at q (N, J) [rad]."""
        both = [field @ field.transpose(0, 2, 1) for field in self.at(q)]
        return PositionUncertainty(both[0], both[1], self.robot.covered(q))


def error_fields(robot: IdentifiedRobot, covariance: ToolCovariance) -> ErrorFields:
    """The errors of an identified robot's tool."""
    position, errors = _errors(robot, covariance, accuracy_grid(robot.robot))
    centre = position.mean(axis=0)
    arm = position - centre
    motions = np.zeros((len(arm), 3, 6))
    motions[:, :, :3] = np.eye(3)
    motions[:, :, 3:] = np.cross(np.eye(3), arm[:, None]).transpose(0, 2, 1)
    columns, stacked = motions.reshape(-1, 6), errors.reshape(arm.size, -1)
    twists = np.linalg.lstsq(columns, stacked, rcond=None)[0]
    factors = arm.ravel() @ (stacked - columns @ twists) / (arm * arm).sum()
    return ErrorFields(robot, covariance, centre, np.asarray(twists), np.asarray(factors))


def _errors(robot: IdentifiedRobot, covariance: ToolCovariance, q: Array) -> tuple[Array, Array]:
    """(N, 3) [m] positions of the tool, and (N, 3, R) [m] their errors."""
    errors = _moves(robot, covariance, q).transpose(2, 1, 0) @ covariance.root
    return robot.poses(q)[:, :3, 3], errors


def _moves(robot: IdentifiedRobot, covariance: ToolCovariance, q: Array) -> Array:
    """(U, 3, N) [m] motion of the tool per unit of each unknown of the covariance."""
    table = robot.geometry.table
    parameters = [table.index[name] for name in covariance.names if name in table.index]
    moves = robot.pose_jacobian(q, np.array(parameters, dtype=np.intp))
    if covariance.held:
        held = np.array([table.index[name] for name in covariance.held], dtype=np.intp)
        rigid = robot.rigid().pose_jacobian(robot.joints(q), held)
        moves = np.concatenate((moves, rigid))
    if len(covariance.masses):
        cells = [with_deviations(robot.cell, row) for row in covariance.masses]
        moves = np.concatenate((moves, robot.pose_moved_by_masses(cells, q)))
    return robot.tool_moves(moves, q)


def with_exact_tool(covariance: ToolCovariance) -> ToolCovariance:
    """The covariance for a robot whose tool is another one, of exactly known mass."""
    masses = covariance.masses.copy()
    masses[:, :TOOL] = 0.0
    return replace(covariance, masses=masses)
