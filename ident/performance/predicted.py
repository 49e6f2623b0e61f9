"""Characteristics that an identified robot predicts at the test poses, along a path and over the
workspace.

Of the nominal robot, pose accuracy is the distance between where the identified robot puts its tool
and where the nominal one would, base frames aligned over the workspace; its interval follows from
the covariance of the result. The identified robot's own error is unknown: its root mean square and
its 95 % quantile are those of the stated covariance C. With `tr(C)` and `tr(C C)` the squared
length of a normal error is taken as a gamma variable of the same mean and variance (Satterthwaite
1946). The corrected robot reaches the nominal poses with the errors of the identified one. How the
servo stops and follows is in none of them, so no repeatability is predicted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaincinv, gammaln

from ballbar.cell.arrays import Array
from ballbar.cell.rigid_fit import kabsch
from ballbar.cell.rotation import rotvec_from_matrix
from ballbar.ident.performance.characteristics import Characteristic, Statement, not_stated
from ballbar.ident.performance.cube import TestCube
from ballbar.ident.performance.iso_9283 import COVERAGE
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.identified_kinematics import IdentifiedKinematics
from ballbar.ident.robot.inverse_calibration import FULL

POINTS = 21  # of the straight path from P2 to P4
JUMP = 0.5  # [rad] between neighbours of them where another configuration is taken
NORMAL = 1.959964  # standard deviations of a normal value that hold 95 %
OUTSIDE = "outside the range of axes that was fitted, where nothing is known"
EXTRAPOLATED = "outside the range of axes that was fitted: by the model alone"
SAME = 1e-9  # of an uncertainty by which it varies where it is one for all poses
ONE_VALUE = "the result states one mean uncertainty for all poses within the fitted ranges"
NO_TURNS = "the result states no uncertainty of orientations"
FEWER = "targets of a robot with fewer than six axes cannot be corrected"
_SERVO, _HOURS = "how the servo stops is not known: measure repetitions", "with times, over hours"
REPEATED = {  # what only repetitions tell
    "RP_l": _SERVO,
    "vAP_p": f"{_SERVO} that approach a pose from three others",
    "RD": _SERVO,
    "dAP_p": f"{_SERVO} {_HOURS}",
    "dRP_l": f"{_SERVO} {_HOURS}",
    "RT_p": _SERVO,
}


@dataclass(frozen=True, eq=False)
class RobotPair:
    """An identified robot beside its nominal one, with the same tool."""

    nominal: IdentifiedKinematics
    identified: IdentifiedKinematics

    @property
    def robot(self) -> IdentifiedRobot:
        """The identified robot."""
        return self.identified.identified

    @cached_property
    def grid(self) -> Array:
        """(G, J) [rad] poses over which the base frames are aligned, and the errors averaged."""
        stated = self.robot.stated
        inside = stated is not None and stated.inside_only
        return self.robot.workspace() if inside else accuracy_grid(self.robot.robot)

    @cached_property
    def alignment(self) -> tuple[Array, Array]:
        """Rotation (3, 3) and shift (3,) [m] from the identified robot's base to the nominal's."""
        own, other = (k.forward(self.grid)[:, :3, 3] for k in (self.identified, self.nominal))
        turn = kabsch(own - own.mean(axis=0), other - other.mean(axis=0))
        return turn, other.mean(axis=0) - turn @ own.mean(axis=0)

    def bias(self, q: Array) -> tuple[Array, Array]:
        """Deviations (N, 3) [m] and (N, 3) [rad] of the identified tool from the nominal one at q
        (N, J) [rad], base frame.
        """
        turn, shift = self.alignment
        own, other = self.identified.forward(q), self.nominal.forward(q)
        turned = np.einsum("ij,njk,nlk->iln", turn, own[:, :3, :3], other[:, :3, :3])
        position = own[:, :3, 3] @ turn.T + shift - other[:, :3, 3]
        return np.asarray(position), rotvec_from_matrix(turned).T

    def covariance(self, q: Array) -> Array:
        """(N, 3, 3) [m^2] of the tool, so wide that a normal error of it has the stated region."""
        return np.asarray(self.robot.factor * self.robot.position_covariance(q))

    def of_all(self, before: Statement, own: Statement) -> tuple[Statement, Statement, Statement]:
        """Statements of the nominal, the identified and the corrected robot."""
        return before, own, own if self.robot.robot.joints >= FULL else not_stated(FEWER)


def predict(robots: RobotPair, cube: TestCube | None) -> Iterator[Characteristic]:
    """Rows of the five poses, of the distance and the straight path from P2 to P4, and of the
    workspace.
    """
    if cube is not None:
        (shifts, turns), covariances = robots.bias(cube.q), robots.covariance(cube.q)
        remarks = ["" if known else EXTRAPOLATED for known in robots.robot.covered(cube.q)]
        for k, own in enumerate(zip(shifts, turns, covariances, remarks, strict=True), start=1):
            yield from _pose(robots, f"P{k}", *own)
        yield _distance(robots, cube.poses[[1, 3], :3, 3], shifts[[1, 3]], covariances[[1, 3]])
        yield _path(robots, cube)
    yield from _workspace(robots)
    for symbol, why in REPEATED.items():
        yield Characteristic(symbol, "test poses", (not_stated(why),) * 3)


def _pose(
    robots: RobotPair, place: str, shift: Array, turn: Array, covariance: Array, remark: str
) -> Iterator[Characteristic]:
    """AP of one pose, whose deviation is shift (3,) [m] and turn (3,) [rad], by a covariance."""
    before = known_deviation(shift, covariance, remark)
    own = unknown_error(covariance, remark)
    yield Characteristic("AP_p", place, robots.of_all(before, own))
    for index, angle in zip("abc", turn, strict=True):
        before = Statement("predicted", float(angle), reason=NO_TURNS)
        yield Characteristic(f"AP_{index}", place, (before, *(not_stated(NO_TURNS),) * 2))


def _distance(
    robots: RobotPair, commanded: Array, shifts: Array, covariances: Array
) -> Characteristic:
    """AD between two positions (2, 3) [m], their deviations (2, 3) [m] and covariances (2, 3, 3).

    Errors at the two poses are correlated to a degree that the result does not state; the deviation
    of their difference is at most the sum of their deviations.
    """
    attained = commanded + shifts
    lengths = np.linalg.norm([np.diff(p, axis=0)[0] for p in (attained, commanded)], axis=1)
    along, off = np.diff(commanded, axis=0)[0] / lengths[1], float(lengths[0] - lengths[1])
    variances = np.einsum("c,ncd,d->n", along, covariances, along)
    width = NORMAL * float(np.sqrt(variances).sum())
    before = Statement("predicted", off, off - width, off + width)
    own = Statement("predicted", 0.0, -width, width, "an interval about no expected error")
    if not np.isfinite(width):
        before = own = not_stated(OUTSIDE)
    return Characteristic("AD_p", "P2-P4", robots.of_all(before, own))


def _path(robots: RobotPair, cube: TestCube) -> Characteristic:
    """AT along the straight path from P2 to P4, of the geometry alone."""
    poses = np.tile(cube.poses[1], (POINTS, 1, 1))
    begin, end = cube.poses[[1, 3], :3, 3]
    poses[:, :3, 3] = begin + np.linspace(0.0, 1.0, POINTS)[:, None] * (end - begin)
    solved = robots.nominal.nearest(poses, cube.q[0])
    jumps = np.abs(np.diff(solved.q, axis=0)).max() > JUMP
    if jumps or not (solved.reached & solved.within).all():
        why = not_stated("the robot does not take the straight path from P2 to P4")
        return Characteristic("AT_p", "P2-P4", (why,) * 3)
    along = (end - begin) / np.linalg.norm(end - begin)
    across = np.eye(3) - np.outer(along, along)
    away = robots.bias(solved.q)[0] @ across
    with np.errstate(invalid="ignore"):  # infinite where nothing is known
        covariance = across @ robots.covariance(solved.q) @ across
    stated = [robots.of_all(*_both(*each)) for each in zip(away, covariance, strict=True)]
    return Characteristic("AT_p", "P2-P4", _largest(stated))


def _workspace(robots: RobotPair) -> Iterator[Characteristic]:
    """AP over the workspace: its mean, with errors that are the same at all poses, and the largest
    value.
    """
    q = robots.grid
    pairs = zip(robots.bias(q)[0], robots.covariance(q), strict=True)
    stated = [robots.of_all(*_both(*each)) for each in pairs]
    known = [own for own in stated if own[0].value is not None]
    values = np.array([[[s.value, s.low, s.high] for s in own[:2]] for own in known], dtype=float)
    if known:
        before, own = (Statement("predicted", *v.tolist()) for v in values.mean(axis=0))
        yield Characteristic("AP_p", "workspace, mean", robots.of_all(before, own))
        before, own, _ = _largest(known)
        if np.ptp(values[:, 1, 0]) < SAME * values[0, 1, 0]:
            own = not_stated(ONE_VALUE)
        yield Characteristic("AP_p", "workspace, largest", robots.of_all(before, own))


def _both(shift: Array, covariance: Array) -> tuple[Statement, Statement]:
    """Statements of the nominal and of the identified robot, shift (3,) [m], covariance (3, 3)."""
    return known_deviation(shift, covariance), unknown_error(covariance)


def _largest(stated: Sequence[tuple[Statement, ...]]) -> tuple[Statement, ...]:
    """The statement of each robot with the largest value, or where one has none that."""
    robots = zip(*stated, strict=True)
    return tuple(max(own, key=lambda s: np.inf if s.value is None else s.value) for own in robots)


def known_deviation(shift: Array, covariance: Array, remark: str = "") -> Statement:
    """The length of a deviation (3,) [m] of which the covariance (3, 3) [m^2] is known."""
    size = float(np.linalg.norm(shift))
    if not np.isfinite(covariance).all():
        return not_stated(OUTSIDE)
    along = shift / size if size > 0.0 else np.full(3, np.sqrt(1.0 / 3.0))
    variance = float(along @ covariance @ along)
    width = NORMAL * float(np.sqrt(variance))
    across = NORMAL * float(np.sqrt(max(0.0, np.trace(covariance) - variance)))
    high = float(np.hypot(size + width, across))
    return Statement("predicted", size, max(0.0, size - width), high, remark)


def unknown_error(covariance: Array, remark: str = "") -> Statement:
    """Root mean square and 95 % quantile of the length of an error of covariance (3, 3) [m^2]."""
    if not np.isfinite(covariance).all():
        return not_stated(OUTSIDE)
    shape, scale = _gamma(covariance)
    high = float(np.sqrt(scale * gammaincinv(shape, COVERAGE)))
    return Statement("predicted", float(np.sqrt(shape * scale)), 0.0, high, remark)


def length_moments(covariance: Array) -> tuple[float, float]:
    """[m] mean and standard deviation of the length of a normal error (Nakagami)."""
    shape, scale = _gamma(covariance)
    mean = float(np.sqrt(scale) * np.exp(gammaln(shape + 0.5) - gammaln(shape)))
    return mean, float(np.sqrt(max(0.0, shape * scale - mean**2)))


def _gamma(covariance: Array) -> tuple[float, float]:
    """Shape and scale [m^2] of the squared length of a normal error."""
    total, square = float(np.trace(covariance)), float((covariance * covariance).sum())
    return (0.5 * total**2 / square, 2.0 * square / total) if total > 0.0 else (1.0, 0.0)
