"""Pose and path characteristics of ISO 9283:1998, from what was attained and what was commanded.

n is the number of cycles. Positions are [m] in the base frame of the robot; angles a, b, c [rad]
are rotations about its x, y and z axes. A bar is the mean of the cycles: the barycentre of a
cluster of positions. Where the standard states three symbols for three angles or coordinates, one
array of three is returned. Half widths of 95 % intervals follow from n, for normal errors.
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit

from ballbar.cell.arrays import Array
from ballbar.cell.statistics import chi_square_quantile

CYCLES = 30  # of a pose or distance characteristic that the standard asks for (clause 6.9)
PATH_CYCLES = 10  # of a path characteristic, and of one measurement of a drift
COVERAGE = 0.95


def pose_accuracy(attained: Array, commanded: Array) -> float:
    """Pose accuracy AP_p [m] of position, clause 7.2.1: distance of the barycentre of attained
    positions (n, 3) [m] from the commanded one (3,) [m].
    """
    return float(np.linalg.norm(attained.mean(axis=0) - commanded))


def orientation_accuracy(attained: Array, commanded: Array) -> Array:
    """(3,) [rad] pose accuracies AP_a, AP_b, AP_c of orientation, clause 7.2.1: mean of attained
    angles (n, 3) [rad] minus the commanded ones (3,) [rad], full turns taken off.
    """
    return np.asarray(_within_half_turn(attained - commanded).mean(axis=0))


def pose_repeatability(attained: Array) -> Array:
    """(...) [m] pose repeatability RP_l = l_bar + 3 S_l of position, clause 7.2.2.

    attained : (n, ..., 3) [m]; l is the distance of each from the barycentre.
    """
    away = _from_barycentre(attained)
    return np.asarray(away.mean(axis=0) + 3.0 * away.std(axis=0, ddof=1))


def orientation_repeatability(attained: Array) -> Array:
    """(..., 3) [rad] pose repeatabilities RP_a, RP_b, RP_c = 3 S of orientation, each +-, clause
    7.2.2. attained : (n, ..., 3) [rad]
    """
    about_first = _within_half_turn(attained - attained[:1])
    return np.asarray(3.0 * about_first.std(axis=0, ddof=1))


def pose_accuracy_variation(barycentres: Array) -> float:
    """Multi-directional pose accuracy variation vAP_p [m] of position, clause 7.2.3: largest
    distance between barycentres (h, 3) [m] of one pose that is approached from h directions.
    """
    between = barycentres[:, None] - barycentres[None]
    return float(np.linalg.norm(between, axis=2).max())


def orientation_accuracy_variation(means: Array) -> Array:
    """(3,) [rad] variations vAP_a, vAP_b, vAP_c of orientation, clause 7.2.3: largest difference of
    mean angles (h, 3) [rad] between h directions of approach.
    """
    about_first = _within_half_turn(means - means[:1])
    return np.asarray(np.ptp(about_first, axis=0))


def distance_accuracy(first: Array, second: Array, commanded: Array) -> float:
    """Distance accuracy AD_p [m], clause 7.3: mean attained minus commanded distance, positive
    where the robot moves too far.

    first, second : (n, 3) [m] positions attained at two poses, cycle by cycle. commanded : (2, 3)
    """
    distance = np.linalg.norm(commanded[0] - commanded[1])
    return float(np.linalg.norm(first - second, axis=1).mean() - distance)


def distance_repeatability(first: Array, second: Array) -> float:
    """Distance repeatability RD [m], +- 3 S of the attained distances, clause 7.3.

    first, second : (n, 3) [m] as of `distance_accuracy`.
    """
    return float(3.0 * np.linalg.norm(first - second, axis=1).std(ddof=1))


def drift(values: Array) -> Array:
    """(...) drift of a pose characteristic, dAP or dRP: largest change from its first value.

    values : (T, ...) AP or RP [m, rad] at T times (drift of pose characteristics).
    """
    return np.asarray(np.abs(values - values[:1]).max(axis=0))


def path_accuracy(attained: Array, commanded: Array) -> float:
    """Path accuracy AT_p [m] of position, clause 8.2: largest distance between the barycentre of
    the attained paths and the commanded path.

    attained : (n, m, 3) [m] where n paths pass the normal planes of m commanded points (m, 3) [m].
    """
    return float(np.linalg.norm(attained.mean(axis=0) - commanded, axis=1).max())


def orientation_path_accuracy(attained: Array, commanded: Array) -> Array:
    """(3,) [rad] path accuracies AT_a, AT_b, AT_c of orientation, clause 8.2.

    attained : (n, m, 3) [rad]; commanded : (m, 3) [rad].
    """
    return np.asarray(np.abs(_within_half_turn(attained - commanded).mean(axis=0)).max(axis=0))


def path_repeatability(attained: Array) -> float:
    """Path repeatability RT_p [m] of position, clause 8.3: largest l_bar + 3 S_l of attained paths
    (n, m, 3) [m] over the m points.
    """
    return float(pose_repeatability(attained).max())


def orientation_path_repeatability(attained: Array) -> Array:
    """(3,) [rad] path repeatabilities RT_a, RT_b, RT_c, clause 8.3: largest 3 S over the points.

    attained : (n, m, 3) [rad]
    """
    return np.asarray(orientation_repeatability(attained).max(axis=0))


def in_normal_planes(path: Array, commanded: Array) -> Array:
    """(m, C) where an attained path passes the planes normal to the commanded path, clause 8.2.

    path : (K, C) sampled, straight between the samples: three coordinates [m], and angles [rad]
    where they are known. commanded : (m, 3) [m], whose tangents are differences of neighbours. NaN
    where a plane is not passed; of several passages the one nearest to the commanded point counts.
    """
    tangents = np.gradient(commanded, axis=0)
    along = np.einsum("kmc,mc->km", path[:, None, :3] - commanded, tangents)
    begin, end = along[:-1], along[1:]
    passed = (begin <= 0.0) & (end > 0.0)
    share = np.where(passed, begin / np.where(passed, begin - end, 1.0), 0.0)
    points = path[:-1, None] + share[..., None] * np.diff(path, axis=0)[:, None]
    away = np.where(passed, np.linalg.norm(points[..., :3] - commanded, axis=2), np.inf)
    nearest = away.argmin(axis=0)
    chosen = points[nearest, np.arange(len(commanded))]
    chosen[~passed.any(axis=0)] = np.nan
    return np.asarray(chosen)


def accuracy_half_width(attained: Array, commanded: Array) -> float:
    """[m] half width of the 95 % interval of AP_p, by the spread along the deviation.

    attained : (n, 3) [m]; commanded : (3,) [m].
    """
    away = attained.mean(axis=0) - commanded
    size = np.linalg.norm(away)
    along = attained @ (away / size) if size > 0.0 else np.linalg.norm(attained - commanded, axis=1)
    return mean_half_width(along)


def mean_half_width(values: Array) -> float:
    """Half width of the 95 % interval of the mean of n values (n,), by Student's t."""
    n = len(values)
    return float(stdtrit(n - 1, 0.5 + 0.5 * COVERAGE) * values.std(ddof=1) / np.sqrt(n))


def deviation_interval(n: int) -> tuple[float, float]:
    """Ends of the 95 % interval of a standard deviation of n normal values, as factors of it.

    They hold for RP_l of positions that spread along one direction, and are wider than needed where
    the positions spread along three.
    """
    low, high = (chi_square_quantile(0.5 + side * COVERAGE, n - 1) for side in (0.5, -0.5))
    return float(np.sqrt((n - 1) / low)), float(np.sqrt((n - 1) / high))


def _from_barycentre(attained: Array) -> Array:
    """(n, ...) [m] distances l of positions (n, ..., 3) from their barycentre."""
    return np.asarray(np.linalg.norm(attained - attained.mean(axis=0), axis=-1))


def _within_half_turn(angles: Array) -> Array:
    """Differences of angles [rad] without full turns."""
    return np.asarray(angles - 2.0 * np.pi * np.round(angles / (2.0 * np.pi)))
