"""The part of the sphere that a run covers: patches of equal size, by the tool's first visit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun as rr
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ballbar import figure_style
from ballbar.replay.entities import COVERAGE_SHARE, COVERED, Branch, at, on_dark
from ballbar.replay.motion import CellMotion
from cell.arrays import Array
from cell.geometry import Geometry

PATCHES = 800  # over the whole sphere: 0.08 of the radius across
_COVERED = on_dark(figure_style.TEAL)
_SIZE = 0.85  # of a patch's own radius: neighbours stay apart
_THICKNESS = 0.002  # [m]
_INSIDE = 0.985  # of the radius: the path stays in sight


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


def even_directions(count: int) -> Array:
    """(count, 3) unit vectors spread evenly over a sphere, on a spiral of the golden angle."""
    k = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - height * height)
    return np.column_stack((across * np.cos(turn), across * np.sin(turn), height))


def log_coverage(stream: Branch, motion: CellMotion, geometry: Geometry) -> None:
    """One flat disc a row, gathered by the view up to the time shown; and the share as a curve."""
    centre, radius = geometry.origin, geometry["bd3"]
    covered = coverage(motion.t, motion.tool, centre)
    size = _SIZE * radius * np.sqrt(4.0 / PATCHES)
    up = np.array([[0.0, 0.0, 1.0]])
    rotations = [Rotation.align_vectors(d[None], up)[0].as_quat() for d in covered.directions]
    style = rr.Ellipsoids3D.from_fields(colors=[_COVERED], fill_mode="solid")
    stream.log(COVERED, style, static=True)
    discs = rr.Ellipsoids3D.columns(
        half_sizes=np.tile((size, size, _THICKNESS), (covered.t.size, 1)),
        centers=centre + _INSIDE * radius * covered.directions,
        quaternions=np.array(rotations),
    )
    stream.send_columns(COVERED, indexes=at(covered.t), columns=discs)
    stream.log(COVERAGE_SHARE, rr.SeriesLines(names=["covered"], colors=[_COVERED]), static=True)
    shares = rr.Scalars.columns(scalars=covered.share * 100.0)
    stream.send_columns(COVERAGE_SHARE, indexes=at(covered.t), columns=shares)
