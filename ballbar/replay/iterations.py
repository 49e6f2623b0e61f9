"""The identification as it converges: a second timeline, `iteration`.

Iteration 0 is the nominal robot, its ball-bar placed and its clock set as well as possible. An
iteration reports the loop-closure error of one recording, the first of the fit.

In the scene: that error at samples of the run as arrows, with one magnification, so that they
shrink. As curves, in powers of ten: its size, the cost, and the distance of the tool from where the
final result puts it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ballbar.replay.colours import AFTER_COLOUR, BEFORE_COLOUR, LINES, STEEL, TRUE_COLOUR, Colour
from ballbar.replay.entities import (
    CLOSURE_ANGLE,
    CLOSURE_ERROR,
    CLOSURE_POSITION,
    COST,
    ITERATION,
    STAGE,
    TOOL_FROM_RESULT,
    TOOL_FROM_TRUTH,
    Branch,
)
from ballbar.replay.motion import base_alignment, cell_motion, logged_joints, rms_norm
from ballbar.replay.scene import log_poses, magnification, spaced
from ballbar.result.iterations import Step
from ballbar.result.run_data import FittedRecording, RunData
from ballbar.units import UM, URAD
from cell.arrays import Array
from cell.foreign_text import markdown
from cell.geometry import Geometry, robot_frames
from cell.number_text import significant_text
from ident.robot.accuracy import accuracy_grid

ARROWS = 150
_LONGEST = 0.5  # of the rod: length of the mean arrow at the beginning
_SMALLEST = 1e-3  # [um, urad] drawn for smaller values, as its logarithm


@dataclass(frozen=True, eq=False)
class _State:
    """Loop-closure error at one iteration."""

    t: Array  # (N,) [s] on the ball-bar's clock
    position: Array  # (N, 3) [m]
    angle: Array  # (N, 3) [rad]

    @property
    def rms(self) -> tuple[float, float]:
        """[um], [urad] of the norms."""
        return rms_norm(self.position) * UM, rms_norm(self.angle) * URAD


def _state(step: Step) -> _State:
    iteration = step.iteration
    return _State(iteration.times, iteration.error[:3].T, iteration.error[3:].T)


def log_iterations(stream: Branch, data: RunData) -> None:
    """Writes the timeline `iteration`; nothing where the iterations were not recorded.

    stream : the branch of the first recording.
    """
    if not data.iterations:
        return
    fitted, steps = data.recordings[0], data.iterations  # the recording that an iteration reports
    estimate, before = fitted.estimate, fitted.estimate.before
    states = [_State(before.t, before.position, before.angle), *map(_state, steps)]
    rms = np.array([state.rms for state in states])  # (I + 1, 2)
    _log_curve(stream, CLOSURE_POSITION, rms[:, 0], "position", BEFORE_COLOUR)
    _log_curve(stream, CLOSURE_ANGLE, rms[:, 1], "angle", LINES[3])
    cost = np.array([step.iteration.chi2_per_sample for step in steps])
    _log_curve(stream, COST, cost, "chi-square", STEEL, first=1)
    geometries = [estimate.nominal, *(step.iteration.geometry for step in steps)]
    grid = accuracy_grid(data.identification.robot.cell.robot)
    distances = _tool_distances(geometries, estimate.geometry, grid)
    _log_curve(stream, TOOL_FROM_RESULT, distances, "from the final result", AFTER_COLOUR)
    if data.simulation is not None:
        distances = _tool_distances(geometries, data.simulation.truth.geometry, grid)
        _log_curve(stream, TOOL_FROM_TRUTH, distances, "from the truth", TRUE_COLOUR)
    factor = _log_arrows(stream, fitted, states)
    still = cell_motion(fitted, rows=np.array([fitted.recording.robot_log.t.size // 2]))
    log_poses(stream, still, _at(np.zeros(1, dtype=np.int64)))  # the arm, in the middle of the run
    begin = "the nominal robot, the ball-bar placed and the clock set as well as possible"
    stages, last = [begin, *(step.stage for step in steps)], len(steps)
    name = f" of {markdown(fitted.name)}" if data.several else ""
    counted = data.identification.fit.iterations
    pages = [
        _page(i, stages[i], states[i], last=last, counted=counted, name=name, factor=factor)
        for i in range(len(states))
    ]
    stream.log(STAGE, rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN), static=True)
    columns = rr.TextDocument.columns(text=pages)
    stream.send_columns(STAGE, indexes=_at(np.arange(len(states))), columns=columns)


def log_step(stream: rr.RecordingStream, number: int, step: Step) -> None:
    """One iteration while it is made, when neither result nor the best magnification is known."""
    state = _state(step)
    stream.set_time(ITERATION, sequence=number)
    page = rr.TextDocument(_page(number, step.stage, state), media_type=rr.MediaType.MARKDOWN)
    stream.log(STAGE, page)
    position, angle = state.rms
    values = (position, angle, step.iteration.chi2_per_sample)
    for entity, value in zip((CLOSURE_POSITION, CLOSURE_ANGLE, COST), values, strict=True):
        stream.log(entity, rr.Scalars(np.log10(max(value, _SMALLEST))))
    stream.reset_time()


def _at(numbers: NDArray[np.int64]) -> list[rr.TimeColumn]:
    return [rr.TimeColumn(ITERATION, sequence=numbers)]


def _log_curve(
    stream: Branch, entity: str, values: Array, name: str, colour: Colour, first: int = 0
) -> None:
    """A curve of values (I,) in powers of ten; first : number of its first iteration."""
    stream.log(entity, rr.SeriesLines(names=[name], colors=[colour], widths=[2.5]), static=True)
    columns = rr.Scalars.columns(scalars=np.log10(np.maximum(values, _SMALLEST)))
    numbers = np.arange(first, first + values.size)
    stream.send_columns(entity, indexes=_at(numbers), columns=columns)


def _tool_distances(geometries: Sequence[Geometry], reference: Geometry, grid: Array) -> Array:
    """(I,) [um] mean distance of the rigid robot's tool over joint angles grid (G, 6) [rad].

    Base frames aligned.
    """
    actual, distances = robot_frames(reference, grid).tip.T, []
    for geometry in geometries:
        rotation, shift = base_alignment(geometry, reference, grid)
        tool = robot_frames(geometry, grid).tip.T @ rotation.T + shift
        distances.append(np.linalg.norm(tool - actual, axis=1).mean() * UM)
    return np.array(distances)


def _log_arrows(stream: Branch, fitted: FittedRecording, states: Sequence[_State]) -> int:
    """At the identified tool position, magnified: the factor, with which they can be seen."""
    geometry = fitted.estimate.geometry
    length = geometry["bd3"]
    factor = magnification(rms_norm(states[0].position), _LONGEST * length)
    style = rr.Arrows3D.from_fields(colors=[BEFORE_COLOUR], radii=[0.006 * length])
    stream.log(CLOSURE_ERROR, style, static=True)
    feet, arrows = [], []
    for state in states:
        rows = np.arange(0, state.t.size, max(1, state.t.size // ARROWS))
        feet.append(robot_frames(geometry, logged_joints(fitted, state.t[rows])).tip.T)
        arrows.append(factor * state.position[rows])
    columns = rr.Arrows3D.columns(origins=np.concatenate(feet), vectors=np.concatenate(arrows))
    partitioned = columns.partition([len(vectors) for vectors in arrows])
    stream.send_columns(CLOSURE_ERROR, indexes=_at(np.arange(len(states))), columns=partitioned)
    return factor


def _page(
    number: int,
    stage: str,
    state: _State,
    *,
    last: int | None = None,
    counted: int | None = None,
    name: str = "",
    factor: int | None = None,
) -> str:
    """The text of an iteration.

    last : number of the last one. counted : how many the result counts. name : ` of NAME`, where
    there are several recordings. factor : by which the arrows are magnified.
    """
    position, angle = state.rms
    discarded = (
        f"The result counts {counted} iterations; the others are of fits that were discarded.\n\n"
        if counted != last
        else ""
    )
    return (
        f"## Iteration {number}{f' of {last}' if last else ''}\n\n{stage}\n\n"
        f"Loop-closure error{name}, rms: **{significant_text(position)} um**, "
        f"**{significant_text(angle)} urad**."
        f"{f' Arrows are drawn x {spaced(factor)}.' if factor else ''}\n\n"
        f"{discarded}Where a stage takes fewer samples or a larger noise, cost and error may rise "
        "from one stage to the next."
    )
