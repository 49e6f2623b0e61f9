"""Views of a replay beside the moving cell, and what the viewer draws of it.

Events, coverage, parameters, comparison.
"""

from __future__ import annotations

import re
import time
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import rerun as rr
from rerun.experimental import ViewerClient

from ballbar.cell.errors import InputError
from ballbar.cell.logs import BallBarLog
from ballbar.cell.rotation import even_directions
from ballbar.replay.entities import PARAMETERS
from ballbar.replay.events import recording_events
from ballbar.replay.live import LiveRun
from ballbar.replay.parameters import HALF, LEFT, RIGHT
from ballbar.replay.series import clock_error_series, recording_series
from ballbar.replay.viewer import _rerun, chosen_replay
from ballbar.replay.write import scenario_page, write_replay
from ballbar.report.motion import cell_motion
from ballbar.result.run_data import RunData
from ballbar.sphere_coverage import PATCHES, coverage
from tests.helpers.identified_run import simulated_run
from tests.helpers.replay_files import chunks, entities, free_port, values, verified

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
    """The same run, and nobody who knows the truth."""
    path = tmp_path_factory.mktemp("other") / "unknown.rrd"
    write_replay(path, replace(run, name="unknown", simulation=None, comparison=None, limits=()))
    return path


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


def test_the_picture_of_the_parameters_shows_changes_and_intervals_to_scale(file, run):
    (bars,) = values(file, f"{PARAMETERS}/values/interval", "LineStrips2D:strips")
    (changes,) = values(file, f"{PARAMETERS}/values/change", "LineStrips2D:strips")
    intervals, changes = (np.array(bar).reshape(-1, 2, 2) for bar in (bars, changes))
    robot = run.identification.robot
    rows = (*robot.geometry.table.robot, "bd3")  # where the bar stands is none of the robot's
    names = [name for name in rows if name in robot.sigma]
    assert intervals[:, 0, 1].tolist() == [rows.index(name) for name in names]
    sigma = np.array([robot.sigma[name] for name in names])
    lengths = intervals[:, 1, 0] - intervals[:, 0, 0]
    np.testing.assert_allclose(lengths / lengths[0], sigma / sigma[0], rtol=1e-3)  # float32
    moved = np.array([robot.geometry[name] - robot.nominal[name] for name in names])
    drawn = changes[:, 1, 0] - LEFT
    np.testing.assert_allclose(drawn / np.abs(drawn).max(), moved / np.abs(moved).max(), atol=1e-5)
    assert np.abs(intervals[:, :, 0] - RIGHT).max() <= HALF * 1.001


def test_two_runs_stand_below_roots_of_their_own(file, other):
    with chosen_replay(file, other) as path:
        assert verified(path)
        present = entities(path)
        names = values(path, "/B/tcp_error/identified_um", "SeriesLines:names")
    assert not path.exists()
    assert ["B identified"] in names
    assert {
        "/A/robot/joint_angles_deg",
        "/B/robot/joint_angles_deg",
        "/A/notes",
        "/B/notes",
    } <= present


def test_a_comparison_refuses_what_is_no_replay(file, tmp_path):
    text = tmp_path / "text.rrd"
    text.write_text("no replay")
    with pytest.raises(InputError, match=r"text\.rrd"), chosen_replay(file, text):
        pass
    empty = tmp_path / "empty.rrd"
    with rr.RecordingStream("other") as stream:
        stream.save(empty)
        stream.log("/x", rr.Scalars(1.0))
    with pytest.raises(InputError, match="is no replay of a run"), chosen_replay(empty, file):
        pass


def test_page_of_the_scenario_holds_what_was_set_and_nothing_breaks_out_of_it(run, tmp_path):
    (fitted,) = run.recordings
    page = scenario_page(run, fitted)
    assert "    name: irb2400" in page
    assert "    schema: ballbar-recording/1" in page
    (tmp_path / "recording.yaml").write_text(
        "notes: |\n  ```\n  # Title\n  <script>\n", encoding="utf-8"
    )
    moved = replace(fitted, recording=replace(fitted.recording, folder=tmp_path))
    lines = scenario_page(run, moved).splitlines()
    assert all(
        line.startswith("    ")
        for line in lines
        if "```" in line or "<script>" in line or line.endswith("# Title")
    )


def test_live_run_shows_the_cell(run, tmp_path):
    path = tmp_path / "live.rrd"
    with rr.RecordingStream("live-test") as stream:
        stream.save(path)
        live = LiveRun(stream)
        motion = run.simulation.motion
        half = motion.t.size // 2
        for rows in (slice(0, half + 1), slice(half, None)):
            live.moved(
                run.simulation.cell, motion.geometry, motion.t[rows], motion.q[rows], motion.b[rows]
            )
        live.finished(run)
    assert verified(path)
    assert chunks(path, "/cell/robot/link6")


@pytest.mark.long
def test_the_viewer_draws_every_layout_without_an_error(file, other, tmp_path):
    port = free_port()
    if not any(
        Path(folder).is_dir() and any(Path(folder).iterdir())
        for folder in ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d")
    ):
        pytest.skip(
            "no Vulkan driver: install mesa-vulkan-drivers and libvulkan1 for pictures without a "
            "screen"
        )
    with ViewerClient.spawn(headless=True, port=port, executable_path=_rerun()) as viewer:
        for against in (None, other):
            with chosen_replay(file, against) as path:
                viewer.open(str(path.resolve()))
                time.sleep(0.3)
                while viewer.get_state().loading:
                    time.sleep(0.1)
                viewer.set_time("robot_time", duration=20.0, play_state="paused")
                time.sleep(0.5)
                state = viewer.get_state()
                assert len(state.views) >= 5
                assert not [report for view in state.views for report in view.reports]
                picture = tmp_path / f"{against is not None}.png"
                viewer.save_screenshot(str(picture))
            shades = matplotlib.image.imread(picture)[..., :3].reshape(-1, 3)
            assert (
                len(np.unique(np.floor(shades * 16.0), axis=0)) > 100
            )  # a scene, not an empty window
