"""A run as one rerun file: the cell in motion, every signal over time, the verdict in words, and a layout that shows them.

Lengths in m in the 3D scene; other units stand in the entity names (rerun has no unit field). Two timelines: `robot_time`,
seconds on the robot's clock from the first row of its log, and `iteration`, of the identifier. The tree of entities is that of
ballbar.replay.entities.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ballbar.replay.coverage import coverage, log_coverage
from ballbar.replay.entities import CELL, NOTES, SCENARIO, layout
from ballbar.replay.events import log_events, run_events
from ballbar.replay.iterations import log_iterations
from ballbar.replay.motion import CellMotion, TrueTool, cell_motion, true_tool
from ballbar.replay.notes import replay_notes, scenario_page
from ballbar.replay.parameters import log_parameters
from ballbar.replay.scene import log_mechanism, log_tool, log_truth
from ballbar.replay.series import Series, log_series, run_series
from ballbar.replay.viewer import ViewerError, open_viewer, serve_web
from ballbar.result.run_data import RunData

__all__ = ["ViewerError", "open_viewer", "send_replay", "serve_web", "write_replay"]

APPLICATION = "ballbar"  # fixed: the viewer keeps one layout per application


@dataclass(frozen=True, eq=False)
class _Replay:
    """One run, ready to be sent somewhere."""

    data: RunData
    motion: CellMotion
    truth: TrueTool | None
    series: dict[str, Series]

    def blueprint(self) -> rrb.Blueprint:
        robot, origin = (
            self.data.identification.cell.robot,
            self.data.identification.geometry.origin,
        )
        reach = float(np.abs(robot.d).sum() + np.abs(robot.a).sum())
        looking_at = np.array([0.5 * origin[0], 0.5 * origin[1], 0.3 * reach])
        plots = {
            entity: float(np.abs(one.values).max(initial=0.0))
            for entity, one in self.series.items()
        }
        return layout(plots, duration=float(self.motion.t[-1]), looking_at=looking_at, reach=reach)

    def log(self, stream: rr.RecordingStream) -> None:
        data, motion, result = self.data, self.motion, self.data.identification
        stream.send_recording_name(data.name)
        for entity, page in ((NOTES, replay_notes(data)), (SCENARIO, scenario_page(data))):
            stream.log(entity, rr.TextDocument(page, media_type=rr.MediaType.MARKDOWN), static=True)
        stream.log(CELL, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log_mechanism(stream, result.cell, result.geometry, motion)
        log_coverage(
            stream,
            coverage(motion.t, motion.tool, result.geometry.origin),
            result.geometry.origin,
            result.geometry["bd3"],
        )
        log_tool(stream, motion)
        if self.truth is not None:
            log_truth(stream, self.truth, motion.t, result)
        log_events(stream, run_events(data, motion))
        log_parameters(stream, data)
        log_iterations(stream, data)
        for entity, one in self.series.items():
            log_series(stream, entity, one)


def write_replay(path: Path, data: RunData) -> None:
    """Writes the replay of one run as an .rrd file, whole or not at all. Folders are made as needed."""
    replay = _replay(data)
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}.part")
    try:
        with _stream(data) as stream:
            stream.save(aside, default_blueprint=replay.blueprint())
            replay.log(stream)
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


def send_replay(address: str, data: RunData) -> None:
    """The same to a viewer that is open."""
    replay = _replay(data)
    with _stream(data) as stream:
        stream.connect_grpc(address, default_blueprint=replay.blueprint())
        replay.log(stream)


def recording_id(data: RunData) -> str:
    """The name of the run and a digest of what was measured and found: the same run, the same id."""
    log = data.recording.robot_log
    digest = hashlib.sha256(
        log.t.tobytes() + log.q.tobytes() + data.identification.geometry.values.tobytes()
    )
    return f"{data.name}-{digest.hexdigest()[:12]}"


def _replay(data: RunData) -> _Replay:
    motion = cell_motion(data)
    truth = true_tool(data.simulation, data.identification, motion.t) if data.simulation else None
    return _Replay(data, motion, truth, run_series(data, motion, truth))


@contextmanager
def _stream(data: RunData) -> Iterator[rr.RecordingStream]:
    # without properties: they would hold the time of writing, and no two files of one run would be alike
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id(data), send_properties=False)
    try:
        with stream:
            yield stream
    finally:
        stream.disconnect()
