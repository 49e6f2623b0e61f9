"""Motion of an instrument's seat against reference points that it reads beside the poses.

The points are fixed to the floor or to the robot's base. In measurement n the instrument reads of
point k

    y_nk = R(w_n) c_k + s_n + noise,

c_k the mean configuration of the points, s_n and w_n the shift and turn of its frame against the
mean one (generalised Procrustes analysis, Gower 1975). Both are random walks beside a linear trend
in time, and the variances of their steps are those of largest likelihood: slow drift is averaged
over neighbouring measurements, and noise is not taken for motion. This is the smoother of Rauch,
Tung & Striebel 1965, solved as one banded system. Weights of Geman & McClure 1987 leave out a
disturbed reading, and steps of Student's t (Lange, Little & Taylor 1989) let the seat jump.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError
from scipy.linalg.lapack import dpbtrf, dtbtrs
from scipy.optimize import minimize

from ballbar.cell.arrays import Array
from ballbar.cell.rotation import matrix_from_rotvec

_CUT = 8.0  # deviations of a reading at which a quarter of its weight is left
_FREEDOM = 4.0  # of Student's t of the steps
_ROUNDS = 10  # of weights; after five the motion changes by less than a hundredth of sigma
_DECLARED = 10.0  # readings' coordinates that the declared sigma counts as
_NEIGHBOURS = 5  # readings of a point whose median shows a disturbed one before there is a fit
_MEDIAN = 1.54  # deviations: median length of three white coordinates
_STARTS = (-6.0, -3.0, -1.0, 1.0, 4.0)  # log10 of the variance of a step over that of a reading
_LEAST_SCALE = 0.1  # of the declared sigma; readings without noise leave rounding alone
_JUMP = 30.0  # CUSUM of three coordinates; chance reaches it in one of some thousand points
_LEAST_JUMP = 2.0  # deviations of a reading; smaller ones do no harm
_CLIP = 3.0  # deviations that a reading counts in the CUSUM, lest a single one make a jump
_EDGE = 3  # readings at least on either side of a jump


@dataclass(frozen=True, eq=False)
class ReferenceFit:
    """Motion of a seat in E measurements of K reference points."""

    centre: Array  # (3,) [m] of the points
    points: Array  # (K, 3) [m] mean configuration about the centre
    motion: Array  # (E, 6) [m, rad] shift and turn of the points about the centre
    covariance: Array  # (E, 6, 6) of the motion
    residual: Array  # (E, K, 3) [m] measured minus predicted; NaN where a point was not read
    length: Array  # (E, K) of the residuals in standard deviations; NaN as in residual
    scale: float  # standard deviation of a reading over the declared one

    def rotation(self, at: NDArray[np.intp]) -> Array:
        """(N, 3, 3) from the mean frame of the seat to that of measurements `at` (N,)."""
        return matrix_from_rotvec(self.motion[at, 3:].T).transpose(2, 0, 1)

    def steady(self, points: Array, at: NDArray[np.intp]) -> Array:
        """(N, 3) [m] in the mean frame of the seat: points (N, 3) of measurements `at` (N,)."""
        away = points - self.centre - self.motion[at, :3]
        return np.asarray(np.einsum("nji,nj->ni", self.rotation(at), away) + self.centre)

    def sigma(self, points: Array, at: NDArray[np.intp]) -> Array:
        """(N, 6) [m, rad] what noise of the references adds to points (N, 3) and to rotations."""
        slope = np.tile(np.eye(6), (len(at), 1, 1))
        slope[:, :3, 3:] = -_cross(points - self.centre)
        return np.asarray(np.sqrt(np.einsum("nia,nab,nib->ni", slope, self.covariance[at], slope)))


@dataclass(frozen=True)
class Knock:
    """A reference point that moved against the others, for good."""

    point: int
    measurement: int  # the first one behind it
    size: float  # [m]


def fit_with_knocks(
    readings: Array, sigma: Array, elapsed: Array
) -> tuple[ReferenceFit, tuple[Knock, ...]]:
    """The fit with each point that was knocked as two points; arguments as `fit_references`."""
    points = readings.shape[1]
    parts = [(point, 0) for point in range(points)]  # and the measurement with which each begins
    while True:
        fit = fit_references(readings, sigma, elapsed)
        knock = _knock(fit, sigma)
        if knock is None or len(parts) == 2 * points:
            break
        part, first = knock
        readings, behind = readings.copy(), readings[:, [part]].copy()
        readings[first:, part], behind[:first] = np.nan, np.nan
        readings = np.concatenate((readings, behind), axis=1)
        sigma = np.hstack((sigma, sigma[:, [part]]))
        parts.append((parts[part][0], first))
    return fit, tuple(
        Knock(point, first, float(np.linalg.norm(fit.points[after] - fit.points[before])))
        for ((same, _), before), ((point, first), after) in pairwise(
            sorted((part, k) for k, part in enumerate(parts))
        )
        if point == same
    )


def fit_references(readings: Array, sigma: Array, elapsed: Array) -> ReferenceFit:
    """Motion of a seat that hardly turns.

    readings : (E, K, 3) [m], NaN where a point was not read. sigma : (E, K) [m] of a coordinate.
    elapsed : (E - 1,) time between measurements, above 0, in any unit.
    """
    read = np.asarray(np.isfinite(readings).all(axis=2))
    points = np.array([np.median(readings[own, k], axis=0) for k, own in enumerate(read.T)])
    centre = points.mean(axis=0)
    points, measured = points - centre, np.where(read[..., None], readings - centre, 0.0)
    sigma = np.where(read, sigma, 1.0)
    weight = _first_weights(measured, sigma, read)
    motion, tails = np.zeros((len(read), 6)), np.ones((len(elapsed), 1))
    pace = elapsed[:, None] / elapsed.mean()
    radius = float(np.sqrt((points * points).sum(axis=1).mean()))
    for _ in range(_ROUNDS):
        scale = _normal(points, measured, weight / sigma**2, motion).scale(weight)
        information = weight / (scale * sigma) ** 2
        normal = _normal(points, measured, information, motion)
        single = 1.0 / float(np.median(normal.blocks[weight.any(axis=1), 0, 0]))  # [m^2]
        unit = pace / tails * np.repeat((single, single / radius**2), 3)  # (E - 1, 6)
        precision = 1.0 / _likeliest(normal, unit, pace)
        motion, _ = normal.solved(precision, pace)
        residual = measured - _predicted(points, motion)
        turn = matrix_from_rotvec(motion[:, 3:].T)
        shift = np.einsum("nk,jin,nkj->ki", information, turn, residual)
        points = points + shift / information.sum(axis=0)[:, None]
        length = np.linalg.norm(residual, axis=2) / (scale * sigma)
        weight = _weights(length, read)
        steps = np.diff(motion, axis=0)
        steps -= pace * (tails * steps).sum(axis=0) / (tails * pace).sum()  # beside the trend
        squares = (steps**2 * precision).sum(axis=1, keepdims=True) / tails
        tails = (_FREEDOM + 6.0) / (_FREEDOM + squares)
    return ReferenceFit(
        centre=centre,
        points=points,
        motion=motion,
        covariance=normal.covariance(precision, pace),
        residual=np.where(read[..., None], residual, np.nan),
        length=np.where(read, length, np.nan),
        scale=scale,
    )


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of the motion without its steps."""

    blocks: Array  # (E, 6, 6)
    right: Array  # (E, 6)
    square: float  # of the whitened readings where the motion is zero

    def scale(self, weight: Array) -> float:
        """Standard deviation of a reading over that of the weights, by how rigid the points are.

        weight : (E, K) of the readings. The declared deviation counts as some readings do.
        """
        inverse = np.linalg.pinv(self.blocks, rcond=1e-9, hermitian=True)
        rest = self.square - np.einsum("na,nab,nb->", self.right, inverse, self.right)
        rank = np.einsum("nab,nba->n", inverse, self.blocks)
        free = (weight.sum(axis=1) * (3.0 - rank / np.maximum((weight > 0.0).sum(axis=1), 1))).sum()
        free = max(free - (3.0 * weight.shape[1] - 6.0), 0.0)
        return max(float(np.sqrt((rest + _DECLARED) / (free + _DECLARED))), _LEAST_SCALE)

    def solved(self, precision: Array, pace: Array) -> tuple[Array, float]:
        """Motion (E, 6) [m, rad], and the deviance of readings and motion.

        precision : (E - 1, 6) of the steps beside a trend. pace : (E - 1, 1) time of each.
        """
        factor, white, pulled, information, determinant = self._reduced(precision, pace)
        known = pulled.T @ white
        trend = np.linalg.solve(information, known)
        motion = dtbtrs(factor, white + pulled @ trend, uplo="L", trans="T")[0]
        return motion.reshape(-1, 6), determinant - float(white @ white) - float(known @ trend)

    def covariance(self, precision: Array, pace: Array) -> Array:
        """(E, 6, 6) of each motion; that of a known trend by elimination forwards and backwards."""
        blocks, diagonal = self.blocks.copy(), np.arange(6)
        blocks[:-1, diagonal, diagonal] += precision
        blocks[1:, diagonal, diagonal] += precision
        for n, step in enumerate(precision):
            blocks[n + 1] -= step[:, None] * np.linalg.inv(blocks[n]) * step
        out = np.asarray(np.linalg.inv(blocks), dtype=np.float64)
        for n in range(len(precision) - 1, -1, -1):
            gain = out[n] * precision[n]
            out[n] += gain @ out[n + 1] @ gain.T
        factor, _, pulled, information, _ = self._reduced(precision, pace)
        slopes = dtbtrs(factor, pulled, uplo="L", trans="T")[0].reshape(out.shape)
        return np.asarray(out + slopes @ np.linalg.inv(information) @ slopes.transpose(0, 2, 1))

    @cached_property
    def _band(self) -> Array:
        """(7, 6 E) lower band of the blocks; a step ties each unknown to the sixth behind."""
        band = np.zeros((7, self.right.size))
        for i in range(6):
            for j in range(i + 1):
                band[i - j, j::6] = self.blocks[:, i, j]
        return band

    def _reduced(self, precision: Array, pace: Array) -> tuple[Array, Array, Array, Array, float]:
        """Cholesky factor (7, 6 E) of the band without a trend, the right side (6 E,) and that of
        a trend (6 E, 6) divided by it, the information (6, 6) about the trend, and the logarithm
        of the determinant.
        """
        band, flat = self._band.copy(), precision.ravel()
        band[0, :-6] += flat
        band[0, 6:] += flat
        band[6, :-6] = -flat
        factor, minor = dpbtrf(band, lower=1)  # scipy's own functions check more, each time
        if minor != 0:
            raise LinAlgError(f"{minor}-th leading minor not positive definite")
        right = np.column_stack((self.right.ravel(), _flow(precision, pace)))
        white = dtbtrs(factor, right, uplo="L")[0]
        pulled = white[:, 1:]
        information = np.diag((precision * pace**2).sum(axis=0)) - pulled.T @ pulled
        determinant = 2.0 * np.log(factor[0]).sum() + np.linalg.slogdet(information)[1]
        return factor, white[:, 0], pulled, information, float(determinant)


def _flow(precision: Array, pace: Array) -> Array:
    """(6 E, 6) right sides of the motion for a trend in each of its six components."""
    pull = np.zeros((len(precision) + 1, 6))
    pull[1:] += precision * pace
    pull[:-1] -= precision * pace
    return np.asarray(pull[:, :, None] * np.eye(6)).reshape(-1, 6)


def _normal(points: Array, measured: Array, information: Array, motion: Array) -> _Normal:
    """Linearised at a motion (E, 6); information : (E, K) [1/m^2]."""
    predicted = _predicted(points, motion)
    slope = np.zeros((*information.shape, 3, 6))
    slope[..., :3] = np.eye(3)
    slope[..., 3:] = -_cross(predicted - motion[:, None, :3])
    apparent = measured - predicted + np.einsum("nkia,na->nki", slope, motion)
    weighted = information[..., None, None] * slope
    return _Normal(
        np.einsum("nkia,nkib->nab", weighted, slope),
        np.einsum("nkia,nki->na", weighted, apparent),
        float((information[..., None] * apparent**2).sum()),
    )


def _likeliest(normal: _Normal, unit: Array, pace: Array) -> Array:
    """(E - 1, 6) [m^2, rad^2] variances of the steps, by largest likelihood.

    unit : (E - 1, 6) of which those of all shifts, and those of all turns, are one multiple.
    """

    def variance(logs: Array) -> Array:
        return np.asarray(unit * np.repeat(10.0**logs, 3))

    def deviance(logs: Array) -> float:
        steps = variance(logs)
        return normal.solved(1.0 / steps, pace)[1] + float(np.log(steps).sum())

    start = min((np.array(pair) for pair in product(_STARTS, repeat=2)), key=deviance)
    simplex = start + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    best = minimize(
        deviance,
        start,
        method="Nelder-Mead",
        bounds=[(_STARTS[0], _STARTS[-1] + 2.0)] * 2,
        options={"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.05},
    )
    return variance(best.x)


def _predicted(points: Array, motion: Array) -> Array:
    """(E, K, 3) [m] readings of points (K, 3) about the centre."""
    turned = np.einsum("ijn,kj->nki", matrix_from_rotvec(motion[:, 3:].T), points)
    return np.asarray(turned + motion[:, None, :3])


def _weights(length: Array, read: NDArray[np.bool_]) -> Array:
    """(E, K) of readings whose residuals have `length` standard deviations."""
    return np.asarray(read / (1.0 + (length / _CUT) ** 2) ** 2)


def _first_weights(readings: Array, sigma: Array, read: NDArray[np.bool_]) -> Array:
    """(E, K) by the distance of each reading from the median of its point's neighbouring ones."""
    from scipy.ndimage import median_filter  # noqa: PLC0415  slow to import, and rarely needed

    length = np.zeros(read.shape)
    for k, own in enumerate(read.T):
        middle = median_filter(readings[own, k], (_NEIGHBOURS, 1), mode="mirror")
        length[own, k] = np.linalg.norm(readings[own, k] - middle, axis=1) / sigma[own, k]
    return _weights(length / max(float(np.median(length[read])) / _MEDIAN, _LEAST_SCALE), read)


def _knock(fit: ReferenceFit, sigma: Array) -> tuple[int, int] | None:
    """The point whose residuals jump most, by a CUSUM, and the measurement behind the jump.

    None where chance explains all of them.
    """
    largest, knock = _JUMP, None
    for k in range(sigma.shape[1]):
        rows = np.flatnonzero(np.isfinite(fit.length[:, k]))
        n, first = len(rows), np.arange(_EDGE, len(rows) - _EDGE + 1)
        if not first.size:
            continue
        residual, length = fit.residual[rows, k], fit.length[rows, k]
        residual = residual / (fit.scale * sigma[rows, k, None])
        sums = np.cumsum(residual * np.minimum(1.0, _CLIP / np.maximum(length, _CLIP))[:, None], 0)
        bridge = sums[first - 1] - first[:, None] / n * sums[-1]
        cusum = (bridge**2).sum(axis=1) * n / (first * (n - first))
        at = int(first[cusum.argmax()])
        moved = np.median(residual[at:], axis=0) - np.median(residual[:at], axis=0)
        if cusum.max() > largest and np.linalg.norm(moved) > _LEAST_JUMP:
            largest, knock = float(cusum.max()), (k, int(rows[at]))
    return knock


def _cross(vectors: Array) -> Array:
    """(..., 3, 3) matrices of the cross product of vectors (..., 3) with another."""
    return np.asarray(np.cross(vectors[..., None, :], np.eye(3)).swapaxes(-1, -2))
