"""The identification as it converged: a second timeline, `iteration`.

Iteration 0 is the nominal robot, its ball-bar placed and its clock set as well as can be.

In the scene: the mismatch of the loop at samples of the run as arrows, one magnification throughout, so they shrink. As
curves, in powers of ten: size of the mismatch, cost, and how far the tool still is from where the final result puts it.
"""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ballbar.replay.entities import (
    COST,
    FROM_RESULT,
    FROM_TRUTH,
    GREEN,
    ITERATION,
    MISMATCH,
    MISMATCH_ANGLE,
    MISMATCH_POSITION,
    RED,
    STAGE,
    STEEL_GREY,
    Colour,
)
from ballbar.replay.motion import base_alignment, on_robot_clock
from ballbar.replay.scene import magnification
from ballbar.result.iterations import Step
from ballbar.result.run_data import RunData
from cell.arrays import Array
from cell.geometry import Geometry, robot_frames
from ident.robot.accuracy import accuracy_grid

ARROWS = 150
_LONGEST = 0.5  # of the rod: the mean arrow at the beginning
_SMALLEST = 1e-3  # [um, urad] what is drawn for less, as its logarithm


def log_iterations(stream: rr.RecordingStream, data: RunData) -> None:
    """Writes the timeline `iteration`; nothing where the iterations were not watched."""
    if not data.iterations:
        return
    result = data.identification
    states = [(result.before.t, result.before.position, result.before.angle)]
    states += [
        (s.iteration.times, s.iteration.error[:3].T, s.iteration.error[3:].T)
        for s in data.iterations
    ]
    rms = np.array([[_rms(position) * 1e6, _rms(angle) * 1e6] for _, position, angle in states])
    numbers = np.arange(len(states))
    _log_curve(stream, MISMATCH_POSITION, numbers, rms[:, 0], "position", RED)
    _log_curve(stream, MISMATCH_ANGLE, numbers, rms[:, 1], "angle", (242, 142, 43))
    _log_curve(
        stream,
        COST,
        numbers[1:],
        np.array([s.iteration.chi2_per_sample for s in data.iterations]),
        "chi-square",
        STEEL_GREY,
    )
    geometries = [result.nominal, *(s.iteration.geometry for s in data.iterations)]
    grid = accuracy_grid(result.cell.robot)
    _log_curve(
        stream,
        FROM_RESULT,
        numbers,
        _tool_distances(geometries, result.geometry, grid),
        "from the final result",
        GREEN,
    )
    if data.simulation is not None:
        distances = _tool_distances(geometries, data.simulation.truth.geometry, grid)
        _log_curve(stream, FROM_TRUTH, numbers, distances, "from the truth", (120, 165, 230))
    _log_arrows(stream, data, states)
    stages = [
        "the nominal robot, the ball-bar placed and the clock set as well as can be",
        *(s.stage for s in data.iterations),
    ]
    texts = [_page(i, len(states) - 1, stages[i], rms[i]) for i in range(len(states))]
    stream.log(STAGE, rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN), static=True)
    stream.send_columns(STAGE, indexes=_at(numbers), columns=rr.TextDocument.columns(text=texts))


def log_step(stream: rr.RecordingStream, number: int, step: Step) -> None:
    """One iteration while it is made, when neither the result nor the best magnification is known."""
    made = step.iteration
    rms = np.array([_rms(made.error[:3].T) * 1e6, _rms(made.error[3:].T) * 1e6])
    stream.set_time(ITERATION, sequence=number)
    stream.log(
        STAGE,
        rr.TextDocument(_page(number, None, step.stage, rms), media_type=rr.MediaType.MARKDOWN),
    )
    for entity, value in (
        (MISMATCH_POSITION, rms[0]),
        (MISMATCH_ANGLE, rms[1]),
        (COST, made.chi2_per_sample),
    ):
        stream.log(entity, rr.Scalars(np.log10(max(float(value), _SMALLEST))))
    stream.reset_time()


def _at(numbers: NDArray[np.int64]) -> list[rr.TimeColumn]:
    return [rr.TimeColumn(ITERATION, sequence=numbers)]


def _rms(values: Array) -> float:
    """Root mean square length of the rows."""
    return float(np.sqrt((values * values).sum(axis=1).mean()))


def _log_curve(
    stream: rr.RecordingStream,
    entity: str,
    numbers: NDArray[np.int64],
    values: Array,
    name: str,
    colour: Colour,
) -> None:
    stream.log(entity, rr.SeriesLines(names=[name], colors=[colour], widths=[2.5]), static=True)
    powers = np.log10(np.maximum(values, _SMALLEST))
    stream.send_columns(entity, indexes=_at(numbers), columns=rr.Scalars.columns(scalars=powers))


def _tool_distances(geometries: list[Geometry], reference: Geometry, grid: Array) -> Array:
    """(I,) [um] mean distance of the rigid robot's tool over joint angles grid (G, 6), base frames aligned."""
    actual = robot_frames(reference, grid).tip.T
    out = []
    for geometry in geometries:
        turn, shift = base_alignment(geometry, reference, grid)
        out.append(
            np.linalg.norm(
                robot_frames(geometry, grid).tip.T @ turn.T + shift - actual, axis=1
            ).mean()
            * 1e6
        )
    return np.array(out)


def _log_arrows(
    stream: rr.RecordingStream, data: RunData, states: list[tuple[Array, Array, Array]]
) -> None:
    """At the tool's place, which is drawn as identified: mismatches are too small to be seen otherwise."""
    result, log = data.identification, data.recording.robot_log
    length = result.geometry["bd3"]
    factor = magnification(_rms(states[0][1]), _LONGEST * length)
    stream.log(MISMATCH, rr.Arrows3D.from_fields(colors=[RED], radii=[0.006 * length]), static=True)
    feet, arrows = [], []
    for t, position, _ in states:
        rows = np.arange(0, t.size, max(1, t.size // ARROWS))
        q = np.stack(
            [np.interp(on_robot_clock(result, t[rows]), log.t, column) for column in log.q.T],
            axis=1,
        )
        feet.append(robot_frames(result.geometry, q).tip.T)
        arrows.append(factor * position[rows])
    columns = rr.Arrows3D.columns(origins=np.concatenate(feet), vectors=np.concatenate(arrows))
    each = columns.partition([len(one) for one in arrows])
    stream.send_columns(MISMATCH, indexes=_at(np.arange(len(states))), columns=each)
    place = result.geometry.origin + np.array([0.0, 0.0, 1.5 * length])
    label = f"mismatch of robot and ball-bar, arrows x {f'{factor:,}'.replace(',', ' ')}"
    legend = rr.Points3D([place], colors=[RED], radii=[0.01], labels=[label], show_labels=True)
    stream.log(f"{MISMATCH}/legend", legend, static=True)


def _page(number: int, last: int | None, stage: str, rms: Array) -> str:
    return (
        f"## Iteration {number}{f' of {last}' if last else ''}\n\n{stage}\n\n"
        f"Root mean square mismatch **{rms[0]:.3g} um**, **{rms[1]:.3g} urad**.\n\n"
        "Each solver that is started begins with its starting point; where only few samples or wider noise are taken, cost and "
        f"mismatch may rise from one stage to the next."
    )
