"""Where the ball-bar stands, from the robot alone: the tool moves on a sphere about it.

An algebraic fit of `|p - o|^2 = r^2`, then Gauss-Newton on `|p - o| - r` with the catalogue radius as prior. When the tool
stays near a circle, the centre mirrored in the plane of the circle fits almost as well and is kept as a second candidate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.chain import Array

RADIUS_SIGMA = 0.010  # [m] the rod against its catalogue length; centres of candidates only, refined later
FIT_SIGMA = 0.002  # [m] what uncalibrated robots leave of a sphere (1 mm and mrad of DH error)
SAME_ORDER = 10.0  # a mirrored centre this many times worse is not worth a hypothesis
_ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class Sphere:
    """A sphere about the ball-bar."""

    centre: Array  # (3,) [m]
    radius: float  # [m]
    cost: float  # chi-square with FIT_SIGMA and the radius prior


def sphere_candidates(points: Array, radius: float) -> list[Sphere]:
    """Centres about which the points (N, 3) [m] lie at about `radius` [m], best first; one, seldom two.

    Raises ValueError when the points hardly move: nothing can be learnt from them.
    """
    spread = points - points.mean(axis=0)
    if np.sqrt((spread * spread).sum(axis=1).mean()) < 0.01 * radius:
        raise ValueError("the tool moves less than a hundredth of the rod length: no sphere can be seen in the robot log")
    first = _refined(points, _algebraic_centre(points), radius)
    normal = np.linalg.svd(spread, full_matrices=False)[2][2]
    mirrored = first.centre - 2.0 * float((first.centre - points.mean(axis=0)) @ normal) * normal
    second = _refined(points, mirrored, radius)
    both = sorted((first, second), key=lambda sphere: sphere.cost)
    if np.linalg.norm(first.centre - second.centre) < 0.01 * radius or both[1].cost > SAME_ORDER * both[0].cost:
        return both[:1]
    return both


def _algebraic_centre(points: Array) -> Array:
    """|p|^2 = 2 p.o + c, linear in o and c; minimum norm about the centroid, so flat point sets stay finite."""
    middle = points.mean(axis=0)
    local = points - middle
    matrix = np.column_stack((2.0 * local, np.ones(len(local))))
    solution = np.linalg.lstsq(matrix, (local * local).sum(axis=1), rcond=1e-6)[0]
    return np.asarray(middle + solution[:3])


def _refined(points: Array, centre: Array, nominal: float) -> Sphere:
    radius = nominal
    for _ in range(_ITERATIONS):
        offset = points - centre
        distance = np.linalg.norm(offset, axis=1)
        jacobian = np.column_stack((-offset / distance[:, None], -np.ones(len(points)))) / FIT_SIGMA
        residual = (distance - radius) / FIT_SIGMA
        jacobian = np.vstack((jacobian, [0.0, 0.0, 0.0, 1.0 / RADIUS_SIGMA]))
        residual = np.append(residual, (radius - nominal) / RADIUS_SIGMA)
        step = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
        step *= min(1.0, 0.5 * nominal / max(float(np.linalg.norm(step[:3])), 1e-300))
        centre, radius = centre + step[:3], radius + step[3]
        if np.abs(step).max() < 1e-9:
            break
    distance = np.linalg.norm(points - centre, axis=1)
    cost = float((((distance - radius) / FIT_SIGMA) ** 2).sum() + ((radius - nominal) / RADIUS_SIGMA) ** 2)
    return Sphere(centre, float(radius), cost)
