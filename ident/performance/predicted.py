"""Characteristics that an identified robot predicts at the test poses, along a path and over the
workspace.

Of the nominal robot, pose accuracy is the distance between where the identified robot puts its tool
and where the nominal one would, base frames aligned over the workspace; its interval follows from
the covariance of the result. The identified robot's own error is unknown: its root mean square and
its 95 % quantile are those of the stated covariance C. With `tr(C)` and `tr(C C)` the squared
length of a normal error is taken as a gamma variable of the same mean and variance (Satterthwaite
1946). The corrected robot has the errors of the identified one at the targets that reach the
nominal poses. Errors of the servo are in none of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import gammaincinv, gammaln

from ballbar.cell.arrays import Array
from ballbar.cell.chain import joint_screws
from ballbar.cell.errors import InputError
from ballbar.cell.rigid_fit import kabsch
from ballbar.cell.rotation import rotvec_from_matrix
from ballbar.ident.performance.characteristics import Listing, Statement, not_stated
from ballbar.ident.performance.cube import TestCube
from ballbar.ident.performance.iso_9283 import COVERAGE
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.identified_kinematics import IdentifiedKinematics
from ballbar.ident.robot.inverse_calibration import CorrectedTargets, TargetError

PATH = 21  # points of the straight path from P2 to P4
NORMAL = 1.959964  # standard deviations of a normal value that hold 95 %
LEAST = 1e-7  # [rad] random error of an axis below which a fit says nothing of it
OUTSIDE = "outside the range of axes that was fitted, where nothing is known"
REPEATED = (
    ("vAP_p", "measure repetitions that approach a pose from three others"),
    ("dAP_p", "measure repetitions with their times, over hours"),
    ("dRP_l", "measure repetitions with their times, over hours"),
)
EXTRAPOLATED = "outside the range of axes that was fitted: by the model alone"


@dataclass(frozen=True)
class RandomErrors:
    """Standard deviations [rad] of what the axes repeat with, and where they are from."""

    main: float = 0.0  # of axes 1 to 3
    wrist: float = 0.0

    @property
    def known(self) -> bool:
        """Whether the fit saw any."""
        return max(self.main, self.wrist) > LEAST


@dataclass(frozen=True, eq=False)
class Prediction:
    """An identified robot beside its nominal one."""

    nominal: IdentifiedKinematics
    identified: IdentifiedKinematics
    random: RandomErrors = RandomErrors()

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

    def spread(self, q: Array) -> Array:
        """(N, 3, 3) [m^2] of the tool by random errors of the axes."""
        joints = self.robot.robot.joints
        sigma = np.where(np.arange(joints) < 3, self.random.main, self.random.wrist)
        screws = joint_screws(self.robot.frames(q))[:joints, :3]
        return np.einsum("jcn,jdn,j->ncd", screws, screws, sigma**2)

    def corrected(self, q: Array) -> CorrectedTargets | str:
        """The targets that reach the nominal poses at q (N, J) [rad], or why there are none."""
        try:
            return self.identified.corrected(q)
        except (InputError, TargetError) as error:
            return f"these targets cannot be corrected: {error}"


def predict(prediction: Prediction, cube: TestCube | None) -> Listing:
    """Rows of the five poses, of the distance and the straight path from P2 to P4, and of the
    workspace.
    """
    listing = Listing()
    if cube is not None:
        q = cube.q
        corrected = prediction.corrected(q)
        for k in range(len(q)):
            _add_pose(listing, prediction, q[[k]], f"P{k + 1}", _part(corrected, k))
        _add_distance(listing, prediction, q[[1, 3]])
        _add_path(listing, prediction, cube)
        _add_repeatability(listing, prediction, q)
    _add_workspace(listing, prediction)
    for symbol, why in REPEATED:
        listing.add(symbol, "test poses", (not_stated(why),) * 3)
    return listing


def _part(corrected: CorrectedTargets | str, k: int) -> tuple[Array, float] | str:
    """Target (1, J) [rad] and what it leaves [m] of one pose, or why there is none."""
    if isinstance(corrected, str):
        return corrected
    return corrected.q[[k]], float(corrected.position_after[k])


def _add_pose(
    listing: Listing,
    prediction: Prediction,
    q: Array,
    place: str,
    corrected: tuple[Array, float] | str,
) -> None:
    """AP of one pose."""
    (shift,), (turn,) = prediction.bias(q)
    remark = "" if prediction.robot.covered(q).all() else EXTRAPOLATED
    own = _with_remark(unknown_error(prediction.covariance(q)[0]), remark)
    after = not_stated(corrected) if isinstance(corrected, str) else own
    if not isinstance(corrected, str):
        left = corrected[1] ** 2 / 3.0 * np.eye(3)
        after = _with_remark(unknown_error(prediction.covariance(corrected[0])[0] + left), remark)
    before = _with_remark(known_deviation(shift, prediction.covariance(q)[0]), remark)
    listing.add("AP_p", place, (before, own, after))
    for symbol, angle in zip(("AP_a", "AP_b", "AP_c"), turn, strict=True):
        why = "the result states no uncertainty of orientations"
        stated = Statement("predicted", float(angle), reason=why)
        listing.add(symbol, place, (stated, not_stated(why), not_stated(why)))


def _add_repeatability(listing: Listing, prediction: Prediction, q: Array) -> None:
    """Repeatabilities, of which nothing is predicted but what random errors of the axes make."""
    why = more = "how the servo stops is not known: measure repetitions"
    if prediction.random.known:
        moments = map(length_moments, prediction.spread(q))
        size = max(mean + 3.0 * deviation for mean, deviation in moments) * 1e3
        more += f"; random errors of the axes that the fit left over make {size:.2g} mm of it"
    listing.add("RP_l", "test poses", (not_stated(more),) * 3)
    listing.add("RD", "P2-P4", (not_stated(why),) * 3)
    listing.add("RT_p", "P2-P4", (not_stated(why),) * 3)


def _add_distance(listing: Listing, prediction: Prediction, q: Array) -> None:
    """AD between two poses q (2, J) [rad].

    Errors at the two poses are correlated to a degree that the result does not state; the deviation
    of their difference is at most the sum of their deviations.
    """
    shift, _ = prediction.bias(q)
    commanded = prediction.nominal.forward(q)[:, :3, 3]
    along = np.diff(commanded, axis=0)[0]
    along /= np.linalg.norm(along)
    attained = float(np.linalg.norm(np.diff(commanded + shift, axis=0)))
    off = attained - float(np.linalg.norm(np.diff(commanded, axis=0)))
    sigma = float(np.sqrt(np.einsum("c,ncd,d->n", along, prediction.covariance(q), along)).sum())
    width = NORMAL * sigma
    own = Statement("predicted", 0.0, -width, width, "an interval about no expected error")
    if not np.isfinite(sigma):
        own = not_stated(OUTSIDE)
    stated = Statement("predicted", off, off - width, off + width) if np.isfinite(sigma) else own
    listing.add("AD_p", "P2-P4", (stated, own, own))


def _add_path(listing: Listing, prediction: Prediction, cube: TestCube) -> None:
    """AT along the straight path from P2 to P4, of the geometry alone."""
    poses = np.tile(cube.poses[1], (PATH, 1, 1))
    share = np.linspace(0.0, 1.0, PATH)[:, None]
    begin, end = cube.poses[[1, 3], :3, 3]
    poses[:, :3, 3] = begin + share * (end - begin)
    solved = prediction.nominal.nearest(poses, cube.q[0])
    if not (solved.reached & solved.within).all():
        no_path = not_stated("the robot does not take the straight path from P2 to P4")
        listing.add("AT_p", "P2-P4", (no_path,) * 3)
        return
    along = (end - begin) / np.linalg.norm(end - begin)
    across = np.eye(3) - np.outer(along, along)
    shift, _ = prediction.bias(solved.q)
    with np.errstate(invalid="ignore"):  # infinite where nothing is known
        covariance = across @ prediction.covariance(solved.q) @ across
    away = shift @ across
    worst = int(np.linalg.norm(away, axis=1).argmax())
    own = max((unknown_error(c) for c in covariance), key=lambda s: s.value or 0.0)
    stated = known_deviation(away[worst], covariance[worst])
    listing.add("AT_p", "P2-P4", (stated, own, own))


def _add_workspace(listing: Listing, prediction: Prediction) -> None:
    """AP over the workspace: its mean and its largest value."""
    shift, _ = prediction.bias(prediction.grid)
    covariance = prediction.covariance(prediction.grid)
    before = [known_deviation(b, c) for b, c in zip(shift, covariance, strict=True)]
    after = [unknown_error(c) for c in covariance]
    for place, chosen in (("workspace, mean", _mean), ("workspace, largest", _largest)):
        own = chosen(after)
        listing.add("AP_p", place, (chosen(before), own, own))


def _mean(statements: list[Statement]) -> Statement:
    """The mean over poses, its interval that of errors which are the same at all of them."""
    values = np.array([[s.value, s.low, s.high] for s in statements], dtype=float)
    return Statement("predicted", *np.nanmean(values, axis=0).tolist())


def _largest(statements: list[Statement]) -> Statement:
    """The statement of the pose with the largest value."""
    return max(statements, key=lambda s: s.value or 0.0)


def _with_remark(statement: Statement, remark: str) -> Statement:
    """A statement with what to mind; why none is stated stays."""
    return statement if statement.reason else replace(statement, reason=remark)


def known_deviation(shift: Array, covariance: Array) -> Statement:
    """The length of a deviation (3,) [m] of which the covariance (3, 3) [m^2] is known."""
    size = float(np.linalg.norm(shift))
    if not np.isfinite(covariance).all():
        return not_stated(OUTSIDE)
    along = shift / size if size > 0.0 else np.full(3, np.sqrt(1.0 / 3.0))
    across = max(0.0, float(np.trace(covariance) - along @ covariance @ along))
    width = NORMAL * float(np.sqrt(along @ covariance @ along))
    high = float(np.hypot(size + width, NORMAL * np.sqrt(across)))
    return Statement("predicted", size, max(0.0, size - width), high)


def unknown_error(covariance: Array) -> Statement:
    """Root mean square and 95 % quantile of the length of an error of covariance (3, 3) [m^2]."""
    if not np.isfinite(covariance).all():
        return not_stated(OUTSIDE)
    total = float(np.trace(covariance))
    return Statement("predicted", float(np.sqrt(total)), 0.0, length_quantile(covariance))


def length_quantile(covariance: Array) -> float:
    """[m] length that a normal error of covariance (3, 3) [m^2] does not exceed in 95 %."""
    shape, scale = _gamma(covariance)
    return float(np.sqrt(scale * gammaincinv(shape, COVERAGE)))


def length_moments(covariance: Array) -> tuple[float, float]:
    """[m] mean and standard deviation of the length of a normal error (Nakagami)."""
    shape, scale = _gamma(covariance)
    mean = float(np.sqrt(scale) * np.exp(gammaln(shape + 0.5) - gammaln(shape)))
    return mean, float(np.sqrt(max(0.0, shape * scale - mean**2)))


def _gamma(covariance: Array) -> tuple[float, float]:
    """Shape and scale [m^2] of the squared length of a normal error."""
    total, square = float(np.trace(covariance)), float((covariance * covariance).sum())
    if total <= 0.0:
        return 1.0, 0.0
    return 0.5 * total**2 / square, 2.0 * square / total
