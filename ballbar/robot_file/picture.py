"""A robot as a stick figure: its DH rows, along z by d, then along x by a, and their frames."""

from __future__ import annotations

import io
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, forward
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.figure_style import BLUE, FRAME, GREEN, INK, QUIET, RED
from ballbar.units import MM

_FRAME_SIZE = 0.06  # of the width of the cube that is shown
_MARGIN = 1.15  # of the cube around the robot
_DPI = 150
_BEND = (0.12, -0.1, 0.08)  # share of the axis range, by axis: a pose that shows every row


def robot_picture(robot: Robot) -> bytes:
    """PNG with two panels, lengths in mm: all axis angles zero, and another pose."""
    bent = bent_pose(robot)
    angles = ", ".join(f"{angle:.0f}" for angle in np.rad2deg(bent))
    poses = {"all axes at zero": np.zeros(robot.joints), f"axes at {angles} deg": bent}
    points = np.concatenate([corners(robot, frames_at(robot, axes)) for axes in poses.values()])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0)) * MM
    size = 0.5 * _MARGIN * float(np.ptp(points, axis=0).max()) * MM
    with matplotlib.rc_context({**FRAME, "font.size": 8.0}):
        figure = Figure(figsize=(11.0, 5.6), dpi=_DPI)
        for number, (title, axes) in enumerate(poses.items(), start=1):
            panel = figure.add_subplot(1, 2, number, projection="3d")
            _draw(panel, robot, axes, middle, size)
            panel.set_title(title, fontsize=8.0)
        figure.subplots_adjust(left=0.01, right=0.95, bottom=0.05, top=0.88, wspace=0.12)
        figure.suptitle(
            f"{robot.title}: DH rows; frames x red, y green, z blue; circles are joint axes",
            fontsize=9.0,
        )
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _draw(panel: Any, robot: Robot, axes: Array, middle: Array, size: float) -> None:
    """One pose; middle (3,), size : the cube that is shown, and half its width [mm]."""
    frames = frames_at(robot, axes)
    origins = frames.origin[:, :, 0] * MM
    panel.plot(*(corners(robot, frames) * MM).T, color=INK, lw=2.0, solid_capstyle="round")
    for axis, colour in ((frames.x, RED), (frames.y, GREEN), (frames.z, BLUE)):
        for origin, direction in zip(origins, axis[:, :, 0], strict=True):
            end = origin + 2.0 * size * _FRAME_SIZE * direction
            panel.plot(*np.stack((origin, end)).T, color=colour, lw=1.0)
    labels: dict[tuple[float, ...], list[str]] = {}  # axes of one origin have one label
    for i, origin in enumerate(origins[:-1]):
        labels.setdefault(tuple(np.round(origin, 1).tolist()), []).append(str(i + 1))
    for place, numbers in labels.items():
        panel.plot(*np.array(place)[:, None], "o", color=INK, ms=4.0, mfc="white")
        shift = np.array(place) + 0.06 * size
        panel.text(*shift, ", ".join(numbers), color=QUIET, fontsize=7.0)
    limits = np.stack((middle - size, middle + size))
    panel.set(xlim=limits[:, 0], ylim=limits[:, 1], zlim=limits[:, 2])
    panel.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    panel.set_box_aspect((1.0, 1.0, 1.0))
    panel.view_init(elev=20.0, azim=-60.0)


def frames_at(robot: Robot, axes: Array) -> Frames:
    """Frames of the rows at axis angles (J,) [rad] of the controller; flange last."""
    chain = nominal_chain(robot)
    return forward(chain, controller_to_joints(robot, axes)[None])


def corners(robot: Robot, frames: Frames) -> Array:
    """(2 J + 1, 3) [m] corners of the polyline in the base frame."""
    points = [frames.origin[0, :, 0]]
    for i in range(robot.joints):
        points.append(frames.origin[i, :, 0] + robot.d[i] * frames.z[i, :, 0])
        points.append(frames.origin[i + 1, :, 0])
    return np.array(points)


def bent_pose(robot: Robot) -> Array:
    """(J,) [rad] axis angles within the limits that differ from zero on every axis."""
    span = np.minimum(robot.axis_upper - robot.axis_lower, 2.0 * np.pi)
    shares = np.array([_BEND[i % len(_BEND)] for i in range(robot.joints)])
    zero = np.clip(0.0, robot.axis_lower, robot.axis_upper)
    return np.asarray(np.clip(zero + shares * span, robot.axis_lower, robot.axis_upper))
