"""A run as one rerun file: cells in motion, every signal over time, verdict as text, a layout.

Lengths in m in the 3D scene; other units stand in the entity names. The timeline `robot_time` is
seconds on the robot's clock from the first row of its log. Recordings that were fitted together
stand side by side, each below its own root, and start together. Still poses have a timeline of
their own (ballbar.replay.still_poses). Paths and roots: ballbar.replay.entities.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ballbar.replay.blueprint import Shown, layout
from ballbar.replay.entities import CELL, NOTES, SCENARIO, Branch, root_of
from ballbar.replay.events import log_events, recording_events
from ballbar.replay.notes import replay_notes, scenario_page
from ballbar.replay.parameters import log_parameters
from ballbar.replay.scene import log_coverage, log_poses, log_shapes, log_tool, log_truth
from ballbar.replay.series import Series, log_series, recording_series, truth_series
from ballbar.replay.still_poses import log_still_poses, still_layout
from ballbar.replay.true_tool import TrueTool, true_tool
from ballbar.report.motion import CellMotion, cell_motion
from ballbar.result.run_data import FittedRecording, RunData

# fixed: the viewer keeps one layout per application
APPLICATION, STILL_APPLICATION = "ballbar", "ballbar-poses"


@dataclass(frozen=True, eq=False)
class _Part:
    """One recording of a replay, ready to be sent."""

    fitted: FittedRecording
    name: str  # of its tab
    root: str
    motion: CellMotion
    truth: TrueTool | None
    series: dict[str, Series]


def write_replay(path: Path, run: RunData) -> None:
    """Write the replay of one run as an .rrd file, whole or not at all; folders are made."""
    view, log = _prepared(run)
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}.part")
    try:
        with _stream(run) as stream:
            stream.save(aside, default_blueprint=view)
            log(stream)
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


def send_replay(address: str, run: RunData) -> None:
    """Send the same to a viewer that is open."""
    view, log = _prepared(run)
    with _stream(run) as stream:
        stream.connect_grpc(address, default_blueprint=view)
        log(stream)


def recording_id(run: RunData) -> str:
    """The name of the run and a digest of logs and estimates: the same run, the same id."""
    digest, poses = hashlib.sha256(), run.identification.poses
    if poses is not None:
        digest.update(poses.table.q.tobytes())
    for fitted in run.recordings:
        log = fitted.recording.robot_log
        for values in (log.t, log.q, fitted.estimate.geometry.values):
            digest.update(values.tobytes())
    return f"{run.name}-{digest.hexdigest()[:12]}"


def _prepared(run: RunData) -> tuple[rrb.Blueprint, Callable[[rr.RecordingStream], None]]:
    """The layout of a replay, and what writes its content."""
    if not run.recordings:
        return still_layout(), partial(_log, run=run, parts=())
    parts = [_part(run, fitted) for fitted in run.recordings]
    return layout(_shown(run, parts)), partial(_log, run=run, parts=parts)


def _log(stream: rr.RecordingStream, run: RunData, parts: Sequence[_Part]) -> None:
    stream.send_recording_name(run.name)
    stream.log(NOTES, _page(replay_notes(run)), static=True)
    if not run.recordings:
        log_still_poses(stream, run)
        return
    robot = run.identification.robot
    log_parameters(stream, run)
    for part in parts:
        branch, geometry = Branch(stream, part.root), part.fitted.estimate.geometry
        branch.log(SCENARIO, _page(scenario_page(run, part.fitted)), static=True)
        branch.log(CELL, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log_shapes(branch, robot.cell, geometry, part.motion)
        log_poses(branch, part.motion)
        log_coverage(branch, part.motion, geometry)
        log_tool(branch, part.motion)
        if part.truth is not None:
            log_truth(branch, part.truth, part.motion.t, geometry)
        log_events(branch, recording_events(part.fitted, part.motion))
        for entity, series in part.series.items():
            log_series(branch, entity, series)


def _part(data: RunData, fitted: FittedRecording) -> _Part:
    motion, estimate, simulation = cell_motion(fitted), fitted.estimate, data.simulation
    series, truth = recording_series(fitted, motion, data.identification.robot), None
    if simulation is not None:
        truth = true_tool(simulation, estimate, motion.t)
        series |= truth_series(simulation, estimate, truth, motion.t)
    name = fitted.name if data.several else ""
    return _Part(
        fitted=fitted,
        name=name or "Run",
        root=root_of(name),
        motion=motion,
        truth=truth,
        series=series,
    )


def _shown(data: RunData, parts: Sequence[_Part]) -> list[Shown]:
    robot = data.identification.robot.cell.robot
    reach, views = float(np.abs(robot.d).sum() + np.abs(robot.a).sum()), []
    for part in parts:
        x, y, _ = part.fitted.estimate.geometry.origin
        plots = {
            entity: float(np.abs(series.values).max(initial=0.0))
            for entity, series in part.series.items()
        }
        views.append(
            Shown(
                name=part.name,
                root=part.root,
                plots=plots,
                duration=float(part.motion.t[-1]),
                middle=np.array([0.5 * x, 0.5 * y, 0.3 * reach]),
                reach=reach,
            )
        )
    return views


def _page(text: str) -> rr.TextDocument:
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


@contextmanager
def _stream(run: RunData) -> Iterator[rr.RecordingStream]:
    application = APPLICATION if run.recordings else STILL_APPLICATION
    # without properties: they would hold the time of writing, and make the files of one run differ
    stream = rr.RecordingStream(application, recording_id=recording_id(run), send_properties=False)
    try:
        with stream:
            yield stream
    finally:
        stream.disconnect()
