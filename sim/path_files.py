"""Path files and the reference path of a scenario.

A recorded path is the motion of a recorded robot as reference of another run (thesis sec. 3.1). The
nominal robot's tool at the logged angles lies near the sphere but not on it, since the robot is not
nominal and the angles are noisy. The ball-bar angles are therefore those of an ideal ball-bar that
holds the tool's pose, smoothed over time; the mechanism that takes them is on the sphere. Path,
timing and the distribution of samples are those of the real run to within its errors (steps 1, 2).
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.interpolate import CubicSpline

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import BAR_ROWS, Geometry, bar_frames, robot_frames
from ballbar.cell.inverse import bar_angles, refine
from ballbar.cell.logs import RobotLog
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.cell.schema import Strict
from ballbar.cell.splines import DEGREE, smoothing_spline
from ballbar.cell.strict_yaml import load_model
from ballbar.sim.path import (
    BRANCH,
    Lissajous,
    ReferencePath,
    RodHarmonic,
    axis_range_fault,
    check_speeds,
    reference_path,
)
from ballbar.sim.settings import PathSettings, Position

PATH_STEP = 0.01  # [s] grid of the reference path; the command between is a cubic spline
OFF_SPHERE = 0.020  # [m] ten times what an uncalibrated robot leaves (thesis sec. 5.4: 2 mm)
KNOT_SPACING = 0.1  # [s] keeps motion below 3 Hz, and a fifth of the noise of 4 ms rows

Vector5 = Annotated[tuple[float, ...], Field(min_length=5, max_length=5)]
Whole5 = Annotated[tuple[int, ...], Field(min_length=5, max_length=5)]


class RodHarmonicFile(Strict):
    """One harmonic of the length of a telescoping rod or a wire."""

    amplitude_m: Annotated[float, Field(gt=0.0, le=5.0)]
    cycles: Annotated[int, Field(gt=0)]
    phase_deg: float = 0.0


class LissajousFile(Strict):
    """Path file of five ball-bar angles: centre + amplitude * sin(2 pi cycles s + phase).

    The phase s runs from 0 to 1.
    """

    schema_: Annotated[Literal["ballbar-path/1"], Field(alias="schema")]
    centre_deg: Vector5
    """Middle of each angle, b1 to b5."""
    amplitude_deg: Vector5
    """Largest deviation from the middle."""
    cycles: Whole5
    """Whole cycles of each angle in one run."""
    phase_deg: Vector5
    """Phase of each angle at the beginning."""
    rod: tuple[RodHarmonicFile, ...] = ()
    """Harmonics of an instrument's length about its nominal one; absent for a ball-bar."""
    first_axes_deg: tuple[float, ...] | None = None
    """Axis angles of the robot at the beginning, which choose the configuration of the arm; absent
    for the first that keeps the axis ranges.
    """
    ballbar_position_m: Position | None = None
    """Position that the path was planned for; only `ballbar plan` reads it."""


class PushPullFile(Strict):
    """Path file of one pose of the ball-bar, and the travel of the command along the rod."""

    schema_: Annotated[Literal["ballbar-push/1"], Field(alias="schema")]
    angles_deg: Vector5
    """Angles of the ball-bar at the pose, b1 to b5."""
    travel_m: Annotated[float, Field(gt=0.0, le=0.1)]
    """Largest distance of the command from the pose, along the rod."""
    cycles: Annotated[int, Field(gt=0)]
    """Times of pull and push."""


def scenario_path(
    settings: PathSettings,
    cell: Cell,
    nominal: Geometry,
    *,
    relative_to: Path,
    recorded: RobotLog | None = None,
) -> ReferencePath:
    """The reference path of a scenario.

    relative_to : folder of the scenario, for the files that it names. recorded : the robot's log of
        path.recording, where there is one.

    Raises InputError when the mechanism cannot follow it, DescriptionError for a bad path file.
    """
    if settings.kind == "recorded":
        if recorded is None:
            raise InputError(
                f"path.recording = {settings.recording}: its robot log was not handed to the "
                "simulation. Take another path.kind, or run the scenario with `ballbar run`."
            )
        return _recorded_path(settings, cell, nominal, recorded)
    if not settings.file:
        raise InputError(
            "path.file: a lissajous path has no file here. `ballbar simulate` and `ballbar run` "
            "find one; elsewhere name a file, such as the path.yaml of `ballbar plan`."
        )
    file = relative_to / settings.file
    beginning = None
    if settings.kind == "push_pull":
        push = load_model(file, PushPullFile)
        shape = Lissajous(
            centre=np.radians(push.angles_deg),
            amplitude=np.zeros(5),
            cycles=np.full(5, push.cycles),
            phase=np.zeros(5),
            rod=(RodHarmonic(push.travel_m, push.cycles, 0.0),),
        )
    else:
        content = load_model(file, LissajousFile)
        shape, beginning = lissajous(content), _beginning(content, cell.robot, file)
        if shape.rod and cell.ballbar.stroke is None:
            raise InputError(
                f"{file}: the rod of {cell.ballbar.name} does not telescope. Leave out `rod`, or "
                "name an instrument (cell.instrument)."
            )
    return reference_path(
        cell.robot,
        nominal,
        shape,
        duration=settings.duration_s,
        dwell=settings.dwell_s,
        stops=settings.stops,
        step=PATH_STEP,
        beginning=beginning,
    )


def _beginning(content: LissajousFile, robot: Robot, file: Path) -> Array | None:
    """(J,) [rad] joint angles with which a path begins, where its file states them."""
    axes = content.first_axes_deg
    if axes is None:
        return None
    if len(axes) != robot.joints:
        raise InputError(
            f"{file}: first_axes_deg has {len(axes)} angles, robot {robot.name} has "
            f"{robot.joints} axes. Leave it out for another robot than the path was planned for."
        )
    return controller_to_joints(robot, np.radians(axes))


def load_lissajous(path: Path) -> Lissajous:
    """The shape of a path file. Raises DescriptionError."""
    return lissajous(load_model(path, LissajousFile))


def lissajous(file: LissajousFile) -> Lissajous:
    """The shape that a path file states, angles in radians."""
    return Lissajous(
        centre=np.radians(file.centre_deg),
        amplitude=np.radians(file.amplitude_deg),
        cycles=np.array(file.cycles, dtype=float),
        phase=np.radians(file.phase_deg),
        rod=tuple(
            RodHarmonic(h.amplitude_m, h.cycles, float(np.radians(h.phase_deg))) for h in file.rod
        ),
    )


def _recorded_path(
    settings: PathSettings, cell: Cell, nominal: Geometry, log: RobotLog
) -> ReferencePath:
    """The first seconds of a robot's log as a command.

    Raises InputError when the log is shorter, the tool is not on the ball-bar's sphere, or the
    motion exceeds an axis range or a speed limit.
    """
    duration, robot = settings.duration_s, cell.robot
    if duration > log.t[-1]:
        raise InputError(
            f"path.duration_s = {duration:g}: the recording's robot log lasts {log.t[-1]:.1f} s. "
            "Take no more than that."
        )
    poses = robot_frames(nominal, log.q).poses()
    off = np.linalg.norm(poses[:, :3, 3] - nominal.origin, axis=1) - nominal["bd3"]
    if cell.ballbar.stroke is None:
        k = int(np.abs(off).argmax())
        if abs(off[k]) > OFF_SPHERE:
            raise InputError(
                f"path.recording: at t = {log.t[k]:.1f} s the nominal tool is {off[k] * 1e3:+.0f} "
                "mm off the ball-bar's sphere. Were robot, ballbar, plate and ballbar_position_m "
                "those of the recording? Name those."
            )
        off = np.zeros_like(off)
    # The log does not determine the signs of b2 and b4. Stretches without rows carry no knots.
    angles = np.unwrap(bar_angles(poses, nominal.origin, flipped=BRANCH), axis=0)
    pieces = max(2, round((log.t[-1] - log.t[0]) / KNOT_SPACING))
    inner = np.linspace(log.t[0], log.t[-1], pieces + 1)[1:-1]
    smooth = smoothing_spline(log.t, np.column_stack((angles, off)), inner, rows=DEGREE + 1)
    t: Array = np.arange(round(duration / PATH_STEP) + 1, dtype=np.float64) * PATH_STEP
    b = np.asarray(smooth(np.minimum(t, log.t[-1])))
    logged = np.stack([np.interp(t, log.t, angle) for angle in log.q.T], axis=1)
    q = refine(nominal.robot, logged, bar_frames(nominal, b).poses())
    if fault := axis_range_fault(robot, t, q):
        raise InputError(f"path: {fault[1]}")
    speed = CubicSpline(t, q).derivative()(t)
    check_speeds(robot, t, speed)
    return ReferencePath(t, b[:, :BAR_ROWS], q, speed)
