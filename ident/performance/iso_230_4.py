"""Circular test of ISO 230-4:2005: deviations of an actual path from a circle.

The path was traversed in one or both directions, seen from the side that its plane's normal points
to: counter-clockwise where angles grow. G of one direction and G(b) of both are ranges of radii
about the least-squares circle, as the standard permits in place of the two nearest concentric
circles, set-up errors excluded. F is about the nominal circle, its centre that of the least-squares
circle. Roundness is that of the path of both directions in ISO 12181-1 (RONt, least-squares
reference circle).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array

WINDOW = 0.005  # of the rows: longer than what noise reverses where the robot dwells
ARC = np.deg2rad(1.0)  # over which rows are averaged
FULL = np.deg2rad(350.0)  # of a path that counts as a full circle


@dataclass(frozen=True, eq=False)
class CircularTest:
    """Characteristics of one circular path, and what is drawn of it."""

    angle: Array  # (N,) [rad] of each row, as it was given
    deviation: Array  # (N,) [m] radius minus that of the least-squares circle of both directions
    counter_clockwise: NDArray[np.bool_]  # (N,) whether angles grow there
    radius: float  # [m] of the least-squares circle
    nominal: float  # [m] of the nominal circle
    eccentricity: Array  # (2,) [m] centre of the least-squares circle from the origin of the rows

    @property
    def points(self) -> Array:
        """(N, 2) [m] about the centre of the least-squares circle."""
        along = np.column_stack((np.cos(self.angle), np.sin(self.angle)))
        return np.asarray((self.radius + self.deviation)[:, None] * along)

    @property
    def laps(self) -> int:
        """Full circles that were passed, both directions together."""
        turns = (self.angle[self.counter_clockwise == way] for way in (True, False))
        return round(sum(float(np.ptp(own)) if own.size else 0.0 for own in turns) / (2.0 * np.pi))

    @property
    def roundness(self) -> float:
        """RONt [m], peak to valley about the least-squares circle."""
        return float(np.ptp(self.deviation))

    @property
    def radial_deviation(self) -> tuple[float, float]:
        """F_max and F_min [m], positive away from the centre."""
        away = self.deviation + self.radius - self.nominal
        return float(away.max()), float(away.min())


def least_squares_circle(points: Array) -> tuple[Array, float]:
    """Centre (2,) [m] and radius [m] of the circle with the least sum of squared radial distances.

    points : (N, 2) [m]. Gauss-Newton steps from the algebraic fit.
    """
    matrix = np.column_stack((2.0 * points, np.ones(len(points))))
    x = np.linalg.lstsq(matrix, (points**2).sum(axis=1), rcond=None)[0]
    centre, radius = x[:2], float(np.sqrt(x[2] + x[:2] @ x[:2]))
    for _ in range(50):
        away = points - centre
        distance = np.linalg.norm(away, axis=1)
        columns = np.column_stack((away / distance[:, None], np.ones(len(points))))
        step = np.linalg.lstsq(columns, distance - radius, rcond=None)[0]
        centre, radius = centre + step[:2], radius + float(step[2])
        if np.abs(step).max() < 1e-15:
            break
    return np.asarray(centre), radius


def circular_test(points: Array, nominal: float) -> CircularTest:
    """The test of positions in the plane of the circle, in the order in which they were passed.

    points : (N, 2) [m]; nominal : [m] radius. Raises ValueError for less than a full circle.
    """
    centre, radius = least_squares_circle(points)
    away = points - centre
    angle = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    if np.ptp(angle) < FULL:
        raise ValueError(f"{np.rad2deg(np.ptp(angle)):.0f} deg of a circle were passed, not all")
    return CircularTest(
        angle=angle,
        deviation=np.linalg.norm(away, axis=1) - radius,
        counter_clockwise=_grows(angle),
        radius=radius,
        nominal=nominal,
        eccentricity=centre,
    )


def _grows(angle: Array) -> NDArray[np.bool_]:
    """(N,) whether an angle (N,) [rad] grows, over WINDOW of the rows about each."""
    rows, window = np.arange(angle.size), max(1, round(WINDOW * angle.size))
    last = angle.size - 1
    return np.asarray(angle[np.minimum(rows + window, last)] >= angle[np.maximum(rows - window, 0)])


def mean_path(test: CircularTest) -> Array:
    """(K, 2) [m] mean points of arcs of ARC about the circle, there and then back, over all laps.

    Means of many rows take noise of the instrument off, which would widen every range of radii.
    """
    points = []
    arcs = np.floor(np.mod(test.angle, 2.0 * np.pi) / ARC).astype(np.intp)
    for way in (True, False):
        rows = test.counter_clockwise == way
        counts = np.bincount(arcs[rows])
        sums = np.column_stack([np.bincount(arcs[rows], c) for c in test.points[rows].T])
        means = sums[counts > 0] / counts[counts > 0, None]
        points.append(means if way else means[::-1])
    return np.vstack(points)


def smoothed(test: CircularTest, harmonics: int) -> Array:
    """(N,) [m] deviations of each direction as so many harmonics of the angle; its mean alone where
    it was passed in too few rows.
    """
    out = np.zeros(test.angle.size)
    for way in (True, False):
        rows = test.counter_clockwise == way
        orders = np.arange(min(harmonics, rows.sum() // 4) + 1)
        turns = np.outer(test.angle[rows], orders)
        columns = np.hstack((np.cos(turns), np.sin(turns[:, 1:])))
        solution = np.linalg.lstsq(columns, test.deviation[rows], rcond=None)[0]
        out[rows] = columns @ solution
    return out


def circular_deviation(test: CircularTest, *, counter_clockwise: bool) -> float | None:
    """G [m] of one direction about its own least-squares circle; None where it was not passed."""
    rows = test.counter_clockwise == counter_clockwise
    if not rows.any() or np.ptp(test.angle[rows]) < FULL:
        return None
    return circular_test(test.points[rows], test.nominal).roundness


def bidirectional_deviation(test: CircularTest) -> float | None:
    """G(b) [m] of both directions about one circle; None where one of them was not passed."""
    both = [circular_deviation(test, counter_clockwise=way) for way in (True, False)]
    return None if None in both else test.roundness


def plane_of(points: Array) -> tuple[Array, Array]:
    """Centre (3,) [m] and axes (2, 3) of the plane nearest to points (N, 3) [m]; its normal, the
    cross product of the axes, has a positive z, or where that is 0 a positive x.
    """
    centre = points.mean(axis=0)
    axes = np.linalg.svd(points - centre, full_matrices=False)[2][:2]
    normal = np.cross(*axes)
    upward = normal[2] if abs(normal[2]) > 1e-9 else normal[0]
    return centre, axes if upward >= 0.0 else axes[::-1]
