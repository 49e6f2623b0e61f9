"""A robot as identified from still poses: where it puts a target, and how far to trust that.

The region that holds 95 % of poses comes from cross-validation (ident.cross_validation), not
from the instrument's sigma alone. Outside the range over which an axis was fitted nothing is known
of the error, so the stated uncertainty there is infinite.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.chain import Chain, Frames, forward, joint_screws, screw
from cell.descriptions import Robot
from cell.geometry import Parameter
from cell.placement import Placement, target_frames
from cell.statistics import chi_square_quantile
from ident.corrections.base import Correction
from ident.cross_validation import LEVEL
from ident.loads.at_rest import angles_at_rest, regressors_at_rest

WORKSPACE = 800  # poses, as many as the accuracy grid of a moving robot
_WORKSPACE_SEED = 2400  # the poses are part of the metric
RANGE_MARGIN = np.deg2rad(1.0)  # [rad] past the last fitted angle that still counts as inside


@dataclass(frozen=True, eq=False)
class IdentifiedArm:
    """DH rows, corrections of the joints and one target of an identified robot."""

    robot: Robot
    chain: Chain
    corrections: tuple[Correction, ...]
    values: Array  # (C,) of all coefficients, correction after correction
    target: Placement  # in the flange's frame
    seat: Placement  # of the instrument in the robot's base frame: positions are relative to it
    seat_turns: bool  # whether the seat is a whole frame, or a point
    parameters: tuple[Parameter, ...]
    covariance: Array  # (U, U) of parameters, coefficients, the target's position and the seat
    discrepancy: float  # [m] of what the model leaves unexplained, along each axis, noise included
    factor: float  # of the region's size, over that of chi-square
    lower: Array  # (J,) [rad] range of each joint that was fitted
    upper: Array  # (J,) [rad]
    joint_sigma: float = 0.0  # [rad] of each joint, where nothing but lengths judged the model

    def joints(self, q: Array) -> Array:
        """(N, J) [rad] actual joint angles at logged ones q (N, J) [rad]."""
        return angles_at_rest(self.robot, self.corrections, self.values, q)

    def frames(self, q: Array) -> Frames:
        """Frames of the robot at logged angles q (N, J) [rad]; the last is that of the target."""
        return target_frames(forward(self.chain, self.joints(q)), self.target)

    def tool(self, q: Array) -> Array:
        """(N, 3) [m] position of the target, robot base frame, at angles q (N, J) [rad].

        Warns of poses outside the range of an axis that was fitted; `sigma` is infinite there.
        """
        if axes := self.out_of_range(q):
            warnings.warn(f"some poses are {range_sentence(axes)}", stacklevel=2)
        return self.frames(q).tip.T

    def jacobian(self, q: Array) -> Array:
        """(U, 3, N) change of the target, seen from the seat [m], per unit of each unknown."""
        moves, rigid = self._moves(q)
        if self.seat_turns:
            return np.concatenate((moves, -rigid))
        along = np.einsum("ur,rcn->ucn", self._followed, rigid)
        return np.concatenate((moves - along, np.zeros_like(rigid[:3])))

    def _moves(self, q: Array) -> tuple[Array, Array]:
        """(M, 3, N) motion of the target per unit of each unknown but the seat's, and (6, 3, N) in
        shifts and turns of the whole robot about the seat.
        """
        frames = self.frames(q)
        rows = [screw(frames, p.kind, p.row)[:3] for p in self.parameters]
        joints = joint_screws(frames)[: self.robot.a.size, :3]
        gears = np.einsum("gj,jcn->gcn", self.robot.gear_to_joint, joints)
        each = [gears[k] * r for k, r in regressors_at_rest(self.robot, self.corrections, q)]
        shifts = np.repeat(np.eye(3)[:, :, None], len(q), axis=2)
        turns = np.cross(
            np.eye(3)[:, :, None], (frames.tip - self.seat.origin[:, None])[None], axis=1
        )
        moves = np.stack((*rows, *each, *frames.rotation(-2).transpose(1, 0, 2)))
        return moves, np.concatenate((shifts, turns))

    @cached_property
    def _followed(self) -> Array:
        """(M, 6) shift and turn of the whole robot that follow each unknown over the workspace."""
        moves, rigid = self._moves(self.workspace())
        flat = rigid.reshape(6, -1)
        return np.asarray(np.linalg.lstsq(flat.T, moves.reshape(len(moves), -1).T, rcond=None)[0].T)

    def covered(self, q: Array) -> NDArray[np.bool_]:
        """(N,) whether every angle of q (N, J) [rad] is within the fitted range of its axis."""
        low, high = self.lower - RANGE_MARGIN, self.upper + RANGE_MARGIN
        return np.asarray(((q >= low) & (q <= high)).all(axis=1))

    def position_covariance(self, q: Array) -> Array:
        """(N, 3, 3) [m^2] of the target's position at q (N, J) [rad]; infinite outside."""
        moves = self.jacobian(q)
        half = np.einsum("pq,qcn->pcn", self.covariance, moves)
        out = np.einsum("pcn,pdn->ncd", moves, half) + self.discrepancy**2 * np.eye(3)
        if self.joint_sigma:
            screws = joint_screws(self.frames(q))[: self.robot.joints, :3]
            out += self.joint_sigma**2 * np.einsum("jcn,jdn->ncd", screws, screws)
        out[~self.covered(q)] = np.inf
        return np.asarray(out)

    def sigma(self, q: Array) -> Array:
        """(N,) [m] standard deviation of the position, all axes together; infinite outside."""
        return np.asarray(np.sqrt(np.trace(self.position_covariance(q), axis1=1, axis2=2)))

    def within(self, q: Array, error: Array) -> NDArray[np.bool_]:
        """(N,) whether errors (N, 3) [m] of poses q (N, J) lie in their stated 95 % regions."""
        whole = self.position_covariance(q)
        inside = self.covered(q)
        whole[~inside] = np.eye(3)
        square = np.einsum("nc,nc->n", error, np.linalg.solve(whole, error[..., None])[..., 0])
        return np.asarray(
            np.where(inside, square <= self.factor * chi_square_quantile(LEVEL, 3), True)
        )

    def workspace(self) -> Array:
        """(G, J) [rad] the same random angles within the fitted ranges for everyone.

        Where nothing was fitted yet, within the ranges of the axes.
        """
        shares = np.random.default_rng(_WORKSPACE_SEED).uniform(size=(WORKSPACE, self.robot.joints))
        low = np.where(np.isfinite(self.lower), self.lower, self.robot.axis_lower)
        high = np.where(np.isfinite(self.upper), self.upper, self.robot.axis_upper)
        return np.asarray(low + shares * (high - low))

    def out_of_range(self, q: Array) -> dict[int, tuple[float, float]]:
        """Axes, from 1, that leave their fitted range [rad] at some of the poses q (N, J)."""
        low, high = self.lower - RANGE_MARGIN, self.upper + RANGE_MARGIN
        outside = ((q < low) | (q > high)).any(axis=0)
        return {
            int(j) + 1: (float(self.lower[j]), float(self.upper[j]))
            for j in np.flatnonzero(outside)
        }


def range_sentence(axes: dict[int, tuple[float, float]]) -> str:
    """What `IdentifiedArm.out_of_range` found, as a sentence."""
    parts = [
        f"axis {axis} ({np.rad2deg(low):.1f} to {np.rad2deg(high):.1f} deg)"
        for axis, (low, high) in axes.items()
    ]
    return (
        f"outside the fitted range of {', '.join(parts)}: the error there is unknown and may "
        "exceed that of the nominal robot"
    )
