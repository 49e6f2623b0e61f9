"""Readings of fixed points and of targets by a tracker that moves, in plain numpy."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.acquisition.reference_fit import ReferenceFit, fit_references
from ballbar.cell.arrays import Array
from ballbar.cell.rigid_fit import kabsch

# Fixed points about a robot, from a tracker 3 m away.
TRACKER = np.array([3.0, -1.0, 0.5])
POINTS = np.array(
    [[1.2, 0, 0], [-0.8, 1.1, 0], [-0.7, -1, 0.1], [0.6, -1.2, 1], [0.9, 1, 0.5], [-1.2, 0.1, 0.8]]
)
POINTS -= TRACKER
SIGMA = 15e-6  # [m]
COUNT = 120
MOTIONS = ("rest", "linear", "warming up", "swinging", "jolted", "walking", "shaken")


def motion(kind: str, seed: int, count: int = COUNT) -> Array:
    """(E, 6) [m, rad] of some 0.3 mm and 0.1 mrad."""
    rng, t = np.random.default_rng([seed, 1]), np.linspace(0.0, 1.0, count)[:, None]
    size = rng.standard_normal(6) * np.repeat((2e-4, 6e-5), 3)
    shapes = {
        "rest": 0.0 * t,
        "linear": t,
        "warming up": 1.0 - np.exp(-t / 0.2),
        "swinging": np.sin(6.0 * np.pi * t),
        "jolted": (t > 0.5).astype(float),
        "walking": np.cumsum(rng.standard_normal((count, 1)), axis=0) / np.sqrt(count),
        "shaken": rng.standard_normal((count, 1)),
    }
    return np.asarray(shapes[kind] * size)


def moved(points: Array, motion: Array) -> Array:
    """(E, K, 3) [m] points (K, 3) as a seat sees them that moved."""
    turn = Rotation.from_rotvec(motion[:, 3:]).as_matrix()
    return np.asarray(np.einsum("nij,kj->nki", turn, points) + motion[:, None, :3])


def readings(kind: str, points: int, seed: int, count: int = COUNT) -> Array:
    """(E, K, 3) [m] of the first points, with white noise."""
    noise = np.random.default_rng([seed, 2]).normal(0.0, SIGMA, (count, points, 3))
    return moved(POINTS[:points], motion(kind, seed, count)) + noise


def fitted(read: Array, sigma: float = SIGMA) -> ReferenceFit:
    """The fit of measurements at equal times."""
    return fit_references(read, np.full(read.shape[:2], sigma), np.ones(len(read) - 1))


def targets(kind: str, seed: int, count: int = COUNT) -> tuple[Array, Array]:
    """(E, 3) [m] a target in each measurement: in the frame of a seat at rest, and as seen."""
    rng, at = np.random.default_rng([seed, 3]), np.arange(count)
    true = rng.uniform([-1, -1, 0], [1, 1, 1.3], (count, 3)) - TRACKER
    return true, moved(true, motion(kind, seed, count))[at, at]


def errors(fit: ReferenceFit, kind: str, seed: int) -> tuple[Array, Array]:
    """(E, 3) [m] error of corrected targets but for a common motion, and its stated deviation."""
    at = np.arange(len(fit.motion))
    true, seen = targets(kind, seed, len(at))
    return _apart(fit.steady(seen, at), true), fit.sigma(seen, at)[:, :3]


def errors_of_single_measurements(read: Array, kind: str, seed: int) -> Array:
    """(E, 3) [m] the same, each measurement moved onto the true points by itself."""
    true, seen = targets(kind, seed, len(read))
    steady, points = np.empty_like(seen), POINTS[: read.shape[1]]
    for n, own in enumerate(read):
        turn = kabsch(own - own.mean(axis=0), points - points.mean(axis=0))
        steady[n] = turn @ (seen[n] - own.mean(axis=0)) + points.mean(axis=0)
    return _apart(steady, true)


def _apart(points: Array, true: Array) -> Array:
    points, true = points - points.mean(axis=0), true - true.mean(axis=0)
    return np.asarray(points @ kabsch(points, true).T - true)
