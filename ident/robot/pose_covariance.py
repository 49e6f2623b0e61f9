"""Stated uncertainty of a robot that was identified from still poses.

The region that holds 95 % of poses comes from cross-validation (ballbar.ident.cross_validation),
not from the instrument's sigma alone. Outside the range over which an axis was fitted nothing is
known of the error, so the stated uncertainty there is infinite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.chain import joint_screws
from ballbar.cell.placement import Placement
from ballbar.cell.statistics import covariance_root
from ballbar.ident.loads.at_rest import undecided_flanks
from ballbar.ident.robot.identified import IdentifiedRobot, PositionUncertainty


@dataclass(frozen=True, eq=False)
class PoseCovariance:
    """Covariance of the robot's unknowns, of a target and of the seat that positions refer to."""

    seat: Placement  # of the instrument in the robot's base frame: positions are relative to it
    seat_turns: bool  # whether the seat is a whole frame, or a point
    parameters: NDArray[np.intp]  # (P,) indices into the robot's table
    values: Array  # (U, U) of parameters, coefficients, the target's position and the seat
    discrepancy: float  # [m] that the model leaves unexplained, along each axis, noise included
    factor: float  # of the region's size, over that of chi-square
    joint_sigma: float = 0.0  # [rad] of each joint, where nothing but lengths judged the model
    white: float = 0.0  # [m] of the discrepancy: noise of what followed a moving robot, no error

    inside_only: ClassVar[bool] = True

    @property
    def left_over(self) -> float:
        """[m] error of a pose along each axis, white noise of what followed the robot taken off."""
        return float(np.sqrt(max(0.0, self.discrepancy**2 - self.white**2)))

    def of(self, robot: IdentifiedRobot) -> Callable[[Array], PositionUncertainty]:
        """Uncertainty of the target's position as a function of q (N, J) [rad]."""
        jacobian = self.jacobian(robot)

        def uncertainty(q: Array) -> PositionUncertainty:
            moves, covered = jacobian(q), robot.covered(q)
            half = np.einsum("pq,qcn->pcn", self.values, moves)
            result = np.einsum("pcn,pdn->ncd", moves, half) + self.left_over**2 * np.eye(3)
            own = self._of_joints(robot, q)
            result += np.einsum("kcn,kdn->ncd", own, own)
            result[~covered] = np.inf
            return PositionUncertainty(np.asarray(result), None, covered)

        return uncertainty

    def poses(self, robot: IdentifiedRobot) -> Array:
        """(G, J) [rad] poses within the fitted ranges, over which the uncertainty is stated."""
        return robot.workspace()

    def columns(self, robot: IdentifiedRobot) -> Array:
        """(3G, U) [m] error of the target at `poses` per unit of each unknown, from the seat."""
        moves = self.jacobian(robot)(self.poses(robot))
        return np.asarray(moves.transpose(2, 1, 0).reshape(-1, len(moves)))

    def draws(self, robot: IdentifiedRobot, count: int, rng: np.random.Generator) -> Array:
        """(D, G, 3) [m] draws of the target's error at `poses`.

        Errors that the model leaves unexplained are drawn for each pose.
        """
        unknowns = covariance_root(self.values) @ rng.standard_normal((len(self.values), count))
        errors = (self.columns(robot) @ unknowns).T.reshape(count, -1, 3)
        left = np.sqrt(max(0.0, self.discrepancy**2 - self.white**2))
        errors += left * rng.standard_normal(errors.shape)
        own = self._of_joints(robot, self.poses(robot))
        errors += np.einsum("kcn,dkn->dnc", own, rng.standard_normal((count, *own.shape[::2])))
        return np.asarray(errors)

    def _of_joints(self, robot: IdentifiedRobot, q: Array) -> Array:
        """(K, 3, N) [m] errors of the target that joints make at each pose, for one deviation.

        Of all joints where nothing but lengths judged the model, and where friction may hold a gear
        of a small arm on either flank of its backlash.
        """
        screws = joint_screws(robot.frames(q))[: robot.robot.joints, :3]
        gears = np.einsum("gj,jcn->gcn", robot.robot.gear_to_joint, screws)
        every = (self.joint_sigma * screws, _undecided_play(robot, q)[:, None] * gears)
        return np.concatenate([part for part in every if part.any()] or [screws[:0]])

    def jacobian(self, robot: IdentifiedRobot) -> Callable[[Array], Array]:
        """Function of q (N, J) [rad] that gives (U, 3, N) change of the target, seen from the seat
        [m], per unit of each unknown.

        Of a seat that is a point, the shift and turn of the whole robot that follow each unknown
        over the workspace are taken out.
        """
        if self.seat_turns:

            def from_frame(q: Array) -> Array:
                moves, rigid = self._moves(robot, q)
                return np.concatenate((moves, -rigid))

            return from_frame
        moves, rigid = self._moves(robot, robot.workspace())
        flat = rigid.reshape(6, -1)
        followed = np.linalg.lstsq(flat.T, moves.reshape(len(moves), -1).T, rcond=None)[0].T

        def from_point(q: Array) -> Array:
            moves, rigid = self._moves(robot, q)
            along = np.einsum("ur,rcn->ucn", followed, rigid)
            return np.concatenate((moves - along, np.zeros_like(rigid[:3])))

        return from_point

    def _moves(self, robot: IdentifiedRobot, q: Array) -> tuple[Array, Array]:
        """(M, 3, N) motion of the target per unit of each unknown but the seat's, and (6, 3, N) in
        shifts and turns of the whole robot about the seat.
        """
        frames = robot.frames(q)
        shifts = np.repeat(np.eye(3)[:, :, None], len(q), axis=2)
        turns = np.cross(
            np.eye(3)[:, :, None], (frames.tip - self.seat.origin[:, None])[None], axis=1
        )
        by_target = frames.rotation(-2).transpose(1, 0, 2)
        moves = np.concatenate((robot.jacobian(q, self.parameters), by_target))
        return moves, np.concatenate((shifts, turns))


def _undecided_play(robot: IdentifiedRobot, q: Array) -> Array:
    """(J, N) [rad] half the backlash of gears that friction may hold on either flank, else 0."""
    half = np.zeros((robot.robot.joints, 1))
    coefficients = (k for correction in robot.corrections for k in correction.coefficients)
    for coefficient, value in zip(coefficients, robot.values, strict=True):
        if coefficient.name.startswith("backlash") and isinstance(coefficient.channel, int):
            half[coefficient.channel] = abs(value)
    if not half.any():
        return half * np.zeros(len(q))
    return half * undecided_flanks(robot.description, robot.geometry, robot.corrections, q)
