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
from functools import partial
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import yaml

from ballbar.acquisition.report import report_lines
from ballbar.cell.files import written_whole
from ballbar.replay.blueprint import Shown, layout
from ballbar.replay.entities import CELL, NOTES, SCENARIO, Branch, root_of
from ballbar.replay.events import log_events, recording_events
from ballbar.replay.parameters import log_parameters
from ballbar.replay.scene import log_coverage, log_poses, log_shapes, log_tool, log_truth
from ballbar.replay.series import log_series, recording_series, true_tool, truth_series
from ballbar.replay.still_poses import log_still_poses, still_layout
from ballbar.report.motion import cell_motion
from ballbar.report.numbers import with_and_without
from ballbar.report.parameters import left_at_nominal, parameter_groups
from ballbar.report.recording import overview
from ballbar.report.section import template
from ballbar.report.summary import summary
from ballbar.report.tcp_view import tcp_view
from ballbar.result.run_data import FittedRecording, RunData

# fixed: the viewer keeps one layout per application
APPLICATION, STILL_APPLICATION = "ballbar", "ballbar-poses"


Log = Callable[[rr.RecordingStream], None]


def write_replay(path: Path, run: RunData) -> None:
    """Write the replay of one run as an .rrd file, whole or not at all; folders are made."""
    view, log = _prepared(run)
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as aside, _stream(run) as stream:
        stream.save(aside, default_blueprint=view)
        log(stream)


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


def _prepared(run: RunData) -> tuple[rrb.Blueprint, Log]:
    """The layout of a replay, and what writes its content."""
    poses = run.identification.poses
    if not run.recordings and poses is not None:
        view = still_layout(poses.table.groups)
        return view, partial(_log, run=run, logs=[partial(log_still_poses, run=run)])
    shown, logs = zip(*(_prepared_recording(run, r) for r in run.recordings), strict=True)
    return layout(shown), partial(_log, run=run, logs=[partial(log_parameters, data=run), *logs])


def _log(stream: rr.RecordingStream, run: RunData, logs: Sequence[Log]) -> None:
    stream.send_recording_name(run.name)
    stream.log(NOTES, _page(replay_notes(run)), static=True)
    for log in logs:
        log(stream)


def _prepared_recording(data: RunData, fitted: FittedRecording) -> tuple[Shown, Log]:
    """A recording as its views show it, and what writes its entities."""
    motion, estimate, simulation = cell_motion(fitted), fitted.estimate, data.simulation
    cell, geometry = data.identification.robot.cell, estimate.geometry
    series, truth = recording_series(fitted, motion, data.identification.robot), None
    if simulation is not None and simulation.still is False:
        truth = true_tool(simulation, estimate, motion.t)
        series |= truth_series(simulation, estimate, truth, motion.t)
    name, (x, y, _) = fitted.name if data.several else "", geometry.origin
    root, reach = root_of(name), float(np.abs(cell.robot.d).sum() + np.abs(cell.robot.a).sum())

    def log(stream: rr.RecordingStream) -> None:
        branch = Branch(stream, root)
        branch.log(SCENARIO, _page(scenario_page(data, fitted)), static=True)
        branch.log(CELL, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log_shapes(branch, cell, geometry, motion)
        log_poses(branch, motion)
        log_coverage(branch, motion, geometry)
        log_tool(branch, motion)
        if truth is not None:
            log_truth(branch, truth, motion.t, geometry)
        log_events(branch, recording_events(fitted, motion))
        for entity, curves in series.items():
            log_series(branch, entity, curves)

    middle = np.array([0.5 * x, 0.5 * y, 0.3 * reach])
    return Shown(name or "Run", root, series, float(motion.t[-1]), middle, reach), log


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


def replay_notes(run: RunData) -> str:
    """Verdict, key figures and remarks; parameters of the machine and of recordings."""
    robot, moving = run.identification.robot, bool(run.recordings)
    comparison, stated = run.comparison if moving else None, ""
    if moving:
        stated = with_and_without(robot.tcp.sigma, robot.tcp.without_scale, robot.cell)
    return template("notes.md").render(
        run=run,
        summary=summary(run, tcp_view(run), ""),
        stated=stated,
        left_at_nominal=left_at_nominal(robot),
        groups=parameter_groups(robot, comparison),
        against_truth=comparison is not None,
        recordings=[
            (r.name, overview(r), parameter_groups(r.estimate, comparison)) for r in run.recordings
        ],
    )


def scenario_page(data: RunData, fitted: FittedRecording) -> str:
    """The scenario of a simulated run, or what the recording says of itself; its import report."""
    folder = fitted.recording.folder
    parts = ["# What was simulated" if data.scenario else "# What was recorded"]
    if data.scenario is not None:
        settings = data.scenario.model_dump(mode="json", exclude_unset=True)
        parts.append(_code(yaml.safe_dump(settings, sort_keys=False, width=100)))
    if folder is not None and (file := folder / "recording.yaml").is_file():
        parts += ["## recording.yaml", _code(file.read_text(encoding="utf-8"))]
    lines = report_lines(fitted.recording.report)
    parts += ["## How the files were read", _code("\n".join(lines))]
    return "\n\n".join(parts) + "\n"


def _code(text: str) -> str:
    """A block of text, indented: no fence is safe from what a file may contain."""
    return "\n".join(f"    {line}" for line in text.splitlines())
