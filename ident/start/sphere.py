"""Where the ball-bar stands, from the robot alone: the tool moves on a sphere about it.

An algebraic fit of `|p - o|^2 = r^2`, then Gauss-Newton on `|p - o| - r` with the catalogue radius
as prior. When the tool stays near a circle, the two centres at the rod's length on either side of
its plane fit equally well; both are tried and kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array

# [m] the rod against its catalogue length; centres of candidates only, refined later
RADIUS_SIGMA = 0.010
FIT_SIGMA = 0.002  # [m] what uncalibrated robots leave of a sphere (1 mm and mrad of DH error)
SAME_ORDER = 10.0  # a centre this many times worse is not worth a hypothesis
_ITERATIONS = 30
_SETTLED = 1e-7  # [m] step; a ten thousandth of what the robot leaves of the sphere


@dataclass(frozen=True, eq=False)
class FittedSphere:
    """A sphere about the ball-bar."""

    centre: Array  # (3,) [m]
    radius: float  # [m]
    cost: float  # chi-square with FIT_SIGMA and the radius prior


def sphere_candidates(points: Array, radius: float) -> list[FittedSphere]:
    """Centres from which points (N, 3) [m] are about `radius` [m] away, best first: at most two.

    Raises ValueError when the points hardly move: nothing can be learnt from them.
    """
    spread = points - points.mean(axis=0)
    if np.sqrt((spread * spread).sum(axis=1).mean()) < 0.01 * radius:
        raise ValueError(
            "the tool moves less than a hundredth of the rod length: no sphere can be seen in the "
            "robot log"
        )
    algebraic = _algebraic_centre(points)
    normal = np.linalg.svd(spread, full_matrices=False)[2][2]
    foot = algebraic - float((algebraic - points.mean(axis=0)) @ normal) * normal
    height = np.sqrt(max(0.0, radius**2 - float(((points - foot) ** 2).sum(axis=1).mean())))
    starts = (algebraic, foot + height * normal, foot - height * normal)
    best, *others = sorted(
        (_refined(points, start, radius) for start in starts), key=lambda sphere: sphere.cost
    )
    as_good = (s for s in others if s.cost <= SAME_ORDER * best.cost)
    apart = [s for s in as_good if np.linalg.norm(s.centre - best.centre) > 0.01 * radius]
    return [best, *apart[:1]]


def _algebraic_centre(points: Array) -> Array:
    """(3,) centre of `|p|^2 = 2 p.o + c`, linear in o and c, for points (N, 3) [m].

    Minimum norm about the centroid, so that flat point sets stay finite.
    """
    middle = points.mean(axis=0)
    local = points - middle
    matrix = np.column_stack((2.0 * local, np.ones(len(local))))
    solution = np.linalg.lstsq(matrix, (local * local).sum(axis=1), rcond=1e-6)[0]
    return np.asarray(middle + solution[:3])


def _refined(points: Array, centre: Array, nominal: float) -> FittedSphere:
    """Gauss-Newton by normal equations, of least norm where a circle leaves the centre open."""
    radius, towards = nominal, np.ones((len(points), 4))
    prior = (FIT_SIGMA / RADIUS_SIGMA) ** 2
    for _ in range(_ITERATIONS):
        offset = points - centre
        distance = np.linalg.norm(offset, axis=1)
        np.divide(offset, distance[:, None], out=towards[:, :3])
        normal, gradient = towards.T @ towards, towards.T @ (distance - radius)
        normal[3, 3] += prior
        gradient[3] -= prior * (radius - nominal)
        step = np.linalg.lstsq(normal, gradient, rcond=None)[0]
        step *= min(1.0, 0.5 * nominal / max(float(np.linalg.norm(step[:3])), 1e-300))
        centre, radius = centre + step[:3], radius + step[3]
        if np.abs(step).max() < _SETTLED:
            break
    distance = np.linalg.norm(points - centre, axis=1)
    cost = float(
        (((distance - radius) / FIT_SIGMA) ** 2).sum() + ((radius - nominal) / RADIUS_SIGMA) ** 2
    )
    return FittedSphere(centre, float(radius), cost)
