"""Still poses in a replay: the arm at every pose, and the errors before and after as arrows.

The timeline `pose` counts the poses of all tables. At each pose an arrow, magnified, goes from
where the model has the target to where it was measured: for the nominal robot, with seats and
targets fitted, and for the identified one. Each seat has its own entity, so that one can be shown
alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ballbar.replay.entities import CELL, LEGEND, NOTES, POSE, Branch
from ballbar.replay.scene import log_body, log_frame, log_legend, magnification, spaced
from ballbar.replay.window import blueprint
from ballbar.report.colours import AFTER_COLOUR, BACKGROUND, BEFORE_COLOUR, STEEL, Colour
from ballbar.report.shapes import robot_bodies
from ballbar.result.run_data import RunData
from ballbar.units import MM

if TYPE_CHECKING:  # a replay of recordings does without still poses
    from ballbar.cell.poses import PoseGroup
    from ballbar.ident.estimator.fit import Fit
    from ballbar.ident.estimator.model import Evaluation

ARM, SEATS, ERRORS = f"{CELL}/robot", f"{CELL}/seats", "/error_mm"
_DRAWN = 0.12  # of the robot's reach: length at which the mean error is drawn
_SPEED = 4.0  # poses a second
_KINDS: tuple[tuple[str, Colour, float], ...] = (
    ("nominal_robot", BEFORE_COLOUR, 1.15),
    ("identified_robot", AFTER_COLOUR, 1.05),
)


def log_still_poses(stream: rr.RecordingStream, run: RunData) -> None:
    """Arm, arrows and curves of an identification from still poses."""
    result, robot = run.identification.poses, run.identification.robot.robot
    if result is None:
        return
    reach = float(np.abs(robot.a).sum() + np.abs(robot.d).sum())
    stream.log(CELL, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    _log_arm(Branch(stream), result.fit, 0.012 * reach)
    fits = (result.nominal, result.fit)
    legends = [
        _log_errors(stream, kind, colour, height * reach, fit)
        for (kind, colour, height), fit in zip(_KINDS, fits, strict=True)
    ]
    log_legend(stream, legends)


def still_layout(groups: Sequence[PoseGroup]) -> rrb.Blueprint:
    """Left the robot at each pose, right its errors, the arrows' meaning and the verdict.

    The poses of a robot that moved are shown as fast as they were measured.
    """
    moving = [1.0 / np.median(np.diff(g.time)) for g in groups if g.motion and g.time is not None]
    speed = max([_SPEED, *map(float, moving)])
    scene = rrb.Spatial3DView(
        origin=CELL, name="Robot at each pose, errors as arrows", background=BACKGROUND
    )
    errors = rrb.TimeSeriesView(
        origin=ERRORS, name="Error of each pose [mm]", plot_legend=rrb.Corner2D.RightTop
    )
    notes = rrb.TextDocumentView(origin=NOTES, name="Verdict")
    legend = rrb.TextDocumentView(origin=LEGEND, name="Arrows")
    right = rrb.Vertical(errors, legend, notes, row_shares=[6, 1, 4])
    return blueprint(rrb.Horizontal(scene, right, column_shares=[3, 2]), POSE, speed=speed)


def _log_arm(stream: Branch, fit: Fit, radius: float) -> None:
    """The identified arm at every pose; radius : [m] of the bar from the last joint to a target."""
    chain = fit.model.unknowns.bare(fit.x).robot
    bodies = robot_bodies(chain)[:-1]  # the last link ends at a target
    names = [f"{ARM}/base", *(f"{ARM}/link{i}" for i in range(1, len(bodies)))]
    for name, body in zip(names, bodies, strict=True):
        log_body(stream, name, body)
    style = rr.LineStrips3D.from_fields(colors=[STEEL], radii=[radius])
    stream.log(f"{ARM}/target", style, static=True)
    first = 0
    for point in fit.linear.evaluations:
        index, frames = _at(first, point), point.target_closure.robot
        for row, name in enumerate(names):
            log_frame(stream, name, frames, row, index)
        strips = np.stack((frames.origin[-2].T, frames.tip.T), axis=1).astype(np.float32)
        columns = rr.LineStrips3D.columns(strips=strips)
        stream.send_columns(f"{ARM}/target", indexes=index, columns=columns)
        first += point.still.size


def _log_errors(
    stream: rr.RecordingStream, kind: str, colour: Colour, height: float, fit: Fit
) -> str:
    """Arrows and curve of one model; height : [m] scale of the arrows. Returns their legend."""
    points = fit.linear.evaluations
    lengths = [np.linalg.norm(point.closure.error[:3], axis=0) for point in points]
    mean = float(np.concatenate(lengths).mean())
    factor, name = magnification(mean, _DRAWN * height), kind.replace("_", " ")
    style = rr.SeriesLines(colors=[colour], names=[name])
    stream.log(f"{ERRORS}/{kind}", style, static=True)
    styled: set[str] = set()
    first = 0
    for point, length in zip(points, lengths, strict=True):
        index = _at(first, point)
        first += point.still.size
        entity = f"{SEATS}/{rr.escape_entity_path_part(point.still.seat)}/{kind}"
        if entity not in styled:
            styled.add(entity)
            arrows = rr.Arrows3D.from_fields(colors=[colour], radii=[0.004 * height])
            stream.log(entity, arrows, static=True)
            _log_seat(stream, entity.rpartition("/")[0], point, height)
        origins, vectors = point.target_closure.robot.tip.T, factor * point.closure.error[:3].T
        columns = rr.Arrows3D.columns(origins=origins, vectors=vectors)
        stream.send_columns(entity, indexes=index, columns=columns)
        curve = rr.Scalars.columns(scalars=length * MM)
        stream.send_columns(f"{ERRORS}/{kind}", indexes=index, columns=curve)
    return f"{name}: mean error {mean * MM:.3f} mm, arrows drawn x {spaced(factor)}"


def _log_seat(stream: rr.RecordingStream, entity: str, point: Evaluation, size: float) -> None:
    """The seat, and all points that were measured from it."""
    seat = rr.Points3D([point.target_closure.seat.origin], colors=[STEEL], radii=[0.015 * size])
    stream.log(f"{entity}/seat", seat, static=True)
    measured = rr.Points3D(point.target_closure.sight.point.T, colors=[STEEL], radii=[0.003 * size])
    stream.log(f"{entity}/{rr.escape_entity_path_part(point.still.target)}", measured, static=True)


def _at(first: int, point: Evaluation) -> list[rr.TimeColumn]:
    return [rr.TimeColumn(POSE, sequence=np.arange(first, first + point.still.size))]
