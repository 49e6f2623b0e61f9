"""Path files and the reference path of a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from cell.arrays import Array
from cell.descriptions import Cell, Robot
from cell.errors import InputError
from cell.geometry import Geometry
from cell.logs import RobotLog
from cell.robot_angles import controller_to_joints
from cell.schema import Strict
from cell.strict_yaml import load_model
from sim.path import Lissajous, PushPull, ReferencePath, RodHarmonic, reference_path
from sim.recorded_path import recorded_path
from sim.settings import PathSettings, Position

PATH_STEP = 0.01  # [s] grid of the reference path; the command between is a cubic spline

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
    centre_deg: Vector5 = Field(description="Middle of each angle, b1 to b5.")
    amplitude_deg: Vector5 = Field(description="Largest deviation from the middle.")
    cycles: Whole5 = Field(description="Whole cycles of each angle in one run.")
    phase_deg: Vector5 = Field(description="Phase of each angle at the beginning.")
    rod: tuple[RodHarmonicFile, ...] = Field(
        (), description="Of an instrument's length about its nominal one; absent for a ball-bar."
    )
    first_axes_deg: tuple[float, ...] | None = Field(
        None,
        description="Axis angles of the robot at the beginning, which choose the configuration of "
        "the arm; absent for the first that keeps the axis ranges.",
    )
    ballbar_position_m: Position | None = Field(
        None, description="Position that the path was planned for; only `ballbar plan` reads it."
    )


class PushPullFile(Strict):
    """Path file of one pose of the ball-bar, and the travel of the command along the rod."""

    schema_: Annotated[Literal["ballbar-push/1"], Field(alias="schema")]
    angles_deg: Vector5 = Field(description="Of the ball-bar at the pose, b1 to b5.")
    travel_m: Annotated[float, Field(gt=0.0, le=0.1)] = Field(
        description="Largest distance of the command from the pose, along the rod."
    )
    cycles: Annotated[int, Field(gt=0)] = Field(description="Times of pull and push.")


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
        return recorded_path(
            cell.robot,
            nominal,
            recorded,
            duration=settings.duration_s,
            step=PATH_STEP,
            telescopes=cell.ballbar.stroke is not None,
        )
    file = relative_to / settings.file
    shape: Lissajous | PushPull
    beginning = None
    if settings.kind == "push_pull":
        shape = load_push_pull(file)
    else:
        content = load_model(file, LissajousFile)
        shape, beginning = lissajous(content), _beginning(content, cell.robot, file)
    if isinstance(shape, Lissajous) and shape.rod and cell.ballbar.stroke is None:
        raise InputError(
            f"{file}: the rod of {cell.ballbar.name} does not telescope. Leave out `rod`, or name "
            "an instrument (cell.instrument)."
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


def load_push_pull(path: Path) -> PushPull:
    """The pose and travel of a path file. Raises DescriptionError."""
    file = load_model(path, PushPullFile)
    return PushPull(held=np.radians(file.angles_deg), travel=file.travel_m, cycles=file.cycles)
