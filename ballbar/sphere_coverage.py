"""The part of the sphere that a run covers: patches of equal size, by the tool's first visit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ballbar.cell.arrays import Array
from ballbar.cell.rotation import even_directions

PATCHES = 800  # over the whole sphere: 0.08 of the radius across


@dataclass(frozen=True, eq=False)
class Coverage:
    """Patches in the order of their first visit."""

    t: Array  # (K,) [s] of the first visit
    directions: Array  # (K, 3) unit, from the centre of the sphere

    @property
    def share(self) -> Array:
        """(K,) of the whole sphere, from 0 to 1, as each is added."""
        return np.arange(1, self.t.size + 1) / PATCHES


def coverage(t: Array, tool: Array, centre: Array) -> Coverage:
    """The patches that the tool (N, 3) [m] passes at t (N,) [s]; centre (3,) [m] of the sphere."""
    points = even_directions(PATCHES)
    arms = tool - centre
    _, patch = cKDTree(points).query(arms / np.linalg.norm(arms, axis=1)[:, None])
    visited, first = np.unique(patch, return_index=True)
    order = np.argsort(first)
    return Coverage(t[first[order]], points[visited[order]])
