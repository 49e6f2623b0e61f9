"""Still poses as a rerun file: the arm at every pose, and the errors before and after as arrows.

The timeline `pose` counts the poses of all tables. The arm is drawn as the polygon of its DH rows,
as identified. At each pose an arrow, magnified, goes from where the model has the target to where
it was measured: for the nominal robot, with seats and targets fitted, and for the identified one.
Each seat has its own entity, so that one can be shown alone.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ballbar.replay.blueprint import blueprint
from ballbar.replay.colours import AFTER_COLOUR, BACKGROUND, BEFORE_COLOUR, STEEL, Colour
from ballbar.replay.entities import CELL, LEGEND, NOTES
from ballbar.replay.scene import log_legend, magnification, spaced
from ballbar.replay.shapes import PAINT
from ballbar.result.run_data import PoseRun
from ballbar.units import MM
from cell.arrays import Array
from cell.chain import Chain, Frames
from cell.foreign_text import markdown
from ident.estimator.fit import Fit
from ident.estimator.model import Evaluation

APPLICATION = "ballbar-poses"  # fixed: the viewer keeps one layout per application
POSE = "pose"  # timeline
ARM, SEATS, ERRORS = f"{CELL}/arm", f"{CELL}/seats", "/error_mm"
_DRAWN = 0.12  # of the robot's reach: length at which the mean error is drawn
_SPEED = 4.0  # poses a second
_KINDS: tuple[tuple[str, Colour, float], ...] = (
    ("nominal_robot", BEFORE_COLOUR, 1.15),
    ("identified_robot", AFTER_COLOUR, 1.05),
)


def write_pose_replay(path: Path, run: PoseRun) -> None:
    """Write the replay of an identification from still poses, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}.part")
    digest = hashlib.sha256(run.identification.table.q.tobytes()).hexdigest()[:12]
    name = f"{run.name}-{digest}"
    # without properties: they would hold the time of writing, and make the files of one run differ
    stream = rr.RecordingStream(APPLICATION, recording_id=name, send_properties=False)
    try:
        with stream:
            stream.save(aside, default_blueprint=_layout())
            _log(stream, run)
        stream.disconnect()
        aside.replace(path)
    finally:
        stream.disconnect()
        aside.unlink(missing_ok=True)


def skeleton(chain: Chain, frames: Frames) -> Array:
    """(N, 2 J + 2, 3) [m] corners of the arm: along d, then along a of every row, then the target.

    frames : of the robot, the last one that of the target.
    """
    corners = [frames.origin[0]]
    for row in range(chain.rows):
        corners.append(frames.origin[row] + chain.d[row] * frames.z[row])
        corners.append(frames.origin[row + 1])
    corners.append(frames.tip)
    return np.asarray(np.stack(corners).transpose(2, 0, 1))


def _log(stream: rr.RecordingStream, run: PoseRun) -> None:
    result = run.identification
    robot = result.table.robot
    reach = float(np.abs(robot.a).sum() + np.abs(robot.d).sum())
    stream.send_recording_name(run.name)
    stream.log(CELL, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log(NOTES, _notes(run), static=True)
    style = rr.LineStrips3D.from_fields(colors=[PAINT], radii=[0.02 * reach])
    stream.log(ARM, style, static=True)
    chain = result.fit.model.unknowns.bare(result.fit.x).robot
    first = 0
    for point in result.fit.linear.evaluations:
        index = _at(first, point)
        strips = skeleton(chain, point.target_closure.robot).astype(np.float32)
        stream.send_columns(ARM, indexes=index, columns=rr.LineStrips3D.columns(strips=strips))
        first += point.still.size
    fits = (result.nominal, result.fit)
    legends = [
        _log_errors(stream, kind, colour, height * reach, fit)
        for (kind, colour, height), fit in zip(_KINDS, fits, strict=True)
    ]
    log_legend(stream, legends)


def _log_errors(
    stream: rr.RecordingStream, kind: str, colour: Colour, height: float, fit: Fit
) -> str:
    """Arrows and curve of one model; height : [m] scale of the arrows. Returns their legend."""
    points = fit.linear.evaluations
    lengths = [np.linalg.norm(point.closure.error[:3], axis=0) for point in points]
    mean = float(np.concatenate(lengths).mean())
    factor = magnification(mean, _DRAWN * height)
    name = kind.replace("_", " ")
    text = f"{name}: mean error {mean * MM:.3f} mm, arrows drawn x {spaced(factor)}"
    stream.log(
        f"{ERRORS}/{kind}",
        rr.SeriesLines(colors=[colour], names=[kind.replace("_", " ")]),
        static=True,
    )
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
    return text


def _log_seat(stream: rr.RecordingStream, entity: str, point: Evaluation, size: float) -> None:
    """The seat, and all points that were measured from it."""
    seat = rr.Points3D([point.target_closure.seat.origin], colors=[STEEL], radii=[0.015 * size])
    stream.log(f"{entity}/seat", seat, static=True)
    measured = rr.Points3D(point.target_closure.sight.point.T, colors=[STEEL], radii=[0.003 * size])
    stream.log(f"{entity}/{rr.escape_entity_path_part(point.still.target)}", measured, static=True)


def _at(first: int, point: Evaluation) -> list[rr.TimeColumn]:
    return [rr.TimeColumn(POSE, sequence=np.arange(first, first + point.still.size))]


def _notes(run: PoseRun) -> rr.TextDocument:
    verdict = run.identification.verdict
    held_out = [outcome.sentence for _, _, outcome in run.held_out]
    warnings = [f"- {markdown(warning)}" for warning in verdict.warnings]
    texts = [markdown(text) for text in (run.name, verdict.sentence, *held_out)]
    lines = [f"# {texts[0]}", *texts[1:], *warnings]
    return rr.TextDocument("\n\n".join(lines), media_type=rr.MediaType.MARKDOWN)


def _layout() -> rrb.Blueprint:
    scene = rrb.Spatial3DView(
        origin=CELL, name="Robot at each pose, errors as arrows", background=BACKGROUND
    )
    errors = rrb.TimeSeriesView(
        origin=ERRORS, name="Error of each pose [mm]", plot_legend=rrb.Corner2D.RightTop
    )
    notes = rrb.TextDocumentView(origin=NOTES, name="Verdict")
    legend = rrb.TextDocumentView(origin=LEGEND, name="Arrows")
    right = rrb.Vertical(errors, legend, notes, row_shares=[6, 1, 4])
    return blueprint(rrb.Horizontal(scene, right, column_shares=[3, 2]), POSE, speed=_SPEED)
