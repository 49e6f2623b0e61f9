"""A run as one rerun file: the cell in motion, every signal over time, the verdict in words, and a layout that shows them.

Lengths in m in the 3D scene; other units stand in the entity names (rerun has no unit field). One timeline, `robot_time`:
seconds on the robot's clock from the first row of its log. The tree of entities is that of ballbar.replay_layout.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ballbar.replay_layout import (
    AFTER,
    ANGLE,
    BAR_BODIES,
    BEFORE,
    CELL,
    ENCODERS,
    FORCE,
    IDENTIFIED_ERROR,
    JOINTS,
    NOMINAL_ERROR,
    NOTES,
    PATH_SO_FAR,
    POSITION,
    TCP_AFTER,
    TCP_BEFORE,
    TIMELINE,
    layout,
)
from ballbar.replay_motion import CellMotion, TrueTool, cell_motion, mechanism_angles, on_robot_clock, quat_xyzw, thinning, true_tool
from ballbar.replay_notes import replay_notes
from ballbar.replay_shapes import STEEL, Colour, Mesh, ball, bar_shapes, plate_shape, robot_shapes
from ballbar.replay_viewer import ViewerError, open_viewer, serve_web
from ballbar.run_data import RunData
from cell.chain import Array, Frames
from ident.identify import Identification, Residuals

__all__ = ["ViewerError", "open_viewer", "serve_web", "write_replay"]

APPLICATION = "ballbar"  # fixed: the viewer keeps one layout per application

RED, GREEN = (225, 87, 76), (87, 190, 122)  # before, after
_REDS = [(225, 87, 76), (242, 142, 43), (214, 120, 160)]
_GREENS = [(87, 190, 122), (118, 183, 178), (170, 205, 90)]
_SERIES = [(78, 121, 167), (242, 142, 43), (225, 87, 76), (118, 183, 178), (89, 161, 79), (237, 201, 72)]  # one colour a joint
_SPHERE, _SPHERE_OPACITY = (120, 165, 230), 20  # of 255
_WHOLE_PATH, _RUN_PATH = (120, 128, 142), (245, 200, 80)
_ARROW_LENGTH = 0.7  # of the rod: how long the mean error is drawn


def write_replay(path: Path, data: RunData) -> None:
    """Writes the replay of one run as an .rrd file, whole or not at all. Folders are made as needed."""
    motion = cell_motion(data)
    truth = true_tool(data.simulation, data.identification, motion.t) if data.simulation else None
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}.part")
    try:
        _write(aside, data, motion, truth)
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


def recording_id(data: RunData) -> str:
    """The name of the run and a digest of what was measured and found: the same run, the same id."""
    log = data.recording.robot_log
    digest = hashlib.sha256(log.t.tobytes() + log.q.tobytes() + data.identification.geometry.values.tobytes())
    return f"{data.name}-{digest.hexdigest()[:12]}"


def _write(path: Path, data: RunData, motion: CellMotion, truth: TrueTool | None) -> None:
    series = _series(data, motion, truth)
    robot, origin = data.identification.cell.robot, data.identification.geometry.origin
    reach = float(np.abs(robot.d).sum() + np.abs(robot.a).sum())
    looking_at = np.array([0.5 * origin[0], 0.5 * origin[1], 0.3 * reach])
    plots = {entity: float(np.abs(one.values).max()) for entity, one in series.items()}
    blueprint = layout(plots, duration=float(motion.t[-1]), looking_at=looking_at, reach=reach)
    # without properties: they would hold the time of writing, and no two files of one run would be alike
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id(data), send_properties=False)
    try:
        with stream:
            stream.save(path, default_blueprint=blueprint)
            stream.send_recording_name(data.name)
            stream.log(NOTES, rr.TextDocument(replay_notes(data), media_type=rr.MediaType.MARKDOWN), static=True)
            stream.log(CELL, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            _log_mechanism(stream, data, motion)
            _log_tool(stream, motion)
            if truth is not None:
                _log_truth(stream, truth, motion.t, data.identification)
            for entity, one in series.items():
                _log_series(stream, entity, one)
    finally:
        stream.disconnect()


@dataclass(frozen=True, eq=False)
class _Series:
    """Curves of one plot."""

    t: Array  # (N,) [s] robot's clock
    values: Array  # (N, C), unit as in the entity's name
    names: Sequence[str]  # (C,) as the legend shows them
    colours: Sequence[Colour]  # (C,)


def _series(data: RunData, motion: CellMotion, truth: TrueTool | None) -> dict[str, _Series]:
    """Every plot of the run, by entity."""
    result, log = data.identification, data.recording.ballbar_log
    series = {JOINTS: _Series(motion.t, np.degrees(motion.q), [f"q{i}" for i in range(1, 7)], _SERIES)}
    if log is not None:
        rows = np.arange(0, log.t.size, thinning(log.t))
        angles = np.degrees(mechanism_angles(result, log)[rows])
        colours = [_SERIES[joint - 1] for joint in log.joints]
        series[ENCODERS] = _Series(on_robot_clock(result, log.t[rows]), angles, [f"b{joint}" for joint in log.joints], colours)
    series |= _residual_series(BEFORE, "before", on_robot_clock(result, result.before.t), result.before, _REDS)
    series |= _residual_series(AFTER, "after", on_robot_clock(result, result.after.t), result.after, _GREENS)
    return series if truth is None else series | _truth_series(truth, motion.t)


def _residual_series(entity: str, when: str, t: Array, residuals: Residuals, colours: list[Colour]) -> dict[str, _Series]:
    names = [f"{axis} {when}" for axis in "xyz"]
    return {
        f"{entity}/{POSITION}": _Series(t, residuals.position * 1e6, names, colours),
        f"{entity}/{ANGLE}": _Series(t, residuals.angle * 1e6, names, colours),
    }


def _truth_series(truth: TrueTool, t: Array) -> dict[str, _Series]:
    before, after = (np.linalg.norm(error, axis=1)[:, None] * 1e6 for error in (truth.nominal_error, truth.identified_error))
    series = {TCP_BEFORE: _Series(t, before, ["nominal"], [RED]), TCP_AFTER: _Series(t, after, ["identified"], [GREEN])}
    if truth.rod_force.any():  # a kinematic plant knows no forces
        series[FORCE] = _Series(t, truth.rod_force[:, None], ["rod force"], [_SERIES[0]])
    return series


def _log_series(stream: rr.RecordingStream, entity: str, one: _Series) -> None:
    # zoomed out, the viewer would draw averages by itself, and a single bad sample would not be seen
    style = rr.SeriesLines(names=one.names, colors=one.colours, aggregation_policy="MinMax")
    stream.log(entity, style, static=True)
    stream.send_columns(entity, indexes=_at(one.t), columns=rr.Scalars.columns(scalars=one.values))


def _log_mechanism(stream: rr.RecordingStream, data: RunData, motion: CellMotion) -> None:
    result = data.identification
    for i, shape in enumerate(robot_shapes(result.cell)):
        _log_body(stream, f"{CELL}/robot/{f'link{i}' if i else 'base'}", shape, motion.t, motion.robot, i)
    _log_body(stream, f"{CELL}/plate", plate_shape(result.cell), motion.t, motion.robot, 6)
    for i, shape in enumerate(bar_shapes(result.cell, result.geometry)):
        _log_body(stream, f"{CELL}/ballbar/{BAR_BODIES[i]}", shape, motion.t, motion.bar, i)
    radius, centre = result.geometry["bd3"], result.geometry.origin
    stream.log(f"{CELL}/sphere", _mesh(ball(centre, radius, _SPHERE), opacity=_SPHERE_OPACITY), static=True)


def _log_body(stream: rr.RecordingStream, entity: str, shape: Mesh, t: Array, frames: Frames, row: int) -> None:
    """A shape that moves with one frame of a chain; frame 0 stands still."""
    stream.log(f"{entity}/shape", _mesh(shape), static=True)
    places, turns = frames.origin[row].T, quat_xyzw(frames.rotation(row))
    if row == 0:
        stream.log(entity, rr.Transform3D(translation=places[0], quaternion=rr.Quaternion(xyzw=turns[0])), static=True)
    else:
        stream.send_columns(entity, indexes=_at(t), columns=rr.Transform3D.columns(translation=places, quaternion=turns))


def _mesh(shape: Mesh, *, opacity: int = 255) -> rr.Mesh3D:
    return rr.Mesh3D(
        vertex_positions=shape.vertices,
        vertex_normals=shape.normals,
        triangle_indices=shape.triangles,
        vertex_colors=shape.colours,
        albedo_factor=(255, 255, 255, opacity),
    )


def _log_tool(stream: rr.RecordingStream, motion: CellMotion) -> None:
    """The whole path, thin; the part already run as one short strip a row, which the view gathers up to the time shown."""
    tool = motion.tool
    stream.log(f"{CELL}/tool/path", rr.LineStrips3D([tool], colors=[_WHOLE_PATH], radii=[-1.0]), static=True)
    stream.log(PATH_SO_FAR, rr.LineStrips3D.from_fields(colors=[_RUN_PATH], radii=[-2.0]), static=True)
    steps = np.stack((tool[:-1], tool[1:]), axis=1).astype(np.float32)  # the viewer's own precision, 0.1 um at 1 m
    stream.send_columns(PATH_SO_FAR, indexes=_at(motion.t[1:]), columns=rr.LineStrips3D.columns(strips=steps))
    _log_point(stream, f"{CELL}/tool/identified_position", tool, motion.t, radius=0.02, colour=GREEN)


def _log_point(stream: rr.RecordingStream, entity: str, places: Array, t: Array, *, radius: float, colour: Colour) -> None:
    stream.log(entity, rr.Points3D.from_fields(colors=[colour], radii=[radius]), static=True)
    stream.send_columns(entity, indexes=_at(t), columns=rr.Points3D.columns(positions=places))


def _log_truth(stream: rr.RecordingStream, truth: TrueTool, t: Array, result: Identification) -> None:
    """True tool position, and from there to where each robot's model believes it, magnified to be seen; a legend above the sphere."""
    _log_point(stream, f"{CELL}/tool/true_position", truth.position, t, radius=0.016, colour=STEEL)
    length, centre = result.geometry["bd3"], result.geometry.origin
    for entity, name, error, colour, height in (
        (NOMINAL_ERROR, "nominal robot", truth.nominal_error, RED, 1.65),
        (IDENTIFIED_ERROR, "identified robot", truth.identified_error, GREEN, 1.5),
    ):
        mean = float(np.linalg.norm(error, axis=1).mean())
        factor = magnification(mean, _ARROW_LENGTH * length)
        stream.log(entity, rr.Arrows3D.from_fields(colors=[colour], radii=[0.015 * length]), static=True)
        stream.send_columns(entity, indexes=_at(t), columns=rr.Arrows3D.columns(origins=truth.position, vectors=factor * error))
        label = f"{name}: tool {_metres(mean)} off along the path, arrow x {f'{factor:,}'.replace(',', ' ')}"
        place = centre + np.array([0.0, 0.0, height * length])
        stream.log(f"{entity}/legend", rr.Points3D([place], colors=[colour], radii=[0.01], labels=[label], show_labels=True), static=True)


def magnification(error: float, drawn: float) -> int:
    """A factor of the row 1, 2, 5, 10, ... that draws an error [m] at most `drawn` [m] long."""
    if error <= 0.0 or drawn <= error:
        return 1
    decade = 10 ** int(np.floor(np.log10(drawn / error)))
    return int(decade * max(step for step in (1, 2, 5) if step * decade * error <= drawn or step == 1))


def _metres(length: float) -> str:
    return f"{length * 1e3:.2f} mm" if length >= 1e-4 else f"{length * 1e6:.1f} um"


def _at(t: NDArray[np.float64]) -> list[rr.TimeColumn]:
    return [rr.TimeColumn(TIMELINE, duration=t)]
