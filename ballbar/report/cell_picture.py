"""The cell at one instant of a recording: robot, plate, ball-bar and the path of the tool.

A parallel projection of the shapes that the replay moves, painted from the back to the front.
"""

from __future__ import annotations

from itertools import groupby

import numpy as np
from markupsafe import Markup

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.figure_style import BEFORE
from ballbar.report.drawing import WIDTH, figure
from ballbar.report.motion import cell_motion
from ballbar.report.shapes import Bar, cell_bodies
from ballbar.result.run_data import FittedRecording

AZIMUTH, ELEVATION = np.radians(-50.0), np.radians(20.0)  # of the eye: from the robot's x axis, up
LIGHT = np.array([-0.36, 0.58, 0.73])  # towards it: right, up, to the eye
AMBIENT = 0.4  # share of light that comes from everywhere
_SIDES, _SHADES = 24, 16  # of a round bar; of a colour
_PIECE = 0.08  # [m] a bar is painted in pieces of this length, so that what crosses it hides it
_PATH = 600  # points of the path


def cell_picture(cell: Cell, fitted: FittedRecording) -> Markup:
    """The identified cell in the middle of a recording, and the whole path."""
    t = fitted.recording.robot_log.t
    motion = cell_motion(fitted, np.arange(0, t.size, max(1, t.size // _PATH)))
    view, row = _view(), motion.t.size // 2
    quads, colours = [], []
    bodies = cell_bodies(cell, fitted.estimate.geometry)
    for (frames, frame), body in zip(motion.frames, bodies, strict=True):
        turn, origin = view @ frames.rotation(frame)[..., row], frames.origin[frame, :, row]
        for bar in body:
            corners = _surface(bar) @ turn.T + view @ origin
            normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            front = normals[:, 2] > 0.0
            light = AMBIENT + (1.0 - AMBIENT) * np.clip(normals[front] @ LIGHT, 0.0, None)
            light = np.round(np.minimum(light, 1.0) * _SHADES) / _SHADES
            quads.append(corners[front])
            colours.append(light[:, None] * np.array(bar.colour))
    return _painted(np.concatenate(quads), np.concatenate(colours), motion.tool @ view.T)


def _view() -> Array:
    """(3, 3) rows: right, up and towards the eye, in the robot's base frame."""
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    eye = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), np.tan(ELEVATION)])
    eye /= np.linalg.norm(eye)
    return np.stack((right, np.cross(eye, right), eye))


def _surface(bar: Bar) -> Array:
    """(K, 4, 3) [m] corners of the faces of a bar, anticlockwise from outside."""
    axis = (bar.end - bar.start) / bar.length
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    across /= np.linalg.norm(across)
    turn = np.linspace(0.0, 2.0 * np.pi, _SIDES + 1)[:, None]
    radial = np.cos(turn) * across + np.sin(turn) * np.cross(axis, across)
    along = np.linspace(0.0, bar.length, 1 + int(np.ceil(bar.length / _PIECE)))
    lift = np.radians([0.0, 30.0, 60.0, 89.0]) if bar.capped else np.radians([0.0, 0.0])
    cap, radius = bar.radius * np.sin(lift[1:]), bar.radius * np.cos(lift[1:])
    if not bar.capped:
        radius = np.array([1e-3 * bar.radius])
    s = np.concatenate((-cap[::-1], along, bar.length + cap))
    r = np.concatenate((radius[::-1], np.full(along.size, bar.radius), radius))
    ring = bar.start + s[:, None, None] * axis + r[:, None, None] * radial
    faces = np.stack((ring[:-1, :-1], ring[:-1, 1:], ring[1:, 1:], ring[1:, :-1]), axis=2)
    return np.asarray(faces.reshape(-1, 4, 3))


def _painted(quads: Array, colours: Array, path: Array) -> Markup:
    """quads : (T, 4, 3) [m], corners by right, up and towards the eye. path : (N, 3) as they.

    colours : (T, 3) from 0 to 255.
    """
    seen = np.concatenate((quads.reshape(-1, 3), path))[:, :2]
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = (WIDTH - 8.0) / float((high - low).max())
    wide, tall = (scale * (high - low)).tolist()
    corner, upright = np.array([0.5 * (WIDTH - wide), 4.0 + tall]), np.array([scale, -scale])

    def page(points: Array) -> Array:
        return np.asarray(corner + upright * (points[..., :2] - low))

    order = np.argsort(quads[:, :, 2].mean(axis=1))
    faces, parts = page(quads[order]), []
    fills = [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in colours[order].round().astype(int).tolist()]
    for fill, members in groupby(range(len(fills)), key=fills.__getitem__):
        outline = "".join(f"{_line(faces[k])}Z" for k in members)
        parts.append(_path(outline, fill, fill, 0.4))
    parts.append(_path(_line(page(path)), "none", BEFORE, 0.6))
    return figure(parts, 8.0 + tall)


def _path(data: str, fill: str, stroke: str, width: float) -> str:
    return f'<path d="{data}" fill="{fill}" stroke="{stroke}" stroke-width="{width:g}"/>'


def _line(points: Array) -> str:
    """SVG path data of the line through points (N, 2)."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
