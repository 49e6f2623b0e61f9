"""What the residuals of still poses show beside the model: outliers, unsettled poses, drift.

Outliers are recognised by the length of the whitened residual against its median. A pose read
before the robot stood still has its residual along the last move: the joint angles were not yet, or
no longer, those of the measurement. A drifting base shows as a score of the seat's motion in proportion to
time (White 1982, as in ident.estimator.order_search).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from ident.poses.fit import PoseFit, median_scale, whitened_lengths

OUTLIER = 7.0  # of the median-based scale; measured robots leave 0 to 0.7 % beyond it
UNSETTLED = 4.5  # likewise, of a residual along the last move
ALONG = 0.95  # cosine between residual and last move from which it lies along it
DRIFT = 45.0  # score of six drifting directions; chance exceeds 23 in one of a thousand


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
    return Findings(outliers, unsettled, _drifts(fit))


def _unsettled(fit: PoseFit, lengths: Array) -> NDArray[np.intp]:
    """Poses whose residual lies along the last move, more than one of them and in one direction."""
    candidates: list[int] = []
    signs: list[float] = []
    first = 0
    for point, weights in zip(fit.equations.points, fit.equations.weights, strict=True):
        n = point.group.size
        residual = weights(point.closure.error)
        if len(residual) >= 3 and n > 1:
            moved = np.vstack((np.zeros(point.group.q.shape[1]), np.diff(point.group.q, axis=0)))
            along = weights(np.einsum("jcn,nj->cn", point.joint_columns, moved))
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


def _drifts(fit: PoseFit) -> tuple[Drift, ...]:
    """Seats that move in proportion to time, where times are given."""
    equations, layout = fit.equations, fit.model.unknowns
    out = []
    for seat, part in layout.seats.items():
        own = [
            k
            for k, point in enumerate(equations.points)
            if point.group.seat == seat and point.group.time is not None
        ]
        if not own or part.stop - part.start < 6:
            continue
        time = np.concatenate([np.asarray(equations.points[k].group.time) for k in own])
        span = float(np.ptp(time))
        if span <= 0.0:
            continue
        gram = np.zeros((layout.count, 6))
        blocks = []
        for k in own:
            clock = (np.asarray(equations.points[k].group.time) - time.min()) / span
            column = equations.jacobians[k][part] * clock
            flat = equations.jacobians[k].reshape(layout.count, -1)
            gram += flat @ column.reshape(6, -1).T
            blocks.append(column)
        solved = np.linalg.solve(equations.normal, gram)
        score, variance, information = np.zeros(6), np.zeros((6, 6)), np.zeros((6, 6))
        for k, column in zip(own, blocks, strict=True):
            rest = column - np.einsum("pen,pk->ken", equations.jacobians[k], solved)
            each = (rest * equations.residuals[k]).sum(axis=1)
            score += each.sum(axis=1)
            variance += each @ each.T
            information += rest.reshape(6, -1) @ rest.reshape(6, -1).T
        test = float(score @ np.linalg.lstsq(variance, score, rcond=1e-10)[0])
        if test > DRIFT:
            size = -np.linalg.lstsq(information, score, rcond=1e-10)[0]
            arm = np.concatenate(
                [
                    (equations.points[k].closure.measured.T - equations.points[k].seat.origin)
                    for k in own
                ]
            )
            moved = np.linalg.norm(size[:3] + np.cross(size[3:], arm), axis=1)
            out.append(Drift(seat, float(moved.mean()), float(np.linalg.norm(size[3:])), test))
    return tuple(out)
