"""Findings in the residuals of still poses: outliers, unsettled poses, drift.

Outliers are recognised by the length of the whitened residual against its median. A pose read
before the robot stood still has its residual along the last move: the joint angles were not yet, or
no longer, those of the measurement. A drifting base shows as a score of the seat's motion in
proportion to time (White 1982, as in ballbar.ident.estimator.order_search).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ballbar.cell.arrays import Array
from ballbar.cell.poses import PoseGroup
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.priors import declared_sigma
from ballbar.ident.estimator.robust_fit import median_scale, whitened_lengths
from ballbar.ident.table_steps import Step

OUTLIER = 7.0  # of the median-based scale; measured robots leave 0 to 0.7 % beyond it
# Least scale of the whitened residuals: instruments' sigmas are declared up to twice too wide, and
# a row within seven halves of the declared noise is no outlier that matters.
WIDE = 0.5
UNSETTLED = 4.5  # the same of a residual along the last move
SHARE_OF_MOVE = 15.0  # score of a share of the last move; chance exceeds it in one of ten thousand
SCALE = 4.0  # deviations from which the scale of the measured values is named
# Least scale that is named: 1 mm at a reach of 1 m. Instruments and warm arms stay below 0.02 %; a
# wrong unit, compensation or variant of the robot lies above.
LEAST_SCALE = 1e-3
# Least effect of what is named, over the error of one measurement along an axis, noise and what the
# model leaves unexplained: what is smaller changes the stated uncertainty by less than an eighth.
LEAST_EFFECT = 0.5
ALONG = 0.95  # cosine between residual and last move from which it lies along it
# Scatter of the rows, OUTLIER times their median error, over the error of an outlier up to which it
# is compared with the others. By volume a wrong row fits one of them by chance in 1 of 400 cases
# (40 rows of an SO-101, 10 mm) to 1 of 200 000 (60 of a UR5e, 1.4 mm).
STRAY = 0.1
SCORE_BLOCKS = 100  # of time, of a robot that was followed: its neighbouring rows err together
DRIFT = 2.0  # times the score of drifting directions that chance exceeds in one of a thousand
CHANCE = 1e-3


@dataclass(frozen=True, eq=False)
class SeatDrift:
    """A seat that moves in proportion to time while it measures."""

    seat: str
    shift: float  # [m] of the targets, mean, from the first pose to the last
    turn: float  # [rad]
    score: float


@dataclass(frozen=True, eq=False)
class Findings:
    """Poses and seats that are not as they should be; poses by their place in the table."""

    outliers: NDArray[np.intp]
    unsettled: NDArray[np.intp]
    unfinished: float  # share of the last move by which all angles were read early; 0: not seen
    drifts: tuple[SeatDrift, ...]
    # outliers, another row, and whether they fit its joint angles or else have the same ones
    strays: tuple[tuple[int, int, bool], ...] = ()
    steps: tuple[Step, ...] = ()  # of the table that was given; the fit has two names for each


def lengths_of(fit: Fit) -> Array:
    """(N,) each pose's whitened residual over the median-based scale of all, at least WIDE."""
    lengths = whitened_lengths(fit.linear)[fit.still]
    return np.concatenate(lengths) / max(median_scale(lengths), WIDE)


def findings_of(fit: Fit) -> Findings:
    """Outliers, unsettled poses, unfinished moves and drifts of a fit."""
    lengths = lengths_of(fit)
    unsettled = _unsettled(fit, lengths)
    outliers = np.setdiff1d(np.flatnonzero(lengths > OUTLIER), unsettled)
    strays = _strays(fit, outliers)
    return Findings(outliers, unsettled, _unfinished(fit), _drifts(fit), strays)


def _strays(fit: Fit, outliers: NDArray[np.intp]) -> tuple[tuple[int, int, bool], ...]:
    """Outliers and the row whose joint angles they fit instead, or else whose angles they have.

    They fit by their measured positions, as well as the other rows fit their own. Outliers that lie
    nearer than ten times that are left alone: glitches of an instrument, also of repeated poses.
    """
    out, first = list[tuple[int, int, bool]](), 0
    for point in fit.linear.evaluations[fit.still]:
        n, closure, q = point.still.size, point.target_closure, point.still.q
        own = outliers[(outliers >= first) & (outliers < first + n)] - first
        if point.still.kind.directions == 3 and point.still.motion is None and own.size:
            measured, predicted = closure.sight.point, closure.robot.tip
            alone = np.linalg.norm(measured - predicted, axis=0)
            usual = OUTLIER * float(np.median(alone))
            for i in own[usual < STRAY * alone[own]].tolist():
                away = np.linalg.norm(measured[:, i, None] - predicted, axis=0)
                if away.min() < usual:
                    out.append((first + i, first + int(away.argmin()), True))
                elif (same := np.flatnonzero((q == q[i]).all(axis=1) & (np.arange(n) != i))).size:
                    out.append((first + i, first + int(same[0]), False))
        first += n
    return tuple(out)


def _unsettled(fit: Fit, lengths: Array) -> NDArray[np.intp]:
    """Poses whose residual lies along the last move, more than one of them and in one direction."""
    candidates, signs, first = list[int](), list[float](), 0
    points, whitenings = fit.linear.evaluations[fit.still], fit.linear.weights[fit.still]
    for point, weights, move in zip(points, whitenings, _last_moves(fit), strict=True):
        n = point.still.size
        residual = weights(point.closure.error)
        if len(residual) >= 3 and n > 1:
            along = weights(move)
            size = np.linalg.norm(along, axis=0) * np.linalg.norm(residual, axis=0)
            cosine = (along * residual).sum(axis=0) / np.maximum(size, np.finfo(float).tiny)
            far = lengths[first : first + n] > UNSETTLED
            for i in np.flatnonzero(far & (np.abs(cosine) > ALONG)):
                candidates.append(first + int(i))
                signs.append(float(np.sign(cosine[i])))
        first += n
    if len(candidates) < 2:
        return np.zeros(0, dtype=np.intp)
    direction = np.sign(sum(signs))
    aligned = [i for i, s in zip(candidates, signs, strict=True) if s == direction]
    return np.array(aligned if len(aligned) > 0.7 * len(candidates) else [], dtype=np.intp)


def _last_moves(fit: Fit) -> list[Array]:
    """(6, N) of every group: change of the error for the whole last move of the robot."""
    points = fit.linear.evaluations[fit.still]
    moves = last_moves([point.still for point in points])
    return [
        np.asarray(np.einsum("jcn,nj->cn", point.target_closure.joint_columns, moved))
        for point, moved in zip(points, moves, strict=True)
    ]


def last_moves(groups: Sequence[PoseGroup]) -> list[Array]:
    """(N, J) [rad] of every group: how far the robot moved since it last stood elsewhere.

    Several targets at one pose, rows with the same angles, have the same move. Zero where the row
    before is missing, and of a robot that was followed: what it lags is its clock's.
    """
    moves = [np.zeros_like(group.q) for group in groups]
    for file in dict.fromkeys(group.file for group in groups if group.motion is None):
        rows = sorted(
            (int(row), k, i)
            for k, group in enumerate(groups)
            if group.file == file
            for i, row in enumerate(group.rows)
        )
        for (before, k, i), (row, own, at) in pairwise(rows):
            if row - before > 1:
                continue
            moved = groups[own].q[at] - groups[k].q[i]
            moves[own][at] = moved if moved.any() else moves[k][i]
    return moves


def _unfinished(fit: Fit) -> float:
    """Share of the last move by which all angles were read early; 0 where chance explains it.

    A score test of one unknown that turns every pose by that share, as the orders are tested.
    """
    moves, linear = _last_moves(fit), fit.linear
    weighted = zip(moves, linear.weights[fit.still], linear.robust[fit.still], strict=True)
    columns = [(weights(move) * robust)[None] for move, weights, robust in weighted]
    score, variance, information = _score(fit, range(len(columns)), columns)
    if variance[0, 0] == 0.0 or score[0] ** 2 <= SHARE_OF_MOVE * variance[0, 0]:
        return 0.0
    share = -float(score[0] / information[0, 0])
    moved = np.concatenate([move[:3] for move in moves], axis=1)
    effect = abs(share) * float(np.sqrt((moved**2).mean()))
    return share if effect > LEAST_EFFECT * _error_of_one(fit) else 0.0


def _score(fit: Fit, groups: Sequence[int], columns: Sequence[Array]) -> tuple[Array, Array, Array]:
    """Score (K,) of K more unknowns, its variance (K, K), and their information (K, K).

    The variance is by poses, or by blocks of rows where the robot moved.


    columns : (K, E, N) whitened, of the groups that they move. The unknowns of the fit are
    eliminated.
    """
    count, size = fit.model.unknowns.count, len(columns[0])
    residuals = fit.linear.residuals[fit.still]
    gram = np.zeros((count, size))
    for k, column in zip(groups, columns, strict=True):
        gram += fit.jacobians[k].reshape(count, -1) @ column.reshape(size, -1).T
    solved = np.linalg.solve(fit.linear.normal, gram)
    score, variance, information = np.zeros(size), np.zeros((size, size)), np.zeros((size, size))
    for k, column in zip(groups, columns, strict=True):
        rest = column - np.einsum("pen,pk->ken", fit.jacobians[k], solved)
        each = (rest * residuals[k]).sum(axis=1)
        if fit.linear.evaluations[fit.still][k].still.motion is not None:
            starts = np.arange(0, each.shape[1], -(-each.shape[1] // SCORE_BLOCKS))
            each = np.add.reduceat(each, starts, axis=1)
        score += each.sum(axis=1)
        variance += each @ each.T
        information += rest.reshape(size, -1) @ rest.reshape(size, -1).T
    return score, variance, information


def _error_of_one(fit: Fit) -> float:
    """[m] error of one measurement along an axis: declared noise and what is unexplained."""
    noise = np.concatenate(
        [p.position_sigma.reshape(-1) for p in fit.linear.evaluations[fit.still]]
    )
    return float(np.hypot(fit.excess.position, np.median(noise)))


def scale_of(fit: Fit) -> tuple[float, float] | None:
    """Scale of all measured values against the catalogue's lengths, and its standard deviation.

    The robot's parameters take up a scale at the cost of their priors alone, so it is the priors as
    declared that tell it. The direction is that of the predicted point: along the measured one its
    own error would pass for scale. None where chance explains it, or where it is too small to
    matter.
    """
    equations, layout = fit.linear, fit.model.unknowns
    prior = np.diag(declared_sigma(layout) ** -2.0 - layout.sigma**-2.0)
    normal = equations.normal + prior
    gradient = equations.gradient + prior @ (equations.x - layout.mean)
    cross, own, slope = np.zeros(layout.count), 0.0, 0.0
    for point, weights, robust, jacobian, residual in zip(
        equations.evaluations,
        equations.weights,
        equations.robust,
        fit.jacobians,
        equations.residuals,
        strict=True,
    ):
        if not point.still.kind.scales or point.still.common is not None:
            continue  # a size that is an unknown of the fit takes it up
        moved = np.zeros((6, point.still.size))
        predicted = point.target_closure.sight.point - point.closure.error[:3]
        moved[:3] = predicted - point.target_closure.seat.origin[:, None]
        column = weights(moved) * robust
        cross += jacobian.reshape(layout.count, -1) @ column.reshape(-1)
        own += float((column * column).sum())
        slope += float((column * residual).sum())
    solved = np.linalg.solve(normal, np.column_stack((cross, gradient)))
    information = own - float(cross @ solved[:, 0])
    if own == 0.0 or information <= 0.0:
        return None
    size = -(slope - float(cross @ solved[:, 1])) / information
    deviation = 1.0 / np.sqrt(information)
    return (-size, deviation) if abs(size) > max(SCALE * deviation, LEAST_SCALE) else None


def _drifts(fit: Fit) -> tuple[SeatDrift, ...]:
    """Seats that move in proportion to time, where times are given."""
    seats = {g.seat for g in fit.model.poses.groups if g.time is not None}
    drifts = (_drift(fit, seat) for seat in fit.model.unknowns.seats if seat in seats)
    return tuple(drift for drift in drifts if drift is not None)


def _drift(fit: Fit, seat: str) -> SeatDrift | None:
    """The drift of a seat if the score of its shifts, and of its turns where they are seen, is
    beyond chance, and the drift large enough to matter.
    """
    part, points = fit.model.unknowns.seats[seat], fit.linear.evaluations[fit.still]
    size = part.stop - part.start
    own = [k for k, p in enumerate(points) if p.still.seat == seat and p.still.time is not None]
    times = [np.asarray(points[k].still.time) for k in own]
    first, span = min(t.min() for t in times), float(np.ptp(np.concatenate(times)))
    if span <= 0.0:
        return None
    columns = [
        fit.jacobians[k][part] * ((t - first) / span) for k, t in zip(own, times, strict=True)
    ]
    score, variance, information = _score(fit, own, columns)
    test = float(score @ np.linalg.lstsq(variance, score, rcond=1e-10)[0])
    if test <= DRIFT * float(chdtri(size, CHANCE)):  # chi-square, upper tail
        return None
    change = np.zeros(6)
    change[:size] = -np.linalg.lstsq(information, score, rcond=1e-10)[0]
    closures = [points[k].target_closure for k in own]
    arm = np.concatenate([c.sight.point.T - c.seat.origin for c in closures])
    moved = float(np.linalg.norm(change[:3] + np.cross(change[3:], arm), axis=1).mean())
    if moved <= np.sqrt(3.0) * LEAST_EFFECT * _error_of_one(fit):
        return None
    return SeatDrift(seat, moved, float(np.linalg.norm(change[3:])), test)
