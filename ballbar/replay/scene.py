"""The 3D scene: identified cell in motion, tool path on the sphere, true errors as arrows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from ballbar.replay.colours import AFTER_COLOUR, BEFORE_COLOUR, STEEL
from ballbar.replay.entities import (
    BAR_BODIES,
    CELL,
    IDENTIFIED_ERROR,
    LEGEND,
    NOMINAL_ERROR,
    PATH_SO_FAR,
    Branch,
    at,
)
from ballbar.replay.motion import CellMotion, TrueTool
from ballbar.replay.shapes import Mesh, ball, cell_shapes
from ballbar.units import MM, UM
from cell.arrays import Array
from cell.chain import Frames
from cell.descriptions import Cell
from cell.geometry import Geometry

_SPHERE, _SPHERE_OPACITY = (120, 165, 230), 20  # of 255
_WHOLE_PATH, _RUN_PATH = (120, 128, 142), (245, 200, 80)
_ARROW_LENGTH = 0.7  # of the rod: length at which the mean error is drawn


def log_mechanism(stream: Branch, cell: Cell, geometry: Geometry, motion: CellMotion) -> None:
    """Robot, offset plate and ball-bar, moving, and the sphere of the rod."""
    log_shapes(stream, cell, geometry, motion)
    log_poses(stream, motion)


def log_shapes(stream: Branch, cell: Cell, geometry: Geometry, motion: CellMotion) -> None:
    """What does not change: the bodies' shapes, the poses of the two that stand, the sphere."""
    shapes = cell_shapes(cell, geometry)
    for (entity, frames, row), shape in zip(_bodies(motion), shapes, strict=True):
        stream.log(f"{entity}/shape", _mesh(shape), static=True)
        if row == 0:
            quaternion = rr.Quaternion(xyzw=quat_xyzw(frames.rotation(row))[0])
            pose = rr.Transform3D(translation=frames.origin[row].T[0], quaternion=quaternion)
            stream.log(entity, pose, static=True)
    sphere = ball(geometry.origin, geometry["bd3"], _SPHERE)
    stream.log(f"{CELL}/sphere", _mesh(sphere, opacity=_SPHERE_OPACITY), static=True)


def log_poses(
    stream: Branch, motion: CellMotion, indexes: Sequence[rr.TimeColumn] | None = None
) -> None:
    """Poses of every body that moves; indexes : of its rows, by default its times."""
    for entity, frames, row in _bodies(motion):
        if row:
            columns = rr.Transform3D.columns(
                translation=frames.origin[row].T, quaternion=quat_xyzw(frames.rotation(row))
            )
            stream.send_columns(entity, indexes=indexes or at(motion.t), columns=columns)


def quat_xyzw(rotation: Array) -> Array:
    """(N, 4) unit quaternions of rotation matrices (3, 3, N), scalar part last as rerun wants it.

    `cell.rotation.quat_wxyz` is MuJoCo's, scalar part first.
    """
    return np.asarray(Rotation.from_matrix(rotation.transpose(2, 0, 1)).as_quat())


def _bodies(motion: CellMotion) -> list[tuple[str, Frames, int]]:
    """Every body of the mechanism, its chain and the frame that it moves with; frame 0 stands."""
    links = [f"robot/link{i}" for i in range(1, len(motion.robot.x))]
    names = ["robot/base", *links, "plate", *(f"ballbar/{name}" for name in BAR_BODIES)]
    return [
        (f"{CELL}/{name}", frames, row)
        for name, (frames, row) in zip(names, motion.frames, strict=True)
    ]


def _mesh(shape: Mesh, *, opacity: int = 255) -> rr.Mesh3D:
    return rr.Mesh3D(
        vertex_positions=shape.vertices,
        vertex_normals=shape.normals,
        triangle_indices=shape.triangles,
        vertex_colors=shape.colours,
        albedo_factor=(255, 255, 255, opacity),
    )


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
    """What the arrows mean, as a page beside the scene: legible in every theme, and never on it."""
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
