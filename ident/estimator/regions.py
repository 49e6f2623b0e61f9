"""Contiguous regions of joint space, for cross-validation that does not flatter.

A pose left out at random has neighbours that were fitted; a region left out has none. So what is
judged is how the model continues, and errors that neighbours share do not pass for evidence.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ballbar.cell.arrays import Array
from ballbar.cell.poses import PoseTable

SAME_POSE = 5e-4  # [rad] between the angles of a pose that is measured again: servos' jitter
REGIONS = 8  # 16 take twice the time and are hardly better (docs/real_robots)


def pose_regions(table: PoseTable, count: int = REGIONS) -> NDArray[np.intp]:
    """(N,) as `joint_regions`, all measurements of one still pose in one region."""
    pose = poses_of(table)
    return joint_regions(table.q[np.unique(pose, return_index=True)[1]], count)[pose]


def poses_of(table: PoseTable) -> NDArray[np.intp]:
    """(N,) number from 0 of each measurement's pose: each its own where the robot moved."""
    moving, out = table.moving, np.arange(table.size)
    if moving.all():
        return out
    out[~moving] = distinct_poses(table.q[~moving])
    out[moving] += table.size
    return np.unique(out, return_inverse=True)[1]


def distinct_poses(q: Array) -> NDArray[np.intp]:
    """(N,) number from 0 of the pose of each of the angles q (N, J) [rad].

    A program that is repeated measures its poses again: what is so near counts as one pose.
    """
    pairs = cKDTree(q).query_pairs(SAME_POSE, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(q), len(q)))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.intp)


def joint_regions(q: Array, count: int = REGIONS) -> NDArray[np.intp]:
    """(N,) number from 0 of the region of each of the angles q (N, J) [rad].

    count : a power of two. Regions come from halving at the median along the main direction.
    """
    out = np.zeros(len(q), dtype=np.intp)
    while out.max(initial=0) + 1 < count:
        out *= 2
        for region in range(0, out.max(initial=0) + 1, 2):
            own = np.flatnonzero(out == region)
            centred = q[own] - q[own].mean(axis=0)
            main = np.linalg.svd(centred, full_matrices=False)[2][0]
            order = np.argsort(centred @ main, kind="stable")
            out[own[order[len(own) // 2 :]]] += 1
        if len(q) < 2 * count:
            break
    return out
