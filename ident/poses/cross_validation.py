"""How far the robot is from the model where it was not fitted: contiguous regions left out.

The declared sigma of the instrument and the covariance of the parameters alone would hold a third
of the poses they claim: what the model leaves unexplained dominates on every measured robot. It is
found by refitting the linearised model without each of eight regions of joint space (Gram matrix
less that of the region). The variance of those residuals beyond that of the parameters is added to
each stated region, and the region's size is the 95 % quantile of the residuals' own Mahalanobis
distances instead of that of chi-square (docs/real_robots, regions).

Lengths judge the model along the rod alone. What is unexplained there is an error of the joints in
the main, and across the rod it may be larger; the fit hides a part of it besides, for it has
nothing to gain across the rod. Where nothing but lengths were measured, a joint error of the size
that explains the residuals along the rod is therefore added to the regions of points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.statistics import chi_square_quantile
from ident.estimator.regions import pose_regions
from ident.estimator.uncertainty import inflation_factors
from ident.estimator.whitening import Whitening
from ident.poses.fit import PoseFit
from ident.poses.model import GroupPoint

LEVEL = 0.95
# Share of the variance of joint errors that is seen along the rods, by the number of seats (three
# and more alike). Measured on the UR10's table with its points turned into lengths, and on drawn
# robots (tests/ident/poses/test_length_regions.py).
SEEN = {1: 1.0 / 16.0, 2: 1.0 / 8.0, 3: 1.0 / 4.0}
BLOCKS = 32  # regions whose poses share what the model leaves over


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Errors of poses in regions that were not fitted."""

    error: Array  # (N,) [m] of the target's position; along the rod where lengths were measured
    counting: NDArray[np.bool_]  # (N,) all but the poses that the fit left out as far off
    sigma: float  # [m] discrepancy along each axis, the instrument's noise included
    factor: float  # squared Mahalanobis distance that holds LEVEL, over that of chi-square
    joint_sigma: float  # [rad] of each joint, across rods; 0 where more than lengths was measured

    @property
    def mean(self) -> float:
        """[m]"""
        return float(self.error[self.counting].mean())

    @property
    def quantile(self) -> float:
        """[m] below which LEVEL of the errors lie."""
        return float(np.quantile(self.error[self.counting], LEVEL))


def cross_validated(fit: PoseFit) -> CrossValidation:
    """Errors of every pose with its region left out of the fit."""
    equations, model, count = fit.equations, fit.model, fit.model.unknowns.count
    regions = np.split(
        pose_regions(model.table.q), np.cumsum([g.size for g in model.table.groups])[:-1]
    )
    rows = [position_rows(point) for point in equations.points]
    moves = [
        model.jacobian(equations.x, point, row)
        for point, row in zip(equations.points, rows, strict=True)
    ]
    rests = [row(point.closure.error) for point, row in zip(equations.points, rows, strict=True)]
    for fold in range(1 + max(int(region.max()) for region in regions)):
        normal, gradient = equations.normal.copy(), equations.gradient.copy()
        for jacobian, residual, region in zip(
            equations.jacobians, equations.residuals, regions, strict=True
        ):
            own = jacobian[:, :, region == fold].reshape(count, -1)
            normal -= own @ own.T
            gradient -= own @ residual[:, region == fold].reshape(-1)
        step = -np.linalg.solve(normal, gradient)
        for rest, move, region in zip(rests, moves, regions, strict=True):
            held = region == fold
            rest[:, held] += np.einsum("pen,p->en", move[:, :, held], step)
    spreads = [spread_of(move, fit.covariance) for move in moves]
    weighted = [robust > 0.0 for robust in equations.robust]
    judged = list(zip(rests, spreads, weighted, strict=True))
    count = sum(rest[:, k].size for rest, _, k in judged)
    known = sum(float(np.trace(s[k], axis1=1, axis2=2).sum()) for _, s, k in judged)
    square = sum(float((rest[:, k] ** 2).sum()) for rest, _, k in judged)
    declared = min(float(g.sigma[:, :3].min()) for g in model.table.groups)
    variance = max((square - known) / count, declared**2, np.finfo(float).tiny)
    ratios = [
        mahalanobis(rest[:, k], spread[k], variance) / chi_square_quantile(LEVEL, len(rest))
        for rest, spread, k in judged
    ]
    return CrossValidation(
        error=np.concatenate([np.linalg.norm(rest, axis=0) for rest in rests]),
        counting=np.concatenate(weighted),
        sigma=float(np.sqrt(variance)),
        factor=float(np.quantile(np.concatenate(ratios), LEVEL)),
        joint_sigma=_joint_sigma(fit, variance),
    )


def _joint_sigma(fit: PoseFit, variance: float) -> float:
    """[rad] joint errors that explain a variance [m^2] along the rods; 0 where others judge too.

    Noise as declared, and what two deviations of an estimated variance allow, are not counted.
    """
    points = fit.equations.points
    if any(point.group.measured != "length" for point in points):
        return 0.0
    along = [position_rows(point)(point.joint_columns)[:, 0] for point in points]
    lever = float((np.concatenate(along, axis=1) ** 2).sum(axis=0).mean())  # [m^2]
    chance = 2.0 * np.sqrt(2.0 / fit.model.table.size)
    noise = (1.0 + chance) * float((np.concatenate([p.group.sigma for p in points]) ** 2).mean())
    seen = SEEN[min(len(fit.model.unknowns.seats), max(SEEN))]
    return float(np.sqrt(max(variance - noise, 0.0) / (seen * lever)))


def robust_covariance(fit: PoseFit) -> Array:
    """(P, P) covariance of the unknowns where neighbouring poses share what the model leaves over.

    Sums of the scores over blocks (sandwich form: White 1982), which are regions of joint space.
    """
    equations, layout = fit.equations, fit.model.unknowns
    blocks = pose_regions(fit.model.table.q, BLOCKS)
    scores = np.concatenate(
        [
            np.einsum("pen,en->pn", jacobian, residual)
            for jacobian, residual in zip(equations.jacobians, equations.residuals, strict=True)
        ],
        axis=1,
    )
    sums = np.zeros((layout.count, blocks.max() + 1))
    np.add.at(sums.T, blocks, scores.T)
    inflation = inflation_factors(fit.covariance, scores @ scores.T, sums)
    prior = fit.covariance @ (fit.covariance / layout.sigma[:, None] ** 2)
    robust = (fit.covariance - prior) * np.outer(inflation, inflation) + prior
    return np.asarray(0.5 * (robust + robust.T))


def position_rows(point: GroupPoint) -> Whitening:
    """Rows that take the position out of a loop-closure error [m]; along the rod of lengths."""
    n = point.group.size
    if point.group.measured == "length":
        rod = point.closure.measured - point.seat.origin[:, None]
        matrix = np.zeros((1, 6, n))
        matrix[0, :3] = rod / np.linalg.norm(rod, axis=0)
    else:
        matrix = np.repeat(np.eye(6)[:3, :, None], n, axis=2)
    none = np.zeros((0, 6, n))
    return Whitening(matrix, none, np.zeros((0, 0, n)), np.zeros((0, n), dtype=bool))


def spread_of(moves: Array, covariance: Array) -> Array:
    """(N, E, E) [m^2] covariance of positions. moves : (P, E, N) per unit of each unknown."""
    p, e, n = moves.shape
    half = (covariance @ moves.reshape(p, -1)).reshape(p, e, n)
    return np.asarray(np.einsum("pen,pfn->nef", half, moves))


def mahalanobis(rest: Array, spread: Array, variance: float) -> Array:
    """(N,) squared Mahalanobis distance of errors (E, N) [m], spread (N, E, E) plus variance."""
    whole = spread + variance * np.eye(len(rest))
    return np.asarray(
        np.einsum("en,ne->n", rest, np.linalg.solve(whole, rest.T[..., None])[..., 0])
    )
