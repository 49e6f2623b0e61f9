"""The part of the sphere that a run covers, as discs on it and as a curve."""

from __future__ import annotations

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from ballbar import figure_style
from ballbar.replay.colours import on_dark
from ballbar.replay.entities import COVERAGE_SHARE, COVERED, Branch, at
from ballbar.replay.motion import CellMotion
from ballbar.sphere_coverage import PATCHES, coverage
from cell.geometry import Geometry

_COVERED = on_dark(figure_style.TEAL)
_SIZE = 0.85  # of a patch's own radius: neighbours stay apart
_THICKNESS = 0.002  # [m]
_INSIDE = 0.985  # of the radius: the path stays in sight


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
