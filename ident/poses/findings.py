"""What the residuals of still poses show beside the model: outliers, unsettled poses, drift.

Outliers are recognised by the length of the whitened residual against its median. A pose read
before the robot stood still has its residual along the last move: the joint angles were not yet, or
no longer, those of the measurement. A drifting base shows as a score of the seat's motion in
proportion to time (White 1982, as in ident.estimator.order_search).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from cell.arrays import Array
from ident.poses.fit import PoseFit, median_scale, whitened_lengths
from ident.poses.model import GroupPoint

OUTLIER = 7.0  # of the median-based scale; measured robots leave 0 to 0.7 % beyond it
UNSETTLED = 4.5  # likewise, of a residual along the last move
SHARE_OF_MOVE = 30.0  # score of a share of the last move; chance exceeds 11 in one of a thousand
ALONG = 0.95  # cosine between residual and last move from which it lies along it
DRIFT = 2.0  # times the score of drifting directions that chance exceeds in one of a thousand
CHANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Drift:
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
    drifts: tuple[Drift, ...]


def lengths_of(fit: PoseFit) -> Array:
    """(N,) each pose's whitened residual over the median-based scale of all."""
    lengths = whitened_lengths(fit.equations)
    return np.concatenate(lengths) / max(median_scale(lengths), np.finfo(float).tiny)


def findings_of(fit: PoseFit) -> Findings:
    """What a fit shows of its poses."""
    lengths = lengths_of(fit)
    unsettled = _unsettled(fit, lengths)
    outliers = np.setdiff1d(np.flatnonzero(lengths > OUTLIER), unsettled)
    return Findings(outliers, unsettled, _unfinished(fit), _drifts(fit))


def _unsettled(fit: PoseFit, lengths: Array) -> NDArray[np.intp]:
    """Poses whose residual lies along the last move, more than one of them and in one direction."""
    candidates: list[int] = []
    signs: list[float] = []
    first = 0
    for point, weights in zip(fit.equations.points, fit.equations.weights, strict=True):
        n = point.group.size
        residual = weights(point.closure.error)
        if len(residual) >= 3 and n > 1:
            along = weights(_last_move(point))
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


def _last_move(point: GroupPoint) -> Array:
    """(6, N) change of the error for the whole last move; zero where the row before is missing."""
    moved = np.zeros_like(point.group.q)
    follows = np.flatnonzero(np.diff(point.group.rows) == 1) + 1
    moved[follows] = point.group.q[follows] - point.group.q[follows - 1]
    return np.asarray(np.einsum("jcn,nj->cn", point.joint_columns, moved))


def _unfinished(fit: PoseFit) -> float:
    """Share of the last move by which all angles were read early; 0 where chance explains it.

    A score test of one unknown that turns every pose by that share, as the orders are tested.
    """
    equations = fit.equations
    columns = [
        weights(_last_move(point)) * robust
        for point, weights, robust in zip(
            equations.points, equations.weights, equations.robust, strict=True
        )
    ]
    parts = list(zip(equations.jacobians, equations.residuals, columns, strict=True))
    gram = sum(
        jacobian.reshape(len(jacobian), -1) @ column.reshape(-1) for jacobian, _, column in parts
    )
    solved = np.linalg.solve(equations.normal, gram)
    score = variance = information = 0.0
    for jacobian, residual, column in parts:
        rest = column - np.einsum("pen,p->en", jacobian, solved)
        each = (rest * residual).sum(axis=0)
        score += float(each.sum())
        variance += float((each * each).sum())
        information += float((rest * rest).sum())
    if variance == 0.0 or score * score <= SHARE_OF_MOVE * variance:
        return 0.0
    return -score / information


def _drifts(fit: PoseFit) -> tuple[Drift, ...]:
    """Seats that move in proportion to time, where times are given."""
    seats = {g.seat for g in fit.model.table.groups if g.time is not None}
    drifts = (_drift(fit, seat) for seat in fit.model.unknowns.seats if seat in seats)
    return tuple(drift for drift in drifts if drift is not None)


def _drift(fit: PoseFit, seat: str) -> Drift | None:
    """What a seat drifts, if the score of its shifts, and of its turns where they are seen, is
    beyond chance.
    """
    equations, layout = fit.equations, fit.model.unknowns
    part = layout.seats[seat]
    size = part.stop - part.start
    every = zip(equations.points, equations.jacobians, equations.residuals, strict=True)
    own = [each for each in every if each[0].group.seat == seat and each[0].group.time is not None]
    times = [np.asarray(point.group.time) for point, _, _ in own]
    first, span = min(t.min() for t in times), float(np.ptp(np.concatenate(times)))
    if span <= 0.0:
        return None
    columns = [each[1][part] * ((t - first) / span) for each, t in zip(own, times, strict=True)]
    gram = np.zeros((layout.count, size))
    for (_, jacobian, _), column in zip(own, columns, strict=True):
        gram += jacobian.reshape(layout.count, -1) @ column.reshape(size, -1).T
    solved = np.linalg.solve(equations.normal, gram)
    score, variance, information = np.zeros(size), np.zeros((size, size)), np.zeros((size, size))
    for (_, jacobian, residual), column in zip(own, columns, strict=True):
        rest = column - np.einsum("pen,pk->ken", jacobian, solved)
        each = (rest * residual).sum(axis=1)
        score += each.sum(axis=1)
        variance += each @ each.T
        information += rest.reshape(size, -1) @ rest.reshape(size, -1).T
    test = float(score @ np.linalg.lstsq(variance, score, rcond=1e-10)[0])
    if test <= DRIFT * float(chi2.isf(CHANCE, size)):
        return None
    change = np.zeros(6)
    change[:size] = -np.linalg.lstsq(information, score, rcond=1e-10)[0]
    arm = np.concatenate([p.closure.measured.T - p.seat.origin for p, _, _ in own])
    moved = np.linalg.norm(change[:3] + np.cross(change[3:], arm), axis=1)
    return Drift(seat, float(moved.mean()), float(np.linalg.norm(change[3:])), test)
