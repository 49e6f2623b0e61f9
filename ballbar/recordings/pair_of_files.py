"""Two files of still poses fitted together by the catalogue robot.

With the position x_i and rotation F_i of the flange, a seat (R, o) and a target t on the flange,
the residual of a measured point m_i is `x_i + F_i t - (R m_i + o)`, that of a length L_i is
`|x_i + F_i t - o| - L_i`. Both files have one seat or two, and one target or two. Of poses with
equal joint angles the difference of the two residuals is fitted, in which errors of the robot
cancel. A whole pose counts as three points of the target, so that its rotation counts too. Single
poses far off hardly matter: the fits end with a soft L1 loss, and a median judges them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from acquisition.faults.nominal_robot import judged, reach
from cell.arrays import Array
from cell.descriptions import Robot
from cell.geometry import nominal_chain
from cell.poses import PoseGroup, PoseTable
from cell.rigid_fit import nominal_frames, rigid_fit
from ident.start.placements import start_of_poses

# [m] in the target's frame: points that stand for a whole pose, the first one for its position.
_MARKS = 0.1 * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_REPEATED = 5.0e-4  # [m] of two measurements of one pose: repeatability, backlash, warming up
_ROBOT = 1.0e-3  # of the reach: what a catalogue robot leaves, at least; UR5 0.5e-3, UR10 0.6e-3
_SIGMAS = 4.0  # of the instrument, likewise
# [m per m and rad] from the start: holds what differences, or an axis that stands, leave open.
_HELD = 1.0e-6

Flange = tuple[Array, Array]  # position (N, 3) [m] and rotation (N, 3, 3)
Hypothesis = tuple[bool, bool]  # whether two files have one seat, and whether they have one target


@dataclass(frozen=True, eq=False)
class MeasuredFile:
    """The poses of one file, or those of one seat and target in it."""

    name: str  # as reasons call it
    group: PoseGroup
    robot: Robot

    @cached_property
    def values(self) -> Array:
        """(K, N, 3) [m] measured points of K marks on the target; (1, N, 1) [m] lengths."""
        values = self.group.values
        if values.shape[1] < 6:
            return np.asarray(values[None])
        turns = Rotation.from_rotvec(values[:, 3:].copy()).as_matrix()  # (N, 3, 3)
        return np.stack([values[:, :3] + turns @ mark for mark in _MARKS])

    def flange(self, rows: NDArray[np.intp]) -> Flange:
        """Where the catalogue robot has its flange in rows (N,)."""
        frames = nominal_frames(self.robot, self.group.q[rows])
        return frames.tip.T, frames.rotation().transpose(2, 0, 1)

    @cached_property
    def start(self) -> tuple[Array, Array]:
        """Seat (6,) [rad, m] as rotation vector and origin, and marks (K, 3) [m] on the flange.

        Raises PoseStartError where the file does not fit the robot.
        """
        marks = np.zeros((len(self.values), 3))
        if self.group.measured == "length":
            table = PoseTable("", self.robot, (self.group,))
            start = start_of_poses(table, nominal_chain(self.robot))
            origin = start.seats[self.group.seat].origin
            return np.append(np.zeros(3), origin), marks + start.targets[self.group.target].origin
        rows = judged(self.group.size)
        frames, points = nominal_frames(self.robot, self.group.q[rows]), self.values[0, rows]
        turn = rigid_fit(frames, points).rotation.T
        origin = np.median(frames.tip.T - points @ turn.T, axis=0)
        return np.append(Rotation.from_matrix(turn).as_rotvec(), origin), marks

    def residual(self, seat: Array, marks: Array, rows: NDArray[np.intp], at: Flange) -> Array:
        """(K, N, 3 or 1) [m] residual of rows (N,) with a seat (6,) and marks (K, 3) [m].

        at : position (N, 3) [m] and rotation (N, 3, 3) of the flange in these rows.
        """
        tip = at[0] + np.einsum("nij,kj->kni", at[1], marks)
        values = self.values[:, rows]
        if values.shape[2] == 1:
            return np.asarray(np.linalg.norm(tip - seat[3:], axis=2, keepdims=True) - values)
        turn = Rotation.from_rotvec(seat[:3]).as_matrix()
        return np.asarray(tip - (values @ turn.T + seat[3:]))


@dataclass(frozen=True, eq=False)
class PairFit:
    """Two files fitted together."""

    misfit: float  # [m] median residual of a pose, in the file that fits worse
    seats: tuple[Array, Array]
    targets: tuple[Array, Array]

    @property
    def apart(self) -> float:
        """[m] distance of the targets on the flange."""
        return float(np.linalg.norm(self.targets[1][0] - self.targets[0][0]))

    @property
    def turned(self) -> float:
        """[deg] between the seats."""
        first, second = (Rotation.from_rotvec(seat[:3]) for seat in self.seats)
        return float(np.rad2deg((first.inv() * second).magnitude()))

    @property
    def moved(self) -> float:
        """[m] between the origins of the seats."""
        return float(np.linalg.norm(self.seats[1][3:] - self.seats[0][3:]))


@dataclass(frozen=True, eq=False)
class FilePair:
    """Rows of two files that are fitted together."""

    a: MeasuredFile
    b: MeasuredFile
    rows: tuple[NDArray[np.intp], NDArray[np.intp]]
    paired: bool  # rows of equal joint angles, whose differences count

    @cached_property
    def tolerance(self) -> float:
        """[m] residual of a pose that a right hypothesis may leave."""
        own = _REPEATED if self.paired else _ROBOT * reach(self.a.robot)
        sigma = max(float(np.median(each.group.sigma[:, :3])) for each in (self.a, self.b))
        return max(own, _SIGMAS * sigma)

    def fit(self, hypothesis: Hypothesis) -> PairFit:
        """Both files by one seat or two, one target or two."""
        one_seat, one_target = hypothesis
        (seat_a, target_a), (seat_b, target_b) = self.a.start, self.b.start
        parts = [seat_a, target_a.ravel()]
        parts += [] if one_seat else [seat_b]
        parts += [] if one_target else [target_b.ravel()]
        marks = target_a.size

        def placed(x: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
            seat, target = x[:6], x[6 : 6 + marks]
            seats = (seat, seat if one_seat else x[6 + marks : 12 + marks])
            targets = (target, target if one_target else x[-marks:])
            return seats, (targets[0].reshape(-1, 3), targets[1].reshape(-1, 3))

        at_a = self.a.flange(self.rows[0])
        at_b = at_a if self.paired else self.b.flange(self.rows[1])  # but for their rounding

        def residuals(x: Array) -> list[Array]:
            seats, targets = placed(x)
            first = self.a.residual(seats[0], targets[0], self.rows[0], at_a)
            second = self.b.residual(seats[1], targets[1], self.rows[1], at_b)
            return [second - first] if self.paired else [first, second]

        x = np.concatenate(parts)
        start, free = x.copy(), np.ones(x.size, dtype=bool)
        free[3 : 6 + marks] = not self.paired  # origin and target of the first file cancel

        def stacked(unknown: Array) -> Array:
            x[free] = unknown
            held = _HELD * (x - start)
            return np.concatenate([*(part.ravel() for part in residuals(x)), held])

        for loss in ("linear", "soft_l1"):  # squares first: they come from far in few steps
            x[free] = least_squares(
                stacked, x[free], loss=loss, f_scale=self.tolerance, x_scale="jac", max_nfev=50
            ).x
        return PairFit(max(map(_median_distance, residuals(x))), *placed(x))


def _median_distance(residual: Array) -> float:
    """[m] median over poses of residuals (K, N, 3 or 1) [m]."""
    return float(np.median(np.sqrt((residual**2).sum(axis=2).mean(axis=0))))
