"""The 3D scene of a replay: the identified cell in motion, the tool's path on the sphere, and the true errors, magnified."""

from __future__ import annotations

import numpy as np
import rerun as rr

from ballbar.replay.entities import (
    BAR_BODIES,
    CELL,
    GREEN,
    IDENTIFIED_ERROR,
    NOMINAL_ERROR,
    PATH_SO_FAR,
    RED,
    Colour,
    at,
)
from ballbar.replay.motion import CellMotion, TrueTool, quat_xyzw
from ballbar.replay.shapes import STEEL, Mesh, ball, bar_shapes, plate_shape, robot_shapes
from cell.arrays import Array
from cell.chain import Frames
from cell.descriptions import Cell
from cell.geometry import Geometry
from ident.identify import Identification

_SPHERE, _SPHERE_OPACITY = (120, 165, 230), 20  # of 255
_WHOLE_PATH, _RUN_PATH = (120, 128, 142), (245, 200, 80)
_ARROW_LENGTH = 0.7  # of the rod: how long the mean error is drawn


def log_mechanism(
    stream: rr.RecordingStream, cell: Cell, geometry: Geometry, motion: CellMotion
) -> None:
    """Robot, offset plate and ball-bar, moving, and the sphere of the rod."""
    log_shapes(stream, cell, geometry, motion)
    log_poses(stream, motion)


def log_shapes(
    stream: rr.RecordingStream, cell: Cell, geometry: Geometry, motion: CellMotion
) -> None:
    """What does not change: every body's shape, the two that stand still in their place, the sphere."""
    shapes = [*robot_shapes(cell), plate_shape(cell), *bar_shapes(cell, geometry)]
    for (entity, frames, row), shape in zip(_bodies(motion), shapes, strict=True):
        stream.log(f"{entity}/shape", _mesh(shape), static=True)
        if row == 0:
            turn = rr.Quaternion(xyzw=quat_xyzw(frames.rotation(row))[0])
            stream.log(
                entity,
                rr.Transform3D(translation=frames.origin[row].T[0], quaternion=turn),
                static=True,
            )
    radius, centre = geometry["bd3"], geometry.origin
    stream.log(
        f"{CELL}/sphere", _mesh(ball(centre, radius, _SPHERE), opacity=_SPHERE_OPACITY), static=True
    )


def log_poses(stream: rr.RecordingStream, motion: CellMotion) -> None:
    """Where every body is that moves."""
    for entity, frames, row in _bodies(motion):
        if row:
            columns = rr.Transform3D.columns(
                translation=frames.origin[row].T, quaternion=quat_xyzw(frames.rotation(row))
            )
            stream.send_columns(entity, indexes=at(motion.t), columns=columns)


def _bodies(motion: CellMotion) -> list[tuple[str, Frames, int]]:
    """Every body of the mechanism, the chain and the frame in it that it moves with; frame 0 stands still."""
    links = [(f"{CELL}/robot/{f'link{i}' if i else 'base'}", motion.robot, i) for i in range(7)]
    return [
        *links,
        (f"{CELL}/plate", motion.robot, 6),
        *((f"{CELL}/ballbar/{name}", motion.bar, i) for i, name in enumerate(BAR_BODIES)),
    ]


def _mesh(shape: Mesh, *, opacity: int = 255) -> rr.Mesh3D:
    return rr.Mesh3D(
        vertex_positions=shape.vertices,
        vertex_normals=shape.normals,
        triangle_indices=shape.triangles,
        vertex_colors=shape.colours,
        albedo_factor=(255, 255, 255, opacity),
    )


def log_tool(stream: rr.RecordingStream, motion: CellMotion) -> None:
    """The whole path, thin; and the part already run."""
    stream.log(
        f"{CELL}/tool/path",
        rr.LineStrips3D([motion.tool], colors=[_WHOLE_PATH], radii=[-1.0]),
        static=True,
    )
    log_path_so_far(stream, motion)


def log_path_so_far(stream: rr.RecordingStream, motion: CellMotion) -> None:
    """The tool, and its path as one short strip a row, which the view gathers up to the time shown."""
    tool = motion.tool
    stream.log(
        PATH_SO_FAR, rr.LineStrips3D.from_fields(colors=[_RUN_PATH], radii=[-2.0]), static=True
    )
    steps = np.stack((tool[:-1], tool[1:]), axis=1).astype(
        np.float32
    )  # the viewer's own precision, 0.1 um at 1 m
    stream.send_columns(
        PATH_SO_FAR, indexes=at(motion.t[1:]), columns=rr.LineStrips3D.columns(strips=steps)
    )
    _log_point(
        stream, f"{CELL}/tool/identified_position", tool, motion.t, radius=0.02, colour=GREEN
    )


def _log_point(
    stream: rr.RecordingStream,
    entity: str,
    places: Array,
    t: Array,
    *,
    radius: float,
    colour: Colour,
) -> None:
    stream.log(entity, rr.Points3D.from_fields(colors=[colour], radii=[radius]), static=True)
    stream.send_columns(entity, indexes=at(t), columns=rr.Points3D.columns(positions=places))


def log_truth(
    stream: rr.RecordingStream, truth: TrueTool, t: Array, result: Identification
) -> None:
    """True tool position, and from there to where each robot's model believes it, magnified to be seen; a legend above the sphere."""
    _log_point(stream, f"{CELL}/tool/true_position", truth.position, t, radius=0.016, colour=STEEL)
    length, centre = result.geometry["bd3"], result.geometry.origin
    for entity, name, error, colour, height in (
        (NOMINAL_ERROR, "nominal robot", truth.nominal_error, RED, 1.65),
        (IDENTIFIED_ERROR, "identified robot", truth.identified_error, GREEN, 1.5),
    ):
        mean = float(np.linalg.norm(error, axis=1).mean())
        factor = magnification(mean, _ARROW_LENGTH * length)
        stream.log(
            entity, rr.Arrows3D.from_fields(colors=[colour], radii=[0.015 * length]), static=True
        )
        stream.send_columns(
            entity,
            indexes=at(t),
            columns=rr.Arrows3D.columns(origins=truth.position, vectors=factor * error),
        )
        label = f"{name}: tool {_metres(mean)} off along the path, arrow x {f'{factor:,}'.replace(',', ' ')}"
        place = centre + np.array([0.0, 0.0, height * length])
        stream.log(
            f"{entity}/legend",
            rr.Points3D([place], colors=[colour], radii=[0.01], labels=[label], show_labels=True),
            static=True,
        )


def magnification(error: float, drawn: float) -> int:
    """A factor of the row 1, 2, 5, 10, ... that draws an error [m] at most `drawn` [m] long."""
    if error <= 0.0 or drawn <= error:
        return 1
    decade = 10 ** int(np.floor(np.log10(drawn / error)))
    return int(
        decade * max(step for step in (1, 2, 5) if step * decade * error <= drawn or step == 1)
    )


def _metres(length: float) -> str:
    return f"{length * 1e3:.2f} mm" if length >= 1e-4 else f"{length * 1e6:.1f} um"
