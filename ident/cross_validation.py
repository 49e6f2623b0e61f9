"""How far the robot is from the model where it was not fitted: contiguous regions left out.

The declared sigma of the instrument and the covariance of the parameters alone would hold a third
of the poses they claim: what the model leaves unexplained dominates on every measured robot. It is
found by refitting the linearised model without each of eight regions of joint space (Gram matrix
less that of the region). Where the instrument stood at several places, each place is left out as
well, and the worse of the two is stated: a robot that was fitted where one socket stands is not yet
known elsewhere. The variance of those residuals beyond that of the parameters is added to
each stated region, and the region's size is the 95 % quantile of the residuals' own Mahalanobis
distances instead of that of chi-square (docs/real_robots, regions).

Lengths judge the model along the rod alone. What is unexplained there is an error of the joints in
the main, and across the rod it may be larger; the fit hides a part of it besides, for it has
nothing to gain across the rod. Where nothing but lengths were measured, the regions of points are
therefore those of a joint error of the size that explains the residuals along the rod, in place of
the variance along the rod, which holds the noise of an instrument that measures no points.

Pictures tell the noise of their corners themselves. What they leave over beyond chance is judged by
the errors of a region together, for what is uncertain of the robot there is common to them; and a
factor below 1, which corrects a noise that was declared too large, is chance.

Of a robot that moved the rows are many, and their white noise is seen from one to the next: it is
no error of the robot, and what is stated of the tool is without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.poses import PoseTable
from ballbar.cell.statistics import chi_square_quantile, variance_beyond
from ballbar.cell.typical_machine import arm_length
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.gauss_newton import inverse
from ballbar.ident.estimator.model import Evaluation
from ballbar.ident.estimator.normal_equations import whole_jacobian
from ballbar.ident.estimator.regions import pose_regions
from ballbar.ident.estimator.whitening import Whitening
from ballbar.ident.signals.smooth_log import WIDEST_KNOT_SPACING

LEVEL = 0.95
# [m] mean error: industrial robots, identified, stay below 0.5 mm; play of the gears adds to it
STRANGE = 3e-3
# Share of the variance of joint errors that the rods of one, two, or three and more seats show
# beside what the fit takes up. Measured on the tables of a UR5 and a UR10 with their points turned
# into lengths, and on drawn robots (tests/ident/test_length_regions.py).
SEEN = {1: 0.2, 2: 0.6, 3: 0.8}
# Least factor of the regions of points where rods alone judge: joint errors differ from place to
# place, and the rods do not show by how much.
FACTOR_OF_RODS = 1.6
CHANCE = 2.0  # deviations of an estimated variance that are not counted
REGIONS, PLACES = "in regions of joint space", "at places"  # that were not fitted
SAME_PLACE = 0.15  # [m] between seats that see the robot from one place
CLOSE = 1.5  # periods between neighbouring rows, at most


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Errors of poses in regions of joint space, or at places, that were not fitted."""

    left_out: str  # what was left out in turn, of the two the one that is predicted worse
    error: Array  # (N,) [m] of the target's position; along the rod where lengths were measured
    counting: NDArray[np.bool_]  # (N,) all but the poses that the fit left out as far off
    sigma: float  # [m] discrepancy along each axis, the instrument's noise included
    # [m] part of it that is white noise of what followed a moving robot; 0 of still poses
    white: float
    factor: float  # squared Mahalanobis distance that holds LEVEL, over that of chi-square
    of_points: float  # [m] the same of points: 0 where nothing but lengths were measured
    # [rad] of each joint, in place of it; 0 where more than lengths was measured
    joint_sigma: float
    play: float = 0.0  # [m] what play of the gears makes at the end of the arm

    @property
    def strange(self) -> bool:
        """Whether the data are of another robot, or of other joint angles."""
        return not self.mean <= STRANGE + self.play

    @property
    def factor_of_points(self) -> float:
        """The factor of the regions of points."""
        return max(self.factor, FACTOR_OF_RODS) if self.joint_sigma else self.factor

    @property
    def mean(self) -> float:
        """[m]"""
        return float(self.error[self.counting].mean())

    @property
    def quantile(self) -> float:
        """[m] below which LEVEL of the errors lie."""
        return float(np.quantile(self.error[self.counting], LEVEL))


def cross_validated(fit: Fit) -> CrossValidation:
    """Errors of every pose with its region, or its place, left out of the fit: the worse."""
    table = fit.model.poses
    validations = [with_folds(fit, REGIONS, pose_regions(table))]
    places = places_of(fit)
    if len(set(places.values())) > 1:
        fold = np.concatenate([np.full(g.size, places[g.seat]) for g in table.groups])
        validations.append(with_folds(fit, PLACES, fold))
    return max(validations, key=lambda validation: validation.sigma)


def only_lengths(table: PoseTable) -> bool:
    """Whether rods alone measured the poses of a table."""
    return all(group.kind.directions < 3 for group in table.groups)


def at_one_place(fit: Fit) -> bool:
    """Whether the robot reached for sockets of one place, or rods measured it from one.

    Points and poses are seen over the whole workspace from wherever the instrument stands.
    """
    local = all(group.kind.local for group in fit.model.poses.groups)
    return local and len(set(places_of(fit).values())) == 1


def places_of(fit: Fit) -> dict[str, int]:
    """Number, from 0, of the place in the cell at which each seat stands.

    Seats near each other, or at a known distance as two sockets of one fixture are, are one place.
    """
    layout = fit.model.unknowns
    seats = list(layout.seats)
    origins = np.stack([layout.seat(fit.x, name).origin for name in seats])
    linked = np.linalg.norm(origins[:, None] - origins, axis=2) < SAME_PLACE
    for known in fit.model.poses.distances:
        linked[seats.index(known.seats[0]), seats.index(known.seats[1])] = True
    return dict(zip(seats, connected_components(linked, directed=False)[1].tolist(), strict=True))


def with_folds(fit: Fit, left_out: str, fold: NDArray[np.intp]) -> CrossValidation:
    """Cross-validation by a linear refit without each fold; fold : (N,) number of each pose's."""
    equations, model, table = fit.linear, fit.model, fit.model.poses
    ends = np.cumsum([g.size for g in table.groups])[:-1]
    points = equations.evaluations[fit.still]
    rows = [position_rows(point) for point in points]
    pairs = list(zip(points, rows, strict=True))
    moves = [
        whole_jacobian(model, equations.x, k, point, row)
        for k, (point, row) in enumerate(pairs, start=len(model.recordings))
    ]
    rests = [row(point.closure.error) for point, row in pairs]
    spreads = [spread_of(move, fit.covariance) for move in moves]
    weighted = [robust > 0.0 for robust in equations.robust[fit.still]]
    together = [list[tuple[Array, Array]]() for _ in points]
    for number in np.unique(fold):
        held = np.split(fold == number, ends)
        step, covariance = _without(fit, held)
        for n, (rest, move, own) in enumerate(zip(rests, moves, held, strict=True)):
            rest[:, own] += np.einsum("pen,p->en", move[:, :, own], step)
            if points[n].still.common is not None:  # its readings tell their own noise
                spreads[n][own] = spread_of(move[:, :, own], covariance)
                each = own & weighted[n]
                noise = _reading_noise(points[n], len(rest))[each]
                joint = _joint_covariance(move[:, :, each], covariance, noise)
                together[n].append((rest[:, each].ravel(), joint))
    judged = list(zip(rests, spreads, weighted, strict=True))
    count = sum(rest[:, k].size for rest, _, k in judged)
    known = sum(float(np.trace(s[k], axis1=1, axis2=2).sum()) for _, s, k in judged)
    square = sum(float((rest[:, k] ** 2).sum()) for rest, _, k in judged)
    declared = min(float(p.position_sigma.min()) for p in points)
    variance = max((square - known) / count, declared**2, np.finfo(float).tiny)
    white, ratios = 0.0, list[Array]()
    own_noise = any(p.still.common is not None for p in points)
    for point, (rest, spread, k), parts in zip(points, judged, together, strict=True):
        beyond, own = variance, spread[k]
        if point.still.common is None:
            white += _white(point, rest[:, k], k)
        else:
            own = own + _reading_noise(point, len(rest))[k]
            beyond, chance = variance_beyond(parts)
            beyond = max(0.0, beyond - CHANCE * chance)
            explained = np.trace(spread[k], axis1=1, axis2=2).sum() + beyond * rest[:, k].size
            white += float((rest[:, k] ** 2).sum() - explained)
        ratios.append(mahalanobis(rest[:, k], own, beyond) / chi_square_quantile(LEVEL, len(rest)))
    ratio = np.concatenate(ratios)
    return CrossValidation(
        left_out=left_out,
        error=np.concatenate([np.linalg.norm(rest, axis=0) for rest in rests]),
        counting=np.concatenate(weighted),
        sigma=float(np.sqrt(variance)),
        white=float(np.sqrt(min(max(white, 0.0) / count, variance))),
        factor=_factor_beyond_chance(ratio) if own_noise else float(np.quantile(ratio, LEVEL)),
        of_points=0.0 if only_lengths(table) else float(np.sqrt(variance)),
        joint_sigma=_joint_sigma(fit) if only_lengths(table) else 0.0,
        play=_play(table.robot),
    )


def _factor_beyond_chance(ratio: Array) -> float:
    """Factor of the regions, at least 1, by squared distances over the quantile of chi-square (N,):
    that of the share which is a deviation by chance below LEVEL.
    """
    chance = np.sqrt(LEVEL * (1.0 - LEVEL) / ratio.size)
    return max(1.0, float(np.quantile(ratio, LEVEL - chance)))


def _play(robot: Robot) -> float:
    """[m] what half of the gears' play makes at the end of the arm."""
    if robot.gears is None:
        return 0.0
    return 0.5 * float(robot.gears.lost_motion.max()) * arm_length(robot)


def _white(point: Evaluation, rest: Array, counting: NDArray[np.bool_]) -> float:
    """[m^2] sum of squares of the white noise in errors (E, N) [m] of a robot that moved.

    Second differences of neighbouring rows are without what the model leaves over, which changes
    slowly; noise that is not white is counted as such. counting : of the group's poses.
    """
    group = point.still
    if group.motion is None or group.time is None:
        return 0.0
    step = np.diff(group.time[counting])
    usual = float(np.median(step)) if step.size else np.inf
    even = np.maximum(step[1:], step[:-1]) < CLOSE * usual
    if usual > WIDEST_KNOT_SPACING or not even.any():
        return 0.0
    return float((np.diff(rest, n=2)[:, even] ** 2).mean() / 6.0 * rest.size)


def _reading_noise(point: Evaluation, directions: int) -> Array:
    """(N, E, E) [m^2] covariance of positions by the noise of each pose's own readings."""
    group = point.still
    noise = point.target_closure.sensor_columns(group.sigma, group.factor)[:, :directions]
    return np.asarray(np.einsum("kcn,kdn->ncd", noise, noise))


def _joint_covariance(moves: Array, covariance: Array, noise: Array) -> Array:
    """(E N, E N) [m^2] covariance of positions that were left out together, N of each direction.

    moves : (P, E, N) per unit of each unknown. covariance : (P, P). noise : (N, E, E) of each.
    """
    p, e, n = moves.shape
    flat, each = moves.reshape(p, -1), np.arange(n)
    out = (flat.T @ covariance @ flat).reshape(e, n, e, n)
    out[:, each, :, each] += noise
    return np.asarray(out.reshape(e * n, e * n))


def _without(fit: Fit, held: Sequence[NDArray[np.bool_]]) -> tuple[Array, Array]:
    """(P,) change of the unknowns by a linear refit without poses, (N,) of each group, and (P, P)
    their covariance then.

    Seats and targets that nothing else measured are fitted to the poses that were left out: where
    an instrument stands is always estimated again.
    """
    equations, layout, table = fit.linear, fit.model.unknowns, fit.model.poses
    normal, gradient = equations.normal.copy(), equations.gradient.copy()
    own_normal, own_gradient = np.zeros_like(normal), np.zeros_like(gradient)
    residuals = equations.residuals[fit.still]
    for jacobian, residual, k in zip(fit.jacobians, residuals, held, strict=True):
        own = jacobian[:, :, k].reshape(layout.count, -1)
        own_normal += own @ own.T
        own_gradient += own @ residual[:, k].reshape(-1)
    left = normal - own_normal
    step = -np.linalg.solve(left, gradient - own_gradient)
    fitted = [g for g, k in zip(table.groups, held, strict=True) if not k.all()]
    alone = [
        *(part for name, part in layout.seats.items() if name not in {g.seat for g in fitted}),
        *(part for name, part in layout.targets.items() if name not in {g.target for g in fitted}),
    ]
    if alone:
        index = np.concatenate([np.arange(part.start, part.stop) for part in alone])
        step[index] = 0.0
        rest = (own_gradient + own_normal @ step)[index]
        inner = own_normal[np.ix_(index, index)] + np.diag(layout.sigma[index] ** -2.0)
        step[index] = -np.linalg.solve(inner, rest)
        left[np.ix_(index, index)] += own_normal[np.ix_(index, index)]
    return np.asarray(step), fit.covariance + inverse(left) - inverse(normal)


def _joint_sigma(fit: Fit) -> float:
    """[rad] joint errors that explain what the model leaves over along the rods, noise aside.

    What two deviations of an estimated noise allow is not counted.
    """
    points = fit.linear.evaluations[fit.still]
    moves = [position_rows(point)(point.target_closure.joint_columns) for point in points]
    along = [(move**2).sum(axis=0).mean(axis=0) for move in moves]
    lever = float(np.concatenate(along).mean())  # [m^2]
    noise = float((np.concatenate([p.position_sigma for p in points]) ** 2).mean())
    chance = CHANCE * np.sqrt(2.0 / fit.model.poses.size) * noise
    seen = SEEN[min(len(fit.model.unknowns.seats), max(SEEN))]
    return float(np.sqrt(max(fit.excess.position**2 - chance, 0.0) / (seen * lever)))


def position_rows(point: Evaluation) -> Whitening:
    """Rows that take the position out of a loop-closure error [m]; along the rod of lengths."""
    n = point.samples.size
    if point.still.kind.directions < 3:
        sensed = point.target_closure.sight.directions
        matrix = np.concatenate((sensed, np.zeros_like(sensed)), axis=1)
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
