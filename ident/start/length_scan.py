"""All clock offsets at once: the length of a telescoping bar against the path of the robot's tool.

With the seat c, the tool's point p by the nominal robot and the sensed length L, zero error z,

    |p - c|^2 = (L + z)^2   or   |p|^2 - L^2 = 2 p.c + 2 z L + (z^2 - |c|^2),

linear in c, z and the constant (trilateration). At each lag the least-squares residual follows from
sums over the overlap: products of the robot's signals by running sums, products with L and L^2 by
FFT. So the seat, whatever its place, comes with the clock offset.

An uncalibrated robot leaves millimetres there, as much as a short stroke. So the scan is repeated
about the seat that was found, with the robot's parameters as further columns, 2 (p - c) . dp/dx,
their priors as further equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.ident.start.lag_scan import MIN_OVERLAP, LagScan, best_lags, lag_sums

# [m] error of a tool's point by an uncalibrated robot, and by one whose parameters are free
POINT_SIGMA, FREE_SIGMA = 3e-3, 3e-4
SEAT_SIGMA = 10.0  # [m] of seat and constant: no knowledge
FLAT = 0.03  # [m] height above the path from which the seats on both sides are tried
APART = 2.0  # [s] nearer maxima belong to one peak
BATCH = 2000  # lags whose equations are solved at once


@dataclass(frozen=True, eq=False)
class LengthScan:
    """Score of every lag, and the unknowns that go with it."""

    scan: LagScan
    centre: Array  # (3,) [m] of the tool's path
    unknowns: Array  # (L, 5) seat beside the centre [m], constant [m], zero [m]
    scale: float  # [m] of the constant: twice the typical length
    normal: Array  # (3,) direction in which the path extends least

    def zero(self, index: int) -> float:
        """[m] error of the length's zero at a lag."""
        return float(self.unknowns[index, 4])

    def seats(self, index: int) -> list[Array]:
        """(3,) [m] seats at a lag: one, or those on either side of a path that is nearly flat.

        Across a flat path the linear equations say nothing, the constant does.
        """
        beside, constant = self.unknowns[index, :3], float(self.unknowns[index, 3]) * self.scale
        square = self.zero(index) ** 2 - constant - float(beside @ beside)
        seat = self.centre + beside
        if square <= FLAT**2:
            return [seat]
        along = float(beside @ self.normal)
        foot, height = seat - along * self.normal, np.sqrt(square + along * along)
        return [foot + height * self.normal, foot - height * self.normal]


def best_lengths(
    points: Array, moves: Array, length: Array, step: float, *, zero_sigma: float, count: int
) -> list[tuple[LengthScan, int]]:
    """The best lags of two scans on even grids of step [s], best first.

    points : (Nr, 3) [m] of the tool. moves : (P, 3, Nr) [m] of them for a prior deviation of each
    of the robot's parameters. length : (Nb,) [m] sensed. zero_sigma : [m] of the length's zero.
    count : of lags. The scan with the robot's parameters free comes first, the best lag of the
    nominal robot's scan last.
    """
    data, apart = _Data(points, length, zero_sigma), round(APART / step)
    rigid = _scan(data, np.zeros((0, len(points))), step, POINT_SIGMA)
    first = best_lags(rigid.scan, count=1, separation=apart)
    if not first:
        return []
    along = [np.einsum("ni,pin->pn", points - seat, moves) for seat in rigid.seats(first[0])]
    free = [_scan(data, 2.0 * part, step, FREE_SIGMA) for part in along]
    best = max(free, key=lambda scan: scan.scan.score.max())
    lags = [(best, k) for k in best_lags(best.scan, count=count, separation=apart)]
    apart_from_all = all(abs(first[0] - k) >= apart for _, k in lags)
    return [*lags, *([(rigid, first[0])] if apart_from_all else [])]


@dataclass(frozen=True, eq=False)
class _Data:
    """Tool positions and lengths that the scan compares."""

    points: Array  # (Nr, 3) [m]
    length: Array  # (Nb,) [m]
    zero_sigma: float  # [m]


def _scan(data: _Data, free: Array, step: float, sigma: float) -> LengthScan:
    """Score of every lag.

    free : (P, Nr) [m^2] change of the squared distance for a prior deviation of each parameter of
    the robot. sigma : [m] of a length beside all that.
    """
    centre, length = data.points.mean(axis=0), data.length
    p, scale = data.points - centre, 2.0 * float(length.mean())
    columns = np.column_stack((2.0 * p / scale, np.ones(len(p)), -free.T / scale))
    square = length * length / scale
    equations = _equations(columns, (p * p).sum(axis=1) / scale, 2.0 * length / scale, square)
    prior = np.array([*[SEAT_SIGMA] * 4, *[1.0] * len(free), data.zero_sigma])
    lags = np.arange(-(length.size - 1), len(p))
    overlap = np.minimum(len(p), lags + length.size) - np.maximum(0, lags)
    score, unknowns = np.full(lags.size, -np.inf), np.zeros((lags.size, prior.size))
    signal, floor = _variance(square, np.maximum(0, -lags), overlap), sigma**2
    usable = np.flatnonzero(overlap * step >= MIN_OVERLAP)
    for chosen in np.array_split(usable, 1 + usable.size // BATCH):
        # At the minimum the squares and floor |x|^2 sum up to power - x.right, x in prior units.
        normal, right, power = equations.at(chosen)
        right = right * prior
        normal = normal * np.outer(prior, prior) + floor * np.eye(prior.size)
        x = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        cost = np.maximum(0.0, power - (x * right).sum(axis=1)) / overlap[chosen]
        score[chosen] = overlap[chosen] * np.log((signal[chosen] + floor) / (cost + floor))
        unknowns[chosen] = x * prior
    least = np.linalg.svd(p, full_matrices=False)[2][2]
    of_length = unknowns[:, [0, 1, 2, 3, -1]]
    return LengthScan(LagScan(lags, score, overlap), centre, of_length, scale, least)


@dataclass(frozen=True, eq=False)
class _Equations:
    """Sums from which the normal equations of every lag follow; K robot columns, one of the bar."""

    robot: Array  # (Nr + 1, K + 1, K + 1) running sums of products of robot columns and target
    bar: Array  # (Nb + 1, 2, 2) running sums of products of the bar's column and square
    mixed: Array  # (K + 1, 2, L) products of both sides at every lag

    def at(self, index: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Normal matrices (B, K + 1, K + 1), right sides (B, K + 1), target powers (B,)."""
        n_robot, n_bar = len(self.robot) - 1, len(self.bar) - 1
        lag = index - (n_bar - 1)
        begin, end = np.maximum(0, -lag), np.minimum(n_bar, n_robot - lag)
        robot = self.robot[end + lag] - self.robot[begin + lag]
        bar = self.bar[end] - self.bar[begin]
        mixed = self.mixed[:, :, index].transpose(2, 0, 1)
        k = robot.shape[1] - 1
        normal = np.empty((index.size, k + 1, k + 1))
        normal[:, :k, :k] = robot[:, :k, :k]
        normal[:, :k, k] = normal[:, k, :k] = mixed[:, :k, 0]
        normal[:, k, k] = bar[:, 0, 0]
        right = np.empty((index.size, k + 1))
        right[:, :k] = robot[:, :k, k] - mixed[:, :k, 1]
        right[:, k] = mixed[:, k, 0] - bar[:, 0, 1]
        power = robot[:, k, k] - 2.0 * mixed[:, k, 1] + bar[:, 1, 1]
        return normal, right, power


def _equations(robot: Array, target: Array, bar: Array, square: Array) -> _Equations:
    """Sums of all products; robot (Nr, K), target (Nr,), bar and square (Nb,)."""
    left, right = np.column_stack((robot, target)), np.column_stack((bar, square))
    mixed = [[lag_sums(r, column) for r in right.T] for column in left.T]
    return _Equations(_running(left), _running(right), np.array(mixed))


def _running(columns: Array) -> Array:
    """(N + 1, K, K) sums of the products of columns (N, K) over the rows before each row."""
    products = np.einsum("ni,nj->nij", columns, columns)
    return np.concatenate((np.zeros((1, *products.shape[1:])), np.cumsum(products, axis=0)))


def _variance(values: Array, begin: Array, count: Array) -> Array:
    """(L,) variance of values (N,) inside each overlap: its first sample and its samples."""
    values = values - values.mean()
    sums = np.concatenate(([0.0], np.cumsum(values)))
    squares = np.concatenate(([0.0], np.cumsum(values * values)))
    mean, mean_square = (
        (s[begin + count] - s[begin]) / np.maximum(count, 1) for s in (sums, squares)
    )
    return np.asarray(np.maximum(0.0, mean_square - mean * mean))
