"""Whether two files of still poses share their seat and their target, by what they show.

With the position x_i and rotation F_i of the flange, a seat (R, o) and a target t on the flange,
the residual of a measured point m_i is `x_i + F_i t - (R m_i + o)`, that of a length L_i is
`|x_i + F_i t - o| - L_i`. Four hypotheses are fitted: one seat or two, one target or two. Those
that leave little more than two seats and two targets do are possible, and the simplest of them is
taken. Of poses with equal joint angles the difference of the two residuals is fitted, in which
errors of the robot cancel: such files are compared to tenths of a millimetre, others to the
millimetres of the catalogue robot. A whole pose counts as three points of the target, so that its
rotation counts too. Single poses far off hardly matter: the fits end with a soft L1 loss, and a
median judges them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ballbar.acquisition.faults.nominal_robot import judged, reach
from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.cell.rigid_fit import nominal_frames, rigid_fit
from ballbar.ident.start.placements import PoseStartError, start_of_poses
from ballbar.ident.table_steps import LARGEST
from ballbar.units import MM

# [m] in the target's frame: points that stand for a whole pose, the first one for its position.
_MARKS = 0.1 * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_REPEATED = 5.0e-4  # [m] of two measurements of one pose: repeatability, backlash, warming up
_ROBOT = 1.0e-3  # of the reach: what a catalogue robot leaves, at least; UR5 0.5e-3, UR10 0.6e-3
_SIGMAS = 4.0  # of the instrument: what its noise leaves
# [m per m and rad] from the start: holds what differences, or an axis that stands, leave open.
_HELD = 1.0e-6
_FEWEST = 10  # poses: fewer fit many seats and targets
_FEWEST_LENGTHS = 20  # of one equation each instead of three
_JUDGED = 100  # poses of a file; more show nothing new
# [rad] between joint angles of one pose in two files: angles rounded to 0.1 deg, and repeatability.
_EQUAL = 1.0e-3
# Times the misfit with two seats and two targets. Of 746 pairs of files of drawn robots (points; 10
# to 100 poses; 0.5 to 2 mrad, 0.3 to 1 mm) 739 were seen right, 6 not at all, none as less than it
# was.
_MORE = 1.5
_HOPELESS = 5.0  # times the tolerance, with two seats and two targets: another robot or columns
_APART = 1.0  # [m] no two targets on one flange are further apart

Flange = tuple[Array, Array]  # position (N, 3) [m] and rotation (N, 3, 3)
Hypothesis = tuple[bool, bool]  # whether two files have one seat, and whether they have one target
_SAME: Hypothesis = (True, True)
_TARGET: Hypothesis = (True, False)
_SEAT: Hypothesis = (False, True)
_OTHERS: Hypothesis = (False, False)


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
    placed: Array  # (2, 6 + 3 K) [rad, m] seat, and marks on the flange, of each file

    @property
    def apart(self) -> float:
        """[m] distance of the targets on the flange."""
        return float(np.linalg.norm(np.diff(self.placed[:, 6:9], axis=0)))

    @property
    def turned(self) -> float:
        """[deg] between the seats."""
        first, second = Rotation.from_rotvec(self.placed[:, :3])
        return float(np.rad2deg((first.inv() * second).magnitude()))

    @property
    def moved(self) -> float:
        """[m] between the origins of the seats."""
        return float(np.linalg.norm(np.diff(self.placed[:, 3:6], axis=0)))


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
        files = self.a, self.b
        own = np.stack([np.append(*file.start) for file in files])  # seat and marks of each
        places = np.arange(own.size).reshape(own.shape)  # of these numbers in the unknowns
        for shared, part in zip(hypothesis, (slice(6), slice(6, None)), strict=True):
            places[1, part] = places[0 if shared else 1, part]
        at = [file.flange(rows) for file, rows in zip(files, self.rows, strict=True)]
        if self.paired:
            at[1] = at[0]  # but for their rounding

        def residuals(x: Array) -> list[Array]:
            parts = [
                file.residual(numbers[:6], numbers[6:].reshape(-1, 3), rows, flange)
                for file, numbers, rows, flange in zip(files, x[places], self.rows, at, strict=True)
            ]
            return [parts[1] - parts[0]] if self.paired else parts

        x, free = own.ravel(), np.isin(np.arange(own.size), places)
        start = x.copy()
        free[3 : own.shape[1]] = not self.paired  # origin and target of the first file cancel

        def stacked(unknown: Array) -> Array:
            x[free] = unknown
            held = _HELD * (x - start)
            return np.concatenate([*(part.ravel() for part in residuals(x)), held])

        for loss in ("linear", "soft_l1"):  # squares first: they come from far in few steps
            x[free] = least_squares(
                stacked, x[free], loss=loss, f_scale=self.tolerance, x_scale="jac", max_nfev=50
            ).x
        misfits = (np.sqrt((part**2).sum(axis=2).mean(axis=0)) for part in residuals(x))  # [m]
        return PairFit(max(float(np.median(misfit)) for misfit in misfits), x[places])


@dataclass(frozen=True)
class Relation:
    """Seat and target of two files: shared or not."""

    shared: tuple[bool | None, bool | None]  # seat, target; None where they do not show it
    reason: str  # about the second file


def relation(
    a: MeasuredFile, b: MeasuredFile, known: tuple[bool | None, bool | None] = (None, None)
) -> Relation:
    """Whether two files share their seat and their target.

    known : whether they share the seat, and the target, as far as that is known.
    """
    fewest = _FEWEST_LENGTHS if a.group.measured == "length" else _FEWEST
    if min(a.group.size, b.group.size) < fewest:
        return Relation(known, f"it or {a.name} has fewer than {fewest} poses")
    hypotheses = [
        each
        for each in (_SAME, _TARGET, _SEAT, _OTHERS)
        if all(k in (None, shared) for k, shared in zip(known, each, strict=True))
    ]
    pairs = _equal_angles(a.group.q, b.group.q)
    paired = len(pairs[0]) >= _FEWEST
    every = (judged(a.group.size, _JUDGED), judged(b.group.size, _JUDGED))
    pair = FilePair(a, b, pairs if paired else every, paired)
    try:
        if paired and a.group.measured == "length":
            # Errors of the robot do not cancel in lengths from two seats, or to two targets.
            again = pair.fit(_SAME)
            if _SAME in hypotheses and again.misfit <= pair.tolerance:
                return Relation(_SAME, _reason(pair, _SAME, again))
            pair = FilePair(a, b, every, paired=False)
            hypotheses = [each for each in hypotheses if each != _SAME]
        free = pair.fit(_OTHERS)
        if free.misfit > _HOPELESS * pair.tolerance:
            left = _length(free.misfit)
            return Relation(known, f"beside {a.name} it fits the catalogue robot to {left} at best")
        possible = _possible(pair, hypotheses, free)
    except PoseStartError:
        return Relation(known, f"it or {a.name} does not fit the catalogue robot")
    match list(possible):
        case [hypothesis]:
            reason = _reason(pair, hypothesis, possible[hypothesis])
            if hypothesis == _SAME and possible[hypothesis].misfit > LARGEST:
                return Relation(known, f"{reason}: too little to tell")
            return Relation(hypothesis, reason)
        case []:
            given = "seat" if known[0] else "target"
            return Relation(known, f"it and {a.name} do not fit the one {given} that is given")
    reason = f"another seat than that of {a.name} explains it, and so does another target"
    return Relation((None, None), reason)


def _possible(
    pair: FilePair, hypotheses: Sequence[Hypothesis], free: PairFit
) -> dict[Hypothesis, PairFit]:
    """The simplest hypothesis that fits; two if none is simpler and none fits far better.

    free : the fit with two seats and two targets.
    """
    limit = max(pair.tolerance, _MORE * free.misfit)
    fits = {each: pair.fit(each) for each in hypotheses if each != _OTHERS}
    fits = {h: fit for h, fit in fits.items() if fit.misfit <= limit and fit.apart <= _APART}
    if _SAME in fits:
        return {_SAME: fits[_SAME]}
    if len(fits) == 2:
        least = 0.1 * pair.tolerance  # below which one is as good as the other
        target, seat = (max(fits[each].misfit, least) for each in (_TARGET, _SEAT))
        if target * _MORE <= seat:
            del fits[_SEAT]
        elif seat * _MORE <= target:
            del fits[_TARGET]
    return fits or ({_OTHERS: free} if _OTHERS in hypotheses else {})


def _equal_angles(a: Array, b: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows of a (N, J) and b (M, J) [rad] with equal joint angles, _JUDGED pairs at most."""
    distance, index = cKDTree(a).query(b, p=np.inf)
    nearest = np.asarray(index, dtype=np.intp)  # (M,)
    rows = np.flatnonzero(distance <= _EQUAL)
    rows = rows[np.unique(nearest[rows], return_index=True)[1]]
    rows = rows[judged(rows.size, _JUDGED)] if rows.size else rows
    return nearest[rows], rows


def _reason(pair: FilePair, hypothesis: Hypothesis, fit: PairFit) -> str:
    """Sentence on what two files show of the hypothesis that fits."""
    a, left = pair.a.name, f"{max(fit.misfit * MM, 0.01):.2g} mm"
    apart = _length(fit.apart)
    moved = _length(fit.moved)
    if pair.a.group.measured != "length":
        moved += f" and {fit.turned:.1f} deg"
    if pair.paired:
        at = "at equal joint angles its"
        return {
            _SAME: f"{at} values are those of {a} within {left}: one seat and one target",
            _TARGET: f"{at} points are {apart} beside those of {a} and turn with the flange: "
            "another target",
            _SEAT: f"{at} points are those of {a}, moved by {moved} as a whole: another seat",
            _OTHERS: f"{at} points are neither those of {a} moved as a whole, nor points beside "
            "them on the flange: another seat and another target",
        }[hypothesis]
    both = f"fit it and {a} to {left} by the catalogue robot"
    return {
        _SAME: f"one seat and one target {both}",
        _TARGET: f"one seat and two targets, {apart} apart, {both}: another target",
        _SEAT: f"two seats, {moved} apart, and one target {both}: another seat",
        _OTHERS: f"only two seats and two targets {both}: another seat and another target",
    }[hypothesis]


def _length(metres: float) -> str:
    """A length for the reader."""
    return f"{metres:.3g} m" if metres >= 1.0 else f"{metres * MM:.3g} mm"
