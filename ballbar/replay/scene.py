"""The 3D scene: identified cell in motion, tool path and patches of the sphere, true errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from ballbar import figure_style
from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry
from ballbar.replay.entities import (
    BAR_BODIES,
    CELL,
    COVERAGE_SHARE,
    COVERED,
    IDENTIFIED_ERROR,
    LEGEND,
    NOMINAL_ERROR,
    PATH_SO_FAR,
    Branch,
    at,
)
from ballbar.replay.series import TrueTool
from ballbar.report.colours import AFTER_COLOUR, BEFORE_COLOUR, STEEL, on_dark
from ballbar.report.motion import CellMotion
from ballbar.report.shapes import Body, cell_bodies
from ballbar.sphere_coverage import PATCHES, coverage
from ballbar.units import MM, UM

_SPHERE = (120, 165, 230, 26)  # hardly seen, so that what is behind it is
_WHOLE_PATH, _RUN_PATH = (120, 128, 142), (245, 200, 80)
_ARROW_LENGTH = 0.7  # of the rod: length at which the mean error is drawn
_COVERED = on_dark(figure_style.TEAL)
_PATCH_SIZE = 0.85  # of a patch's own radius: neighbours stay apart
_PATCH_THICKNESS = 0.002  # [m]
_INSIDE = 0.985  # of the radius: the path stays in sight


def log_shapes(stream: Branch, cell: Cell, geometry: Geometry, motion: CellMotion) -> None:
    """Shapes of all bodies, poses of the two that stand, and the sphere: they do not change."""
    bodies = cell_bodies(cell, geometry)
    for (entity, frames, row), body in zip(_moving(motion), bodies, strict=True):
        log_body(stream, entity, body)
        if row == 0:
            quaternion = rr.Quaternion(xyzw=quat_xyzw(frames.rotation(row))[0])
            pose = rr.Transform3D(translation=frames.origin[row].T[0], quaternion=quaternion)
            stream.log(entity, pose, static=True)
    sphere = rr.Ellipsoids3D(
        centers=[geometry.origin], radii=[geometry["bd3"]], colors=[_SPHERE], fill_mode="solid"
    )
    stream.log(f"{CELL}/sphere", sphere, static=True)


def log_body(stream: Branch, entity: str, body: Body) -> None:
    """The shape of a body, in the frame of its entity."""
    square, capped = ([bar for bar in body if bar.capped is caps] for caps in (False, True))
    for bars, name in ((square, "bars"), (capped, "capped_bars")):
        if not bars:
            continue
        start, end = (np.array([getattr(bar, side) for bar in bars]) for side in ("start", "end"))
        sizes: dict[str, Any] = {
            "lengths": [bar.length for bar in bars],
            "radii": [bar.radius for bar in bars],
            "quaternions": quat_from_z((end - start) / [[bar.length] for bar in bars]),
            "colors": [bar.colour for bar in bars],
            "fill_mode": "solid",
        }
        shape: rr.AsComponents
        if name == "bars":
            shape = rr.Cylinders3D(centers=0.5 * (start + end), **sizes)
        else:
            shape = rr.Capsules3D(translations=start, **sizes)
        stream.log(f"{entity}/{name}", shape, static=True)


def log_poses(stream: Branch, motion: CellMotion) -> None:
    """Poses of every body that moves."""
    for entity, frames, row in _moving(motion):
        if row:
            log_frame(stream, entity, frames, row, at(motion.t))


def log_frame(
    stream: Branch, entity: str, frames: Frames, row: int, indexes: Sequence[rr.TimeColumn]
) -> None:
    """Poses of one frame of a chain."""
    columns = rr.Transform3D.columns(
        translation=frames.origin[row].T, quaternion=quat_xyzw(frames.rotation(row))
    )
    stream.send_columns(entity, indexes=indexes, columns=columns)


def quat_xyzw(rotation: Array) -> Array:
    """(N, 4) unit quaternions of rotation matrices (3, 3, N), scalar part last as rerun wants it.

    `ballbar.cell.rotation.quat_wxyz` is MuJoCo's, scalar part first.
    """
    return np.asarray(Rotation.from_matrix(rotation.transpose(2, 0, 1)).as_quat())


def quat_from_z(directions: Array) -> Array:
    """(N, 4) unit quaternions, scalar part last, that turn the z axis to unit vectors (N, 3)."""
    x, y, z = directions.T
    halfway = np.stack((-y, x, np.zeros_like(x), 1.0 + z), axis=1)
    halfway[1.0 + z < 1e-12] = (1.0, 0.0, 0.0, 0.0)  # half a turn about x
    return np.asarray(halfway / np.linalg.norm(halfway, axis=1, keepdims=True))


def _moving(motion: CellMotion) -> list[tuple[str, Frames, int]]:
    """Every body of the mechanism, its chain and the frame that it moves with; frame 0 stands."""
    links = [f"robot/link{i}" for i in range(1, len(motion.robot.x))]
    names = ["robot/base", *links, "plate", *(f"ballbar/{name}" for name in BAR_BODIES)]
    return [
        (f"{CELL}/{name}", frames, row)
        for name, (frames, row) in zip(names, motion.frames, strict=True)
    ]


def log_coverage(stream: Branch, motion: CellMotion, geometry: Geometry) -> None:
    """One flat disc a row, gathered by the view up to the time shown; and the share as a curve."""
    centre, radius = geometry.origin, geometry["bd3"]
    covered = coverage(motion.t, motion.tool, centre)
    size = _PATCH_SIZE * radius * np.sqrt(4.0 / PATCHES)
    style = rr.Ellipsoids3D.from_fields(colors=[_COVERED], fill_mode="solid")
    stream.log(COVERED, style, static=True)
    discs = rr.Ellipsoids3D.columns(
        half_sizes=np.tile((size, size, _PATCH_THICKNESS), (covered.t.size, 1)),
        centers=centre + _INSIDE * radius * covered.directions,
        quaternions=quat_from_z(covered.directions),
    )
    stream.send_columns(COVERED, indexes=at(covered.t), columns=discs)
    stream.log(COVERAGE_SHARE, rr.SeriesLines(names=["covered"], colors=[_COVERED]), static=True)
    shares = rr.Scalars.columns(scalars=covered.share * 100.0)
    stream.send_columns(COVERAGE_SHARE, indexes=at(covered.t), columns=shares)


def log_tool(stream: Branch, motion: CellMotion) -> None:
    """The whole path, thin; and the part already run."""
    path = rr.LineStrips3D([motion.tool], colors=[_WHOLE_PATH], radii=[-1.0])
    stream.log(f"{CELL}/tool/path", path, static=True)
    log_path_so_far(stream, motion)


def log_path_so_far(stream: Branch, motion: CellMotion) -> None:
    """The tool; and its path, a short strip a row, gathered by the view up to the time shown."""
    tool = motion.tool
    style = rr.LineStrips3D.from_fields(colors=[_RUN_PATH], radii=[-2.0])
    stream.log(PATH_SO_FAR, style, static=True)
    # the viewer's own precision, 0.1 um at 1 m
    steps = np.stack((tool[:-1], tool[1:]), axis=1).astype(np.float32)
    columns = rr.LineStrips3D.columns(strips=steps)
    stream.send_columns(PATH_SO_FAR, indexes=at(motion.t[1:]), columns=columns)
    point = rr.Points3D.from_fields(colors=[AFTER_COLOUR], radii=[0.02])
    _log_point(stream, f"{CELL}/tool/identified_position", tool, motion.t, point)


def _log_point(stream: Branch, entity: str, positions: Array, t: Array, style: rr.Points3D) -> None:
    """A point at positions (N, 3) [m], t (N,) [s]."""
    stream.log(entity, style, static=True)
    columns = rr.Points3D.columns(positions=positions)
    stream.send_columns(entity, indexes=at(t), columns=columns)


def log_truth(stream: Branch, truth: TrueTool, t: Array, geometry: Geometry) -> None:
    """True tool position, and magnified arrows from there to where each model expects the tool.

    t : (N,) [s]. geometry : the identified one, for the size and place of arrows and legends.
    """
    point = rr.Points3D.from_fields(colors=[STEEL], radii=[0.016])
    _log_point(stream, f"{CELL}/tool/true_position", truth.position, t, point)
    length, lines = geometry["bd3"], []
    for entity, name, error, colour in (
        (NOMINAL_ERROR, "Orange arrow, nominal robot", truth.nominal_error, BEFORE_COLOUR),
        (IDENTIFIED_ERROR, "Blue arrow, identified robot", truth.identified_error, AFTER_COLOUR),
    ):
        mean = float(np.linalg.norm(error, axis=1).mean())
        factor = magnification(mean, _ARROW_LENGTH * length)
        arrows = rr.Arrows3D.from_fields(colors=[colour], radii=[0.015 * length])
        stream.log(entity, arrows, static=True)
        columns = rr.Arrows3D.columns(origins=truth.position, vectors=factor * error)
        stream.send_columns(entity, indexes=at(t), columns=columns)
        off = f"{mean * MM:.2f} mm" if mean >= 1e-4 else f"{mean * UM:.1f} um"
        lines.append(f"{name}: tool {off} off along the path, drawn x {spaced(factor)}")
    log_legend(stream, lines)


def log_legend(stream: Branch | rr.RecordingStream, lines: Sequence[str]) -> None:
    """Meaning of the arrows, as a page beside the scene: legible in every theme, never on it."""
    page = rr.TextDocument("  \n".join(lines), media_type=rr.MediaType.MARKDOWN)
    stream.log(LEGEND, page, static=True)


def spaced(number: int) -> str:
    """A number with its thousands apart."""
    return f"{number:,}".replace(",", " ")


def magnification(error: float, drawn: float) -> int:
    """A factor of the row 1, 2, 5, 10, ... that draws an error [m] at most `drawn` [m] long."""
    if error <= 0.0 or drawn <= error:
        return 1
    decade = 10 ** int(np.floor(np.log10(drawn / error)))
    return int(
        decade * max(step for step in (1, 2, 5) if step * decade * error <= drawn or step == 1)
    )
