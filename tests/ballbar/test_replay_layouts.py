"""What a replay shows beside the moving cell, and what the viewer draws of it.

Events, coverage, parameters, iterations, comparison.
"""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import time
import urllib.parse
import urllib.request
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient
from typer.testing import CliRunner

from ballbar.commands.cli import app
from ballbar.replay.entities import (
    CELL,
    CLOSURE_ERROR,
    CLOSURE_POSITION,
    ITERATION,
    PARAMETER_TABLE,
    PARAMETER_VALUES,
    STAGE,
)
from ballbar.replay.events import recording_events
from ballbar.replay.iterations import log_step
from ballbar.replay.live import LiveRun
from ballbar.replay.motion import cell_motion
from ballbar.replay.notes import scenario_page
from ballbar.replay.parameters import HALF, RIGHT, parameter_table, read_table
from ballbar.replay.series import clock_error_series, recording_series
from ballbar.replay.show import chosen_replay
from ballbar.replay.viewer import _rerun, web_server
from ballbar.replay.write import write_replay
from ballbar.result.iterations import IterationLog
from ballbar.result.run_data import RunData
from ballbar.sphere_coverage import PATCHES, coverage, even_directions
from cell.errors import InputError
from cell.logs import BallBarLog
from ident.identify import identify
from ident.options import FitOptions
from tests.helpers.identified_run import simulated_run

SECOND = 1e-9  # of the ns in a file


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> RunData:
    return simulated_run(tmp_path_factory.mktemp("run"), fitted=(1, 2, 3, 4, 5))


@pytest.fixture(scope="module")
def file(run, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "minute.rrd"
    write_replay(path, run)
    return path


@pytest.fixture(scope="module")
def other(run, tmp_path_factory) -> Path:
    """The same run with intervals forty times as wide, and nobody who knows the truth."""
    result = run.identification
    sigma = {name: 40.0 * sigma for name, sigma in result.robot.sigma.items()}
    wide = replace(result, robot=replace(result.robot, sigma=sigma))
    path = tmp_path_factory.mktemp("other") / "wide.rrd"
    write_replay(
        path,
        replace(
            run,
            name="wide",
            identification=wide,
            simulation=None,
            comparison=None,
            limits=(),
            iterations=(),
        ),
    )
    return path


def _chunks(path: Path, entity: str) -> list:
    return [
        chunk for chunk in RrdReader(str(path)).stream().to_chunks() if chunk.entity_path == entity
    ]


def _values(path: Path, entity: str, component: str) -> list:
    return [row for chunk in _chunks(path, entity) for row in _column(chunk, component)]


def _column(chunk, component: str) -> list:
    batch = chunk.to_record_batch()
    return batch.column(component).to_pylist() if component in batch.schema.names else []


def _verified(path: Path) -> bool:
    return (
        subprocess.run(
            [sys.executable, "-m", "rerun_cli", "rrd", "verify", str(path)],
            capture_output=True,
            check=False,
        ).returncode
        == 0
    )


@pytest.mark.slow
def test_iterations_begin_with_the_nominal_robot_and_end_with_the_result(file, run):
    powers = np.array(_values(file, CLOSURE_POSITION, "Scalars:scalars")).ravel()
    estimate = run.recordings[0].estimate
    rms = [
        np.sqrt((r.position**2).sum(axis=1).mean()) * 1e6 for r in (estimate.before, estimate.after)
    ]
    np.testing.assert_allclose(10.0 ** powers[[0, -1]], rms, rtol=1e-9)
    assert powers.size == len(run.iterations) + 1
    last = run.iterations[-1]
    np.testing.assert_allclose(last.iteration.geometry["ra2"], estimate.geometry["ra2"], atol=1e-12)
    assert last.stage == "fitting"
    pages = _values(file, STAGE, "TextDocument:text")
    assert pages[-1][0].startswith(
        f"## Iteration {powers.size - 1} of {powers.size - 1}\n\nfitting"
    )


def test_the_arm_stands_in_the_scene_of_the_iterations(file):
    """It was absent: its poses were known over the run's time alone."""
    for body in ("robot/link3", "plate", "ballbar/rod_b3"):
        timelines = [set(c.timeline_names) for c in _chunks(file, f"{CELL}/{body}")]
        assert {ITERATION} in timelines, body
    with chosen_replay(file, "identify", None) as path:
        assert _values(path, f"{CELL}/robot/link3", "Transform3D:translation")


def test_arrows_of_the_loop_closure_error_shrink_with_the_iterations(file):
    sizes = [
        np.linalg.norm(row, axis=1).mean()
        for row in _values(file, CLOSURE_ERROR, "Arrows3D:vectors")
        if row
    ]
    assert 0.05 < sizes[0] < 0.5  # of a rod of 0.6 m
    assert sizes[-1] < 0.02 * sizes[0]


def test_watching_changes_nothing(run):
    """One recording identified with and without anybody who listens."""
    (fitted,), result = run.recordings, run.identification
    logs = fitted.recording.robot_log, fitted.recording.ballbar_log
    silent = identify(result.robot.cell, *logs, options=FitOptions(samples=300))
    values = silent.recordings[0].geometry.values
    np.testing.assert_array_equal(values, fitted.estimate.geometry.values)
    assert silent.fit.iterations == result.fit.iterations


def test_patches_lie_evenly_and_are_counted_once():
    points = even_directions(PATCHES)
    away = np.sort(np.arccos(np.clip(points @ points.T, -1.0, 1.0)), axis=1)[:, 1]
    assert away.min() > 0.5 * np.sqrt(4.0 * np.pi / PATCHES)
    assert away.max() < 1.2 * np.sqrt(4.0 * np.pi / PATCHES)
    turn = np.linspace(0.0, 4.0 * np.pi, 4000)  # twice round the equator
    centre = np.array([0.5, 0.2, 0.3])
    ring = centre + 0.6 * np.column_stack((np.cos(turn), np.sin(turn), 0.0 * turn))
    seen = coverage(turn, ring, centre)
    assert (np.diff(seen.t) >= 0.0).all()
    assert seen.t[-1] <= 2.01 * np.pi  # nothing new on the second round
    assert np.abs(seen.directions[:, 2]).max() < 1.2 * np.sqrt(4.0 * np.pi / PATCHES)
    assert seen.share[-1] == pytest.approx(seen.t.size / PATCHES)


def test_events_name_gaps_outliers_and_dwells(run):
    (fitted,) = run.recordings
    log = fitted.recording.ballbar_log
    rows = np.arange(log.t.size)
    angles = log.angles.copy()
    angles[2_000, 1] += 0.02
    kept = (rows < 3_000) | (rows > 3_040)
    ballbar_log = BallBarLog(log.t[kept], angles[kept], log.joints)
    broken = replace(fitted.recording, ballbar_log=ballbar_log)
    events = recording_events(replace(fitted, recording=broken), cell_motion(fitted))
    words = [(remark.t, remark.sentence) for remark in events.remarks if remark.level == "WARN"]
    shown = fitted.estimate.clock.robot_time(log.t)
    (spike, said), (gap, lost) = words
    assert said == "encoders: 1 row that no motion explains, left out"
    assert spike == pytest.approx(shown[2_000], abs=1e-6)
    assert re.fullmatch(r"encoders: no rows for 4\d\d ms", lost)
    assert gap == pytest.approx(shown[3_000 - 1], abs=2e-3)
    assert list(events.lanes["encoders"].states) == [
        "rows",
        "outlier",
        "rows",
        "gap",
        "rows",
        "ended",
    ]
    assert events.lanes["robot"].states[0] == "dwell"
    for lane in events.lanes.values():
        assert (np.diff(lane.t) > 0.0).all()
        assert set(lane.states) <= set(lane.colours)


def test_a_wrist_that_turns_over_is_an_event(run):
    (fitted,) = run.recordings
    motion = cell_motion(fitted)
    q = motion.q.copy()
    half = motion.t.size // 2
    q[half:, 4] *= -1.0
    events = recording_events(fitted, replace(motion, q=q))
    changes = [
        remark for remark in events.remarks if remark.sentence.startswith("configuration is now")
    ]
    assert [remark.t for remark in changes] == [motion.t[half]]


def test_clock_error_is_that_of_the_comparison(run):
    (fitted,) = run.recordings
    motion = cell_motion(fitted)
    series = clock_error_series(run.simulation, fitted.estimate, motion.t)
    series |= recording_series(fitted, motion, run.identification.robot)
    error = series["/clock/error_us"]
    begin = run.comparison.offset * 1e6
    assert error.values[0, 0] == pytest.approx(
        begin, abs=0.1 + abs(run.comparison.skew) * 1e6
    )  # jitter of the stamps
    identified = series["/clock/offset_ms/identified"]
    assert identified.values[0, 0] == pytest.approx(fitted.estimate.clock.offset * 1e3, abs=0.1)


def test_table_of_parameters_goes_through_the_file(file, run):
    (chunk,) = _chunks(file, PARAMETER_TABLE)
    table, written = parameter_table(run), read_table(chunk)
    assert written.names == table.names
    assert written.has_truth
    for one, two in (
        (table.moved, written.moved),
        (table.sigma, written.sigma),
        (table.error, written.error),
    ):
        np.testing.assert_array_equal(one, two)
    assert "ra2" in table.names
    assert "ox" not in table.names  # where it stands is no property of the robot


@pytest.mark.slow
def test_two_runs_are_drawn_on_common_axes(file, other, tmp_path):
    with chosen_replay(file, "run", other) as path:
        assert _verified(path)
        rows = [
            _values(path, f"{PARAMETER_VALUES}/{root}/interval", "LineStrips2D:strips")[0]
            for root in "AB"
        ]
        bars = [np.array(row).reshape(-1, 2, 2) for row in rows]
        entities = {chunk.entity_path for chunk in RrdReader(str(path)).stream().to_chunks()}
    assert not path.exists()
    lengths = [bar[:, 1, 0] - bar[:, 0, 0] for bar in bars]
    np.testing.assert_allclose(lengths[1], 40.0 * lengths[0], rtol=1e-3)  # float32
    assert np.abs(bars[1][:, :, 0] - RIGHT).max() <= HALF * 1.001
    assert {
        "/A/robot/joint_angles_deg",
        "/B/robot/joint_angles_deg",
        "/A/notes",
        "/B/notes",
    } <= entities


def test_layouts_refuse_what_they_cannot_show(file, other, tmp_path):
    with (
        pytest.raises(InputError, match=r"wide\.rrd: holds no iterations.*--rerun"),
        chosen_replay(other, "identify", None),
    ):
        pass
    with pytest.raises(InputError, match="--against has a layout of its own"):
        chosen_replay(file, "identify", other)
    text = tmp_path / "text.rrd"
    text.write_text("no replay")
    with pytest.raises(InputError, match=r"text\.rrd"), chosen_replay(file, "run", text):
        pass
    empty = tmp_path / "empty.rrd"
    with rr.RecordingStream("other") as stream:
        stream.save(empty)
        stream.log("/x", rr.Scalars(1.0))
    with (
        pytest.raises(InputError, match="is no replay of a run"),
        chosen_replay(empty, "run", file),
    ):
        pass


@pytest.mark.slow
def test_command_saves_the_iterations_as_a_file_of_their_own(file, tmp_path):
    saved = tmp_path / "identify.rrd"
    done = CliRunner().invoke(
        app, ["replay", str(file), "--layout", "identify", "--save", str(saved)]
    )
    assert done.exit_code == 0, done.output
    assert _verified(saved)
    assert _values(saved, STAGE, "TextDocument:text") == _values(file, STAGE, "TextDocument:text")


def test_page_of_the_scenario_holds_what_was_set_and_nothing_breaks_out_of_it(run, tmp_path):
    (fitted,) = run.recordings
    page = scenario_page(run, fitted)
    assert "    name: irb2400" in page
    assert "    schema: ballbar-recording/1" in page
    (tmp_path / "recording.yaml").write_text(
        "notes: |\n  ```\n  # Title\n  <script>\n", encoding="utf-8"
    )
    lines = scenario_page(run, replace(fitted, folder=tmp_path)).splitlines()
    assert all(
        line.startswith("    ")
        for line in lines
        if "```" in line or "<script>" in line or line.endswith("# Title")
    )


@pytest.mark.slow
def test_live_run_shows_the_cell_and_then_the_iterations(run, tmp_path):
    path, log = tmp_path / "live.rrd", IterationLog(lambda _: None)
    with rr.RecordingStream("live-test") as stream:
        stream.save(path)
        live = LiveRun(stream)
        motion = run.simulation.motion
        half = motion.t.size // 2
        for rows in (slice(0, half + 1), slice(half, None)):
            live.moved(
                run.simulation.cell, motion.geometry, motion.t[rows], motion.q[rows], motion.b[rows]
            )
        for number, step in enumerate(run.iterations, 1):
            live.iterated(number, step)
        live.finished(run)
    assert _verified(path)
    assert _chunks(path, "/cell/robot/link6")
    powers = np.array(_values(path, CLOSURE_POSITION, "Scalars:scalars")).ravel()
    assert powers.size == len(run.iterations)
    assert not log.steps


def test_one_step_is_told_in_words(run, tmp_path):
    path = tmp_path / "step.rrd"
    with rr.RecordingStream("step-test") as stream:
        stream.save(path)
        log_step(stream, 7, run.iterations[0])
    (page,) = _values(path, STAGE, "TextDocument:text")
    assert page[0].startswith("## Iteration 7\n\naligning the logs and finding the ball-bar\n")


@pytest.mark.slow
def test_the_served_page_may_call_no_outside_host(file):
    """The browser is told so, and nothing that it would load by itself stands in the page."""
    port = _free_port()
    with web_server(file, port=port) as (url, _):
        data_port = urllib.parse.unquote(url).rpartition(":")[2].partition("/")[0]
        with urllib.request.urlopen(url, timeout=5.0) as answer:
            page, policy = answer.read().decode(), answer.headers["Content-Security-Policy"]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/re_viewer.js", timeout=5.0) as answer:
            assert len(answer.read()) > 10_000
    assert "re_viewer.js" in page
    assert not re.findall(
        r"<(?:link|script|img|iframe)\b[^>]*(?:href|src)=[\"']?(?:https?:)?//[^>]*>", page
    )
    named = set(re.findall(r"https?://([\w.:-]+)", policy))
    assert named == {f"127.0.0.1:{data_port}", f"localhost:{data_port}"}
    assert policy.startswith("default-src 'self'")
    assert "*" not in policy


@pytest.mark.slow
def test_the_viewer_draws_every_layout_without_an_error(file, other, tmp_path):
    port = _free_port()
    if not any(
        Path(folder).is_dir() and any(Path(folder).iterdir())
        for folder in ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d")
    ):
        pytest.skip(
            "no Vulkan driver: install mesa-vulkan-drivers and libvulkan1 for pictures without a "
            "screen"
        )
    with ViewerClient.spawn(headless=True, port=port, executable_path=_rerun()) as viewer:
        for layout, against, timeline in (
            ("run", None, "robot_time"),
            ("identify", None, "iteration"),
            ("run", other, "robot_time"),
        ):
            with chosen_replay(file, layout, against) as path:
                viewer.open(str(path.resolve()))
                time.sleep(0.3)
                while viewer.get_state().loading:
                    time.sleep(0.1)
                at = {"sequence": 1} if timeline == "iteration" else {"duration": 20.0}
                viewer.set_time(timeline, **at, play_state="paused")
                time.sleep(0.5)
                state = viewer.get_state()
                assert len(state.views) >= 5
                assert not [report for view in state.views for report in view.reports]
                picture = tmp_path / f"{layout}{against is not None}.png"
                viewer.save_screenshot(str(picture))
            shades = matplotlib.image.imread(picture)[..., :3].reshape(-1, 3)
            assert (
                len(np.unique(np.floor(shades * 16.0), axis=0)) > 100
            )  # a scene, not an empty window


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
