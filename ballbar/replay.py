"""A run as one rerun file: the cell in motion, every signal over time, the verdict in words, and a layout that shows them.

Lengths in m in the 3D scene; other units stand in the entity names (rerun has no unit field). One timeline, `robot_time`:
seconds on the robot's clock from the first row of its log. The tree of entities is that of ballbar.replay_layout.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr

from ballbar.replay_coverage import coverage, log_coverage
from ballbar.replay_events import log_events, run_events
from ballbar.replay_iterations import log_iterations
from ballbar.replay_layout import CELL, NOTES, SCENARIO, layout
from ballbar.replay_motion import CellMotion, TrueTool, cell_motion, true_tool
from ballbar.replay_notes import replay_notes, scenario_page
from ballbar.replay_parameters import log_parameters
from ballbar.replay_scene import log_mechanism, log_tool, log_truth
from ballbar.replay_series import log_series, run_series
from ballbar.replay_viewer import ViewerError, open_viewer, serve_web
from ballbar.run_data import RunData

__all__ = ["ViewerError", "open_viewer", "serve_web", "write_replay"]

APPLICATION = "ballbar"  # fixed: the viewer keeps one layout per application


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
    series = run_series(data, motion, truth)
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
            stream.log(SCENARIO, rr.TextDocument(scenario_page(data), media_type=rr.MediaType.MARKDOWN), static=True)
            log_mechanism(stream, data.identification, motion)
            log_coverage(stream, coverage(motion.t, motion.tool, origin), origin, data.identification.geometry["bd3"])
            log_events(stream, run_events(data, motion))
            log_parameters(stream, data)
            log_iterations(stream, data)
            log_tool(stream, motion)
            if truth is not None:
                log_truth(stream, truth, motion.t, data.identification)
            for entity, one in series.items():
                log_series(stream, entity, one)
    finally:
        stream.disconnect()
