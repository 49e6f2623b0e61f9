"""Kinematics of an identified robot as a service: poses, joint angles, Jacobian, uncertainty.

Joint angles q are those that the controller shows, as angles of the DH model. Gears that yield
under the arm's own weight and the payload, backlash, transmission error and joint errors lie
between them and the pose. Inverse kinematics therefore takes the configurations of the nominal arm
(closed form, or a search), then Newton steps with the Jacobian of the identified rows on the error
of the whole forward kinematics. What is left of the pose is stated with every solution.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbar.cell.arrays import Array, finite_rows, rigid_poses
from ballbar.cell.chain import Chain, cross, forward, joint_screws
from ballbar.cell.closed_form import arm_branches, has_arm_branches
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.numerical_inverse import (
    damped_step,
    dexterity,
    in_range,
    pose_branches,
    turned_near,
)
from ballbar.cell.payload import Payload, with_payload
from ballbar.cell.placement import Placement
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.cell.rotation import rotvec_from_matrix
from ballbar.ident.robot.identified import (
    IdentifiedRobot,
    PositionUncertainty,
    moved_poses,
    range_sentence,
)
from ballbar.ident.robot.inverse_calibration import CorrectedTargets, corrected_targets
from ballbar.ident.robot.tool_covariance import ToolCovariance, with_exact_tool

Index = tuple[NDArray[np.intp], NDArray[np.intp]]  # rows and samples
# joint angles (S, N, J) [rad] to start from, of wanted poses (N, 4, 4) and previous angles (N, J)
Starts = Callable[[Array, Array], Array]

BLOCK = 4096  # poses computed at a time: their frames stay in the cache
REACHED = 1e-7  # [m, rad] left of a pose that is taken: far below any robot's repeatability
SINGULAR = 0.02  # [-] dexterity below which a posture is called near-singular: wrist within 2 deg
_CLEAR = 0.08  # [-] dexterity above which no other posture is nearly as close
CLOSE = 0.3  # [rad] of each joint within which a solution is taken for the nearest one
_STEPS = 12  # of Newton at most; gears add half a percent to the Jacobian, so each gains two digits
_BEYOND = 0.01  # [-] of the nominal robot's reach by which an identified one may be longer
_OUTSIDE = 1e4  # [rad^2] more than any posture within the ranges is away from another one
_SETTLED = 1e-10  # [m, rad] of a pose that needs no further step


@dataclass(frozen=True, eq=False)
class JointSolutions:
    """Joint angles for N poses, in S configurations each (or in one, without that axis)."""

    q: Array  # (S, N, J) [rad]; NaN where there is no further configuration
    position_left: Array  # (S, N) [m] distance of the pose that q leads to from the wanted one
    angle_left: Array  # (S, N) [rad]
    reached: NDArray[np.bool_]  # (S, N) whether both are below REACHED
    within: NDArray[np.bool_]  # (S, N) whether every axis is within its range
    dexterity: Array  # (S, N) [-] 0 at a singular posture (numerical_inverse.dexterity)

    @property
    def singular(self) -> NDArray[np.bool_]:
        """(S, N) near a singular posture, where small changes of the pose turn axes far."""
        return np.asarray(self.dexterity < SINGULAR)


@dataclass(frozen=True, eq=False)
class IdentifiedKinematics:
    """An identified robot with a tool."""

    identified: IdentifiedRobot
    nominal: Chain  # catalogue rows

    @property
    def robot(self) -> Robot:
        """The nominal robot: its axes and their ranges."""
        return self.identified.robot

    def forward(self, q: ArrayLike) -> Array:
        """(N, 4, 4) frames of the tool in the robot's base frame at q (N, J) [rad]."""
        return self._forward(self._angles(q))

    def jacobian(self, q: ArrayLike) -> Array:
        """(N, 6, J) motion of the tool [m/rad, -], base frame, per unit of each actual joint angle.

        Source: screws of the identified rows. What gears add between logged and actual angles is
        left out: of an IRB 2400 with ripple of every gear mostly 0.4 percent, 1.5 for one angle in
        twenty, and more where backlash is passed.
        """
        angles = self._angles(q)
        out = np.empty((len(angles), 6, self.robot.joints))
        for part in _blocks(len(angles)):
            frames = forward(self.identified.chain, self.identified.joints(angles[part]))
            screws = joint_screws(frames)
            arm = np.einsum("ijn,j->in", frames.rotation(), self.identified.tool_matrix[:3, 3])
            for screw in screws:
                screw[:3] += cross(screw[3:], arm)
            out[part] = screws.transpose(2, 1, 0)
        return out

    def inverse(self, poses: ArrayLike) -> JointSolutions:
        """Every configuration of the arm at poses (N, 4, 4) of the tool, base frame.

        Each axis is turned by whole turns towards the centre of its range. A pose that the robot
        cannot take has no solution that is `reached`. Raises InputError for what is no pose.
        """
        wanted = rigid_poses(poses)
        starts = self._starts(wanted @ np.linalg.inv(self.identified.tool_matrix))
        return self._solved(in_range(self.robot, starts[..., None, :])[..., 0, :], wanted)

    def nearest(self, poses: ArrayLike, q: ArrayLike) -> JointSolutions:
        """The configuration nearest to q (N, J) or (J,) [rad] at each of poses (N, 4, 4).

        Nearest is the least sum of squares of axis angles, of those within the axis ranges where
        there are any. The arrays of the result have no axis S. Raises InputError as `inverse`.
        """
        wanted = rigid_poses(poses)
        given = np.asarray(q)
        previous = self._angles(np.tile(given, (len(wanted), 1)) if given.ndim == 1 else given)
        if len(previous) != len(wanted):
            raise InputError(f"{len(previous)} joint angles for {len(wanted)} poses: give one or N")
        search = not has_arm_branches(self.nominal)
        first = self._from_previous if search else self._from_nearest
        out = _single(self._solved(first(wanted, previous), wanted))
        if not search:  # the nominal arm may lack the posture next to q, or stand close to two
            doubted = ~self._settled(out, previous) | (out.dexterity < _CLEAR)
            self._improve(out, doubted, self._from_previous, wanted, previous)
        left = ~self._settled(out, previous) if search else ~out.reached
        self._improve(out, left, self._from_all, wanted, previous)
        return out

    def _improve(
        self,
        out: JointSolutions,
        rows: NDArray[np.bool_],
        starts: Starts,
        wanted: Array,
        previous: Array,
    ) -> None:
        """Puts nearer solutions in the place of some rows (N,) of `out`."""
        at = np.flatnonzero(rows)
        if not at.size:
            return
        angles = previous[at]
        every = self._solved(starts(wanted[at], angles), wanted[at])
        ranks = np.where(every.reached, self._rank(every.q, angles), np.inf)
        best = _least(ranks)
        others = np.where(out.reached[at], self._rank(out.q[at], angles), np.inf)
        taken = ranks[best] < others
        for values, new in zip(
            vars(out).values(), vars(_single(every, best)).values(), strict=True
        ):
            values[at[taken]] = new[taken]

    def _settled(self, out: JointSolutions, previous: Array) -> NDArray[np.bool_]:
        """(N,) whether no other solution can be the nearest one."""
        with np.errstate(invalid="ignore"):
            close = (np.abs(out.q - previous) < CLOSE).all(axis=1)
        return np.asarray(out.reached & out.within & close)

    def _rank(self, q: Array, previous: Array) -> Array:
        """(..., N) [rad^2] by which solutions are the nearest to previous ones (N, J).

        The sum of squares of axis angles, more than any such outside of the ranges; NaN of NaN.
        """
        axes = joints_to_axes(self.robot, q)
        away = axes - joints_to_axes(self.robot, previous)
        with np.errstate(invalid="ignore"):
            outside = (axes < self.robot.axis_lower) | (axes > self.robot.axis_upper)
        return np.asarray((away**2).sum(axis=-1) + _OUTSIDE * outside.any(axis=-1))

    def _from_previous(self, wanted: Array, previous: Array) -> Array:  # noqa: ARG002  see Starts
        """(1, N, J) [rad] the previous angles."""
        return previous[None]

    def _from_all(self, wanted: Array, previous: Array) -> Array:
        """(S, N, J) [rad] starts of all configurations, turned to the previous angles (N, J)."""
        starts = self._starts(wanted @ np.linalg.inv(self.identified.tool_matrix))
        return np.stack([turned_near(self.robot, start, previous) for start in starts])

    def _from_nearest(self, wanted: Array, previous: Array) -> Array:
        """(1, N, J) [rad] start of the configuration nearest to the previous angles (N, J)."""
        starts = self._from_all(wanted, previous)
        return np.asarray(starts[_least(self._rank(starts, previous))][None])

    def uncertainty(self, q: ArrayLike) -> PositionUncertainty:
        """Uncertainty of the tool's position at q (N, J) [rad].

        Where a joint leaves the range that was fitted it warns, and `covered` is false: of
        recordings the figure there is the model's alone, of still poses it is infinite. Raises
        InputError where the calibration states no covariance.
        """
        angles = self._angles(q)
        stated = self.identified.uncertainty(angles)
        if axes := self.identified.out_of_range(angles):
            warnings.warn(f"some poses are {range_sentence(axes)}", stacklevel=2)
        return stated

    def corrected(self, q: ArrayLike) -> CorrectedTargets:
        """Targets that take the identified robot to where the nominal one would be at q (N, J)
        [rad].

        Raises TargetError as `corrected_targets`.
        """
        return corrected_targets(self.identified, self.nominal, self._angles(q))

    def _angles(self, q: ArrayLike) -> Array:
        """(N, J) [rad] as numbers. Raises InputError for what are no angles of the joints."""
        return finite_rows(q, (self.robot.joints,), "joint angles", "[rad]")

    def _forward(self, q: Array) -> Array:
        """(N, 4, 4) frames of the tool at q (N, J) [rad], some at a time."""
        poses = np.empty((len(q), 4, 4))
        for part in _blocks(len(q)):
            poses[part] = self.identified.ends(q[part]) @ self.identified.tool_matrix
        return poses

    def _starts(self, ends: Array) -> Array:
        """(S, N, J) [rad] configurations close to frames of the last row; NaN where none."""
        starts = arm_branches(self.nominal, ends, beyond=_BEYOND)
        return pose_branches(self.identified.chain, ends) if starts is None else starts

    def _solved(self, starts: Array, poses: Array) -> JointSolutions:
        """Solutions from starts (S, N, J) [rad] close by, for poses (N, 4, 4) of the tool."""
        shape, some = starts.shape[:2], ~np.isnan(starts).any(axis=2)
        q = np.full(starts.shape, np.nan)
        left = np.full((2, *shape), np.inf)
        dexterous = np.full(shape, np.nan)
        rows, samples = np.nonzero(some)
        for part in _blocks(rows.size):
            at = rows[part], samples[part]
            solved, errors, size = self._refined(starts[at], poses[samples[part]])
            q[at], dexterous[at] = solved, size
            left[:, at[0], at[1]] = errors
        reached = (left < REACHED).all(axis=0)
        # beside others; of a pose out of reach all are stated
        lost = ~reached & reached.any(axis=0)
        q[lost], left[:, lost], dexterous[lost] = np.nan, np.inf, np.nan
        axes = joints_to_axes(self.robot, q)
        with np.errstate(invalid="ignore"):
            within = ((axes >= self.robot.axis_lower) & (axes <= self.robot.axis_upper)).all(axis=2)
        return JointSolutions(
            q=q,
            position_left=left[0],
            angle_left=left[1],
            reached=np.asarray(reached),
            within=np.asarray(within),
            dexterity=dexterous,
        )

    def _refined(self, starts: Array, poses: Array) -> tuple[Array, Array, Array]:
        """Solutions (K, J) [rad], what is left (2, K) [m, rad], and dexterity (K,)."""
        ends = poses @ np.linalg.inv(self.identified.tool_matrix)
        q, rest = starts.copy(), np.arange(len(starts))
        for _ in range(_STEPS):
            joints, motion = self.identified.deflected(q[rest])
            frames = forward(self.identified.chain, joints)
            error = _difference(ends[rest], moved_poses(frames.poses(), motion))
            open_ = np.abs(error).max(axis=0) > _SETTLED
            if not open_.any():
                break
            rest = rest[open_]
            q[rest] += damped_step(self.identified.chain, frames.part(open_), error[:, open_])
        left = _difference(poses, self._forward(q))
        sizes = np.stack([np.linalg.norm(part, axis=0) for part in (left[:3], left[3:])])
        return q, sizes, dexterity(self.identified.chain, self.identified.joints(q))


def _least(sizes: Array) -> Index:
    """Where the least of sizes (S, N) is for each n; NaN is none."""
    rows = np.where(np.isnan(sizes), np.inf, sizes).argmin(axis=0)
    return rows, np.arange(rows.size)


def _single(solutions: JointSolutions, at: Index | int = 0) -> JointSolutions:
    """Solutions of one configuration for each pose, without the axis S."""
    return JointSolutions(*(values[at] for values in vars(solutions).values()))


def _difference(wanted: Array, reached: Array) -> Array:
    """(6, N) [m, rad] from reached poses (N, 4, 4) to wanted ones, base frame."""
    turned = wanted[:, :3, :3] @ reached[:, :3, :3].transpose(0, 2, 1)
    shift = wanted[:, :3, 3] - reached[:, :3, 3]
    return np.concatenate((shift.T, rotvec_from_matrix(turned.transpose(1, 2, 0))))


def kinematics(
    identified: IdentifiedRobot,
    nominal: Chain,
    *,
    payload: Payload | None = None,
    tool: Array | None = None,
) -> IdentifiedKinematics:
    """Kinematics of an identified robot, whatever measured it.

    nominal : catalogue rows of its geometry. payload : of recordings, in the flange's frame, in
    place of the offset plate; sag of still poses is fitted as it showed, without masses. tool :
    (4, 4) frame of the tool in that of the flange; by default the robot's own.
    """
    robot = identified.robot
    if payload is not None:
        stated = identified.stated
        identified = replace(
            identified,
            description=with_payload(identified.cell, payload),
            stated=with_exact_tool(stated) if isinstance(stated, ToolCovariance) else stated,
        )
    if tool is not None:
        at_zero = np.zeros((1, robot.joints))
        flange, end = (forward(c, at_zero).poses()[0] for c in (nominal_chain(robot), nominal))
        placed = np.linalg.solve(end, flange) @ rigid_poses([tool])[0]
        identified = replace(identified, target=Placement(placed[:3, :3], placed[:3, 3]))
    return IdentifiedKinematics(identified, nominal)


def _blocks(count: int) -> list[slice]:
    return [slice(begin, begin + BLOCK) for begin in range(0, count, BLOCK)]
