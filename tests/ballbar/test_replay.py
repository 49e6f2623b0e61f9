"""The replay file: complete, exact, checked by rerun itself, and written whole or not at all."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import urllib.request
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import bar_frames, nominal_geometry, robot_frames
from ballbar.cell.load import load_cell
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.replay import viewer
from ballbar.replay import write as replay
from ballbar.replay.blueprint import rounded_up
from ballbar.replay.scene import magnification, quat_from_z, quat_xyzw
from ballbar.replay.series import base_alignment, true_tool
from ballbar.replay.viewer import ViewerError, chosen_replay, open_viewer, serve_web, web_server
from ballbar.replay.write import recording_id, replay_notes, write_replay
from ballbar.report.motion import cell_motion
from ballbar.report.numbers import significant
from ballbar.report.shapes import Body, cell_bodies
from ballbar.result.run_data import RunData
from tests.helpers.command_line import ballbar
from tests.helpers.identified_run import simulated_run
from tests.helpers.replay_files import (
    chunks,
    entities,
    free_port,
    over_time,
    rerun_says,
    values,
    verified,
)

NS = 1e9


@pytest.fixture(scope="module", autouse=True)
def _strict_rerun():
    """Bad data is an error; rerun only warns about it by default."""
    before = rr.strict_mode()
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(before)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> RunData:
    """A minute of the IRB 2400 without forces, identified from few samples."""
    return simulated_run(tmp_path_factory.mktemp("five"), fitted=(1, 2, 3, 4, 5))


@pytest.fixture(scope="module")
def real(tmp_path_factory) -> RunData:
    """A run as from a real cell: two encoders, and nobody knows the truth."""
    return replace(
        simulated_run(tmp_path_factory.mktemp("two"), fitted=(1, 2)),
        simulation=None,
        comparison=None,
        limits=(),
        scenario=None,
    )


@pytest.fixture(scope="module")
def file(run, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "run.rrd"
    write_replay(path, run)
    return path


def test_rerun_itself_finds_no_fault_in_the_file(file):
    assert verified(file)


def test_joint_angles_are_the_logged_rows_bit_for_bit(file, run):
    log = run.recordings[0].recording.robot_log
    ns, degrees = over_time(file, "/robot/joint_angles_deg", "Scalars:scalars")
    rows = np.searchsorted(log.t, ns / NS - 1e-6)  # the file holds whole ns, the log float seconds
    np.testing.assert_array_equal(degrees, np.degrees(log.q[rows]))
    assert np.abs(ns - log.t[rows] * NS).max() <= 1.0
    assert 25.0 <= 1.0 / np.diff(log.t[rows]).mean() <= 50.0


def test_residuals_are_in_um_and_urad_on_the_robots_clock(file, run):
    estimate = run.recordings[0].estimate
    for when, residuals in (("before", estimate.before), ("after", estimate.after)):
        ns, position = over_time(file, f"/residual/{when}/position_um", "Scalars:scalars")
        _, angle = over_time(file, f"/residual/{when}/angle_urad", "Scalars:scalars")
        np.testing.assert_array_equal(position, residuals.position * 1e6)
        np.testing.assert_array_equal(angle, residuals.angle * 1e6)
        expected = estimate.clock.offset + (1.0 + estimate.clock.skew) * residuals.t
        assert np.abs(ns / NS - expected).max() < 2e-9


def test_bodies_of_the_file_stand_where_the_identified_kinematics_put_them(file, run):
    (fitted,) = run.recordings
    frames = robot_frames(fitted.estimate.geometry, cell_motion(fitted).q)
    _, places = over_time(file, "/cell/robot/link4", "Transform3D:translation")
    np.testing.assert_allclose(
        places.reshape(-1, 3), frames.origin[4].T, atol=2e-7
    )  # float32 in the viewer


def test_everything_a_newcomer_needs_is_in_the_file(file):
    present = entities(file)
    links = {f"/cell/robot/{name}" for name in ("base", *(f"link{i}" for i in range(1, 7)))}
    bar = {
        f"/cell/ballbar/{name}"
        for name in ("stand", "gimbal_b1", "gimbal_b2", "rod_b3", "universal_b4", "universal_b5")
    }
    tool = {
        f"/cell/tool/{name}"
        for name in ("path", "path_so_far", "identified_position", "true_position")
    }
    errors = {"/cell/tool/error_of_nominal_robot", "/cell/tool/error_of_identified_robot"}
    plots = {
        "/tcp_error/nominal_um",
        "/tcp_error/identified_um",
        "/ballbar/encoder_angles_deg",
        "/notes",
    }
    assert links | bar | tool | errors | plots | {"/cell/plate", "/cell/sphere"} <= present
    assert "/ballbar/rod_force_N" not in present  # the kinematic plant knows none


def test_the_timeline_is_the_robots_clock(file):
    timelines = {
        name for chunk in chunks(file) if not chunk.is_static for name in chunk.timeline_names
    }
    assert timelines == {"robot_time"}


def test_writing_the_same_run_twice_gives_the_same_recording(file, run, tmp_path):
    again = tmp_path / "again.rrd"
    write_replay(again, run)
    done = rerun_says("compare", "--unordered", file, again)
    assert done.returncode == 0, done.stdout + done.stderr
    components = {name for chunk in chunks(again) for name in chunk.to_record_batch().schema.names}
    assert not [
        name for name in components if "start_time" in name or "log_time" in name
    ]  # `compare` looks past these


def test_a_minute_takes_little_space(file):
    assert file.stat().st_size < 7_500_000  # half of the 15 MB allowed for 120 s


def test_a_real_recording_needs_no_truth(real, tmp_path):
    path = tmp_path / "real.rrd"
    write_replay(path, real)
    present = entities(path)
    assert not [
        e for e in present if e.startswith("/tcp_error") or "error_of" in e or "true_position" in e
    ]
    assert {"/cell/ballbar/rod_b3", "/residual/after/position_um"} <= present
    _, angles = over_time(path, "/ballbar/encoder_angles_deg", "Scalars:scalars")
    assert angles.shape[1] == 2
    assert verified(path)


def test_without_encoders_the_ball_bar_follows_the_robot(real, tmp_path):
    """And where the ball-bar's log says nothing, before it began, it follows too."""
    (fitted,) = real.recordings
    motion = cell_motion(fitted)
    # starting values of an ideal ball-bar, mm
    assert np.abs(motion.bar.tip - motion.robot.tip).max() < 3e-3
    bare_recording = replace(
        fitted,
        recording=replace(fitted.recording, ballbar_log=None),
        estimate=replace(fitted.estimate, clock=None, encoders=(), directions=()),
    )
    bare = replace(real, recordings=(bare_recording,))
    motion = cell_motion(bare_recording)
    assert np.abs(motion.bar.tip - motion.robot.tip).max() < 3e-3
    write_replay(tmp_path / "bare.rrd", bare)
    assert "/ballbar/encoder_angles_deg" not in entities(tmp_path / "bare.rrd")


def test_a_file_that_cannot_be_finished_leaves_the_old_one_and_nothing_else(
    run, tmp_path, monkeypatch
):
    path = tmp_path / "run.rrd"
    path.write_bytes(b"old")

    def broken(data):
        raise RuntimeError("disk full")

    monkeypatch.setattr(replay, "replay_notes", broken)
    with pytest.raises(RuntimeError, match="disk full"):
        write_replay(path, run)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_recording_id_tells_runs_apart_and_knows_them_again(run, real):
    assert recording_id(run) == recording_id(replace(run)) != recording_id(real)
    assert recording_id(run).startswith("minute-")


def test_notes_begin_with_the_verdict_and_list_every_parameter(run, real):
    notes = replay_notes(run)
    assert notes.startswith(f"# minute\n\n**{run.identification.verdict.sentence}**")
    before, after = run.comparison.tcp_nominal, run.comparison.tcp
    means = " → ".join(significant(error.mean * 1e3) for error in (before, after))
    assert f"| TCP error, before → after | {means} mm |" in notes
    assert f"| TCP error after, largest | {significant(after.maximum * 1e3)} mm |" in notes
    (row,) = [line.split(" | ") for line in notes.splitlines() if line.startswith("| ra2 |")]
    result = run.identification
    decimals = len(row[2].partition(".")[2])
    assert row[2] == f"{result.robot.geometry['ra2'] * 1e3:.{decimals}f}"
    assert all(f"| {name} |" in notes for name in result.sigma)
    assert all(f"- {d.name}, kept at" in notes for d in result.robot.dropped)
    assert "| 0.05 mm | yes |" in notes
    assert "| iterations | 11 | 10 | NO |" in notes
    assert "TCP error" not in replay_notes(real)


def test_magnified_error_is_that_of_the_comparison(run):
    """Along the path the mean error is of the size of the TCP error, found another way."""
    motion = cell_motion(run.recordings[0])
    truth = true_tool(run.simulation, run.recordings[0].estimate, motion.t)
    for error, figure in (
        (truth.nominal_error, run.comparison.tcp_nominal),
        (truth.identified_error, run.comparison.tcp),
    ):
        size = np.linalg.norm(error, axis=1)
        assert 0.2 * figure.mean < size.mean() < 2.0 * figure.mean
    # identified and true tool: logged angles are noisy (1e-5 rad at 2 m, largest of many)
    assert np.abs(truth.position - motion.tool).max() < 3e-4


def test_a_base_that_stands_elsewhere_is_no_tool_error():
    """`rd1` and `rtheta1` are gauge: they move the whole robot."""
    cell = load_cell("irb2400", "lund_600", "plate_250")
    model, grid = nominal_geometry(cell, np.zeros(3)), accuracy_grid(cell.robot)
    truth = model.replaced({"rd1": model["rd1"] + 0.3, "rtheta1": model["rtheta1"] + 0.5})
    turn, shift = base_alignment(model, truth, grid)
    moved = robot_frames(model, grid).tip.T @ turn.T + shift
    np.testing.assert_allclose(
        moved, robot_frames(truth, grid).tip.T, atol=1e-12
    )  # rounding at 2 m


def test_magnification_is_a_round_factor_that_fits():
    assert [magnification(1e-3, 0.2), magnification(1.3e-6, 0.2), magnification(1e-2, 0.06)] == [
        200,
        100_000,
        5,
    ]
    assert magnification(0.0, 0.2) == magnification(0.5, 0.2) == 1


def test_axis_ends_are_round():
    assert [rounded_up(x) for x in (0.0, 9.0, 20.0, 20.1, 0.3)] == [1.0, 10.0, 20.0, 50.0, 0.5]


def test_quaternions_come_scalar_last():
    quarter_turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])[:, :, None]
    np.testing.assert_allclose(
        quat_xyzw(quarter_turn), [[0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]], atol=1e-15
    )


def test_any_direction_is_reached_from_the_z_axis():
    directions = np.vstack((np.eye(3), -np.eye(3), np.random.default_rng(1).normal(size=(20, 3))))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    turned = Rotation.from_quat(quat_from_z(directions)).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(turned, directions, atol=1e-12)


@pytest.mark.parametrize(
    ("robot", "ballbar"), [("irb2400", "lund_600"), ("nj220", "lund_1200"), ("ur10e", "lund_600")]
)
def test_links_meet_at_every_joint(robot, ballbar):
    """On the axis of a joint its two bodies overlap or touch, whatever the joint angles."""
    cell = load_cell(robot, ballbar, "plate_250")
    geometry = nominal_geometry(cell, np.array([1.0, 0.0, 0.6]))
    rng = np.random.default_rng(1)
    machine, bar = (
        robot_frames(geometry, rng.uniform(-2.0, 2.0, (1, 6))),
        bar_frames(geometry, rng.uniform(-2.0, 2.0, (1, 5))),
    )
    bodies = cell_bodies(cell, geometry)
    for frames, chain in ((machine, bodies[:7]), (bar, bodies[8:])):
        for joint, pair in enumerate(pairwise(chain)):
            axis, point = frames.z[joint, :, 0], frames.origin[joint, :, 0]
            low, high = np.array(
                [
                    _span(body, frames, row, point, axis)
                    for body, row in zip(pair, (joint, joint + 1), strict=True)
                ]
            ).T
            assert low.max() <= high.min() + 1e-9, f"{robot} joint {joint + 1}: {low}, {high}"


def _span(body: Body, frames: Frames, row: int, point: Array, axis: Array) -> tuple[float, float]:
    """How far along an axis a body reaches where the axis passes through one of its bars."""
    turn, origin = frames.rotation(row)[:, :, 0], frames.origin[row, :, 0]
    reached = []
    for bar in body:
        middle = bar.start + np.linspace(0.0, 1.0, 201)[:, None] * (bar.end - bar.start)
        away = middle @ turn.T + origin - point
        height = away @ axis
        off = np.linalg.norm(away - np.outer(height, axis), axis=1)
        inside = off <= bar.radius
        half = np.sqrt(bar.radius**2 - off[inside] ** 2)
        if not bar.capped:  # cut off square: no higher than it is tilted
            half *= np.linalg.norm(np.cross(turn @ (bar.end - bar.start), axis)) / bar.length
        reached += [*(height[inside] - half), *(height[inside] + half)]
    return min(reached), max(reached)


def test_missing_replay_is_refused_before_a_viewer_starts(tmp_path):
    for path in (tmp_path, tmp_path / "none.rrd"):
        with pytest.raises(InputError, match=r"no replay file\. Make one with"):
            chosen_replay(path, None)


def test_a_file_that_is_not_a_replay_is_refused(tmp_path):
    targets = tmp_path / "targets.csv"
    targets.write_text("q1\n0.0\n")
    with pytest.raises(InputError, match=r"targets\.csv: is not a replay\. Name a folder"):
        chosen_replay(targets, None)


def test_taken_port_is_refused_by_number(file):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} on 127.0.0.1"):
            serve_web(file, port=port)


def test_web_viewer_answers_on_loopback_and_ends_with_the_block(file):
    port = free_port()
    with web_server(file, port=port) as (url, server):
        assert url.startswith(f"http://127.0.0.1:{port}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A")
        with urllib.request.urlopen(url, timeout=5.0) as answer:
            assert answer.status == 200
            assert b"wasm" in answer.read()
        data_port = int(re.search(r"127.0.0.1%3A(\d+)%2Fproxy", url)[1])
        for served in (port, data_port):
            with socket.create_connection(("127.0.0.1", served), timeout=5.0):
                pass
            with pytest.raises(ConnectionRefusedError):  # as from any other machine
                socket.create_connection(("127.0.0.2", served), timeout=5.0)
    assert server.poll() is not None


def test_no_viewer_collects_usage_data(file, tmp_path, monkeypatch):
    """Rerun keeps such data in the user's folder, and announces it in the first run of a user."""
    for name in ("CI", "FORCE_RERUN_ANALYTICS"):
        monkeypatch.delenv(name, raising=False)
    for name in ("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "APPDATA", "LOCALAPPDATA"):
        monkeypatch.setenv(name, str(tmp_path))
    with web_server(file):
        pass
    assert not list(tmp_path.rglob("*analytics*"))
    note = tmp_path / "note"
    program = f"import os; open({str(note)!r}, 'w').write(os.environ['CI'])"
    command = [sys.executable, "-c", program]
    monkeypatch.setattr(viewer, "_rerun", lambda: command[0])
    monkeypatch.setattr(viewer, "_check_screen", lambda _: None)
    monkeypatch.setattr(viewer, "_wait_for", lambda window, *_: window.wait())
    start = viewer.process_apart
    monkeypatch.setattr(viewer, "process_apart", lambda _, env: start(command, env=env))
    viewer.live_viewer()
    assert note.read_text() == "1"


def test_two_web_viewers_run_at_once_and_each_writes_nothing_but_its_address(file, capfd):
    """The second one was refused: both took port 9090; and the viewer's own log came before."""
    addresses: list[str] = []
    with web_server(file) as (first, _), web_server(file) as (second, _):
        addresses += [first, second]
    assert len(set(addresses)) == 2
    written = capfd.readouterr()
    assert (written.out, written.err) == ("", "")


def test_the_port_belongs_to_the_web_viewer(file):
    code, _, error = ballbar("replay", file, "--port", 9000)
    assert code == 2
    assert "--port is that of the web viewer; add --web." in error


def test_the_arrows_are_explained_beside_the_scene_and_not_on_it(file):
    (text,) = values(file, "/legend", "TextDocument:text")
    assert "Orange arrow, nominal robot: tool" in text[0]
    assert "Blue arrow, identified robot: tool" in text[0]
    assert not [path for path in entities(file) if path.endswith("/legend") and path != "/legend"]


def test_viewer_that_fails_is_reported_with_a_way_out(file, monkeypatch):
    monkeypatch.setenv("DISPLAY", "")
    monkeypatch.setenv("WAYLAND_DISPLAY", "")
    if sys.platform == "linux":
        with pytest.raises(ViewerError, match=r"there is no screen .* Use --web"):
            open_viewer(file)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(
        subprocess, "run", lambda command, **_: subprocess.CompletedProcess(command, 102)
    )
    with pytest.raises(ViewerError, match=r"ended with code 102.*use --web"):
        open_viewer(file)


def test_a_run_with_live_view_is_refused_at_once_where_there_is_no_screen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The viewer answered before it failed, and the run waited for it for ever."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    code, _, error = ballbar("run", "irb2400", "--live", "--out", tmp_path / "run")
    assert code == 1
    assert "there is no screen" in error
    assert "Leave out --live." in error
    assert not (tmp_path / "run").exists()
