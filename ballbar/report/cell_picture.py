"""The cell at one instant of a recording: robot, plate, ball-bar and the path of the tool.

A parallel projection of the shapes that the replay moves, painted from the back to the front.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import cast

import numpy as np
from markupsafe import Markup
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from ballbar.figure_style import BEFORE
from ballbar.replay.motion import cell_motion, thinning
from ballbar.replay.shapes import cell_shapes
from ballbar.result.run_data import FittedRecording
from cell.arrays import Array
from cell.descriptions import Cell

SIZE, RESOLUTION = 4.6, 150  # [in, dots per in]
AZIMUTH, ELEVATION = np.radians(-50.0), np.radians(20.0)  # of the eye: from the robot's x axis, up
LIGHT = np.array([-0.36, 0.58, 0.73])  # towards it: right, up, to the eye
AMBIENT = 0.4  # share of light that comes from everywhere


def cell_picture(cell: Cell, fitted: FittedRecording) -> Markup:
    """An image element: the identified cell in the middle of a recording, and the whole path."""
    t = fitted.recording.robot_log.t
    motion = cell_motion(fitted, np.arange(0, t.size, thinning(t)))
    view, row = _view(), motion.t.size // 2
    corners, colours = [], []
    shapes = cell_shapes(cell, fitted.estimate.geometry)
    for (frames, frame), shape in zip(motion.frames, shapes, strict=True):
        turned = view @ frames.rotation(frame)[..., row]
        seen = shape.vertices @ turned.T + view @ frames.origin[frame, :, row]
        normals = (shape.normals @ turned.T)[shape.triangles].mean(axis=1)
        front = normals[:, 2] > 0.0
        light = AMBIENT + (1.0 - AMBIENT) * np.clip(normals @ LIGHT, 0.0, None)
        colour = shape.colours[shape.triangles[:, 0], :3] / 255.0 * light[:, None]
        corners.append(seen[shape.triangles[front]])
        colours.append(np.clip(colour[front], 0.0, 1.0))
    return _painted(np.concatenate(corners), np.concatenate(colours), motion.tool @ view.T)


def _view() -> Array:
    """(3, 3) rows: right, up and towards the eye, in the robot's base frame."""
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    eye = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), np.tan(ELEVATION)])
    eye /= np.linalg.norm(eye)
    return np.stack((right, np.cross(eye, right), eye))


def _painted(triangles: Array, colours: Array, path: Array) -> Markup:
    """triangles : (T, 3, 3) [m], corners by right, up and towards the eye. path : (N, 3) likewise.

    colours : (T, 3) from 0 to 1.
    """
    order = np.argsort(triangles[:, :, 2].mean(axis=1))
    figure = Figure(figsize=(SIZE, SIZE))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), aspect="equal", frame_on=False)
    axes.set_axis_off()
    shown = colours[order]
    corners = cast("Sequence[Array]", triangles[order][:, :, :2])  # a list takes twice as long
    bodies = PolyCollection(corners, facecolors=shown, edgecolors=shown, linewidths=0.3)
    axes.add_collection(bodies)
    axes.plot(*path[:, :2].T, color=BEFORE, linewidth=0.6, alpha=0.8)
    axes.autoscale_view()
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=RESOLUTION, transparent=True)
    content = base64.b64encode(file.getvalue()).decode()
    return Markup(f'<img alt="" src="data:image/png;base64,{content}">')
