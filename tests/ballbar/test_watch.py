"""A recording is identified while it is written: what is known falls in place, faults are named."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from ballbar.result.run_recordings import identify_recordings
from ballbar.watch.forecast import POWER, foretold
from ballbar.watch.run import watch
from ballbar.watch.show import Data, line
from ballbar.watch.state import Estimate, State
from ballbar.watch.view import ALARMS, APPLICATION, SIGMA, WatchView, layout
from ballbar.watch.watch import Watch
from cell.statistics import rms
from sim.live.device_logs import GrowingRecording
from tests.helpers.simulated_recordings import CLOCK, Recorded

ESTIMATE = Estimate(
    until=1.0,
    model="dh",
    status="good",
    sentence="",
    tcp_sigma=1.0,
    without_scale=1.0,
    doubt=0.0,
    acceptable=True,
    clock=None,
    clock_sigma=(0.0, 0.0),
    noise={},
    sphere=0.0,
)


@pytest.fixture
def growing(recorded: Recorded, tmp_path: Path) -> GrowingRecording:
    return GrowingRecording(recorded.folder, tmp_path / "growing", CLOCK)


def watched(growing: GrowingRecording, *instants: float, **options: float) -> list[State]:
    """The states of a watch at some instants [s]."""
    watch, states = Watch(growing.folder, **options), []
    for now in instants:
        growing.write_until(now)
        states.append(watch.update(now))
    return states


@pytest.mark.slow
def test_a_sound_recording_raises_no_alarm_and_tells_more_and_more(
    growing: GrowingRecording,
) -> None:
    states = watched(growing, 30.0, 36.0, 45.0, 55.0, duration=60.0)
    assert [alarm for state in states for alarm in state.alarms] == []
    sigmas = [state.estimate.without_scale for state in states if state.estimate]
    assert len(sigmas) == 4
    assert all(later < earlier for earlier, later in pairwise(sigmas))
    assert 0.7 < states[-1].predicted < 1.3  # white noise that the fit has not seen


@pytest.mark.slow
def test_what_is_stated_at_the_end_is_the_identification_of_the_recording(
    growing: GrowingRecording, recorded: Recorded
) -> None:
    growing.write_until(1e9)
    watch = Watch(growing.folder)
    watch.update(60.0)
    estimate = watch.finish(61.0).estimate
    result = identify_recordings([recorded.folder]).identification
    assert estimate.tcp_sigma == pytest.approx(rms(result.robot.tcp_sigma), rel=1e-9)
    assert estimate.clock[0] == pytest.approx(result.recordings[0].clock.offset, abs=1e-12)


@pytest.mark.slow
def test_enough_is_said_where_the_accuracy_is_reached_and_later_rows_agree(
    growing: GrowingRecording,
) -> None:
    (before,) = watched(growing, 50.0, accuracy=1e-9)[-1:]
    assert not before.enough
    watch = Watch(growing.folder, accuracy=1.0)
    assert [watch.update(50.0).enough, watch.update(51.0).enough] == [False, True]


@pytest.mark.slow
def test_enough_is_said_where_the_true_error_is_within_the_accuracy_in_95_percent(
    growing: GrowingRecording,
) -> None:
    """Within 1.96 standard deviations, not within one."""
    stated = watched(growing, 50.0, 51.0)[-1].estimate.tcp_sigma
    growing.write_until(51.0)
    for times, enough in ((1.2, False), (1.9, False), (2.02, True)):
        watch = Watch(growing.folder, accuracy=times * stated)
        watch.update(50.0)
        assert watch.update(51.0).enough is enough


def test_a_recording_that_has_hardly_begun_is_waited_for(
    growing: GrowingRecording, tmp_path: Path
) -> None:
    nothing = Watch(tmp_path / "nothing").update(0.0)
    assert "no such folder" in nothing.waiting
    states = watched(growing, 0.0, 0.01, 0.1, 1.0, 3.0)
    assert all(state.waiting and not state.alarms for state in states)


@pytest.mark.slow
def test_a_half_written_row_is_left_for_the_next_update(growing: GrowingRecording) -> None:
    first, second = watched(growing, 20.0, 20.5)
    assert (growing.folder / "raw" / "robot.csv").read_bytes()[-1:] != b"\n"
    assert first.alarms == second.alarms == ()
    assert second.rows["robot"] > first.rows["robot"]


@pytest.mark.slow
def test_a_file_that_no_longer_grows_is_reported(growing: GrowingRecording) -> None:
    growing.write_until(30.0)
    watch = Watch(growing.folder)
    assert watch.update(100.0).alarms == watch.update(104.0).alarms == ()
    assert [alarm.kind for alarm in watch.update(105.5).alarms] == ["silent", "silent"]


@pytest.mark.slow
def test_a_slip_is_named_at_the_next_update(growing: GrowingRecording) -> None:
    log = growing.logs["ballbar"]
    rows = np.flatnonzero(log.t >= 44.6)
    log.put(rows, "b2", log.numbers("b2")[rows] + 3e-3 * log.scales["b2"])
    before, after = watched(growing, 44.0, 45.0)
    assert before.alarms == ()
    (alarm,) = after.alarms
    assert alarm.kind == "step"
    size = re.match(r"encoder b2 stepped by (.*) mrad", alarm.sentence)
    assert float(size[1]) == pytest.approx(-3.0, abs=0.1)  # a cubic through eight rows says it
    assert alarm.raised == pytest.approx(45.0, abs=0.2)


@pytest.mark.slow
def test_a_clock_that_is_set_back_is_an_alarm_once_it_was_seen_twice(
    growing: GrowingRecording,
) -> None:
    log = growing.logs["ballbar"]
    for row in np.flatnonzero(log.t >= 43.5):
        log.cells[row, 0] = str(int(log.cells[row, 0]) - 5_000_000_000)
    states = watched(growing, 43.0, 44.0, 45.0)
    assert [[alarm.kind for alarm in state.alarms] for state in states][-1] == ["clock set back"]


@pytest.mark.slow
def test_columns_exchanged_from_the_start_are_named_within_half_a_minute(
    growing: GrowingRecording,
) -> None:
    log = growing.logs["ballbar"]
    i, j = log.column("b1"), log.column("b4")
    log.cells[:, [i, j]] = log.cells[:, [j, i]]
    alarms = watched(growing, 20.0)[-1].alarms
    assert any("encoders b1 and b4 are exchanged" in alarm.sentence for alarm in alarms)


# --- output


@pytest.mark.slow
def test_the_loop_shows_each_state_and_ends_with_the_whole_recording(
    growing: GrowingRecording,
) -> None:
    growing.write_until(1e9)
    stop, shown = threading.Event(), list[Data]()
    stop.set()
    state = watch(growing.folder, shown.append, accuracy=1e-3, duration=None, stop=stop)
    assert state.enough
    assert shown[-1] == state.to_dict()
    assert re.search("enough.*verdict good, model dh", line(shown[-1]))


@pytest.mark.slow
def test_the_window_shows_the_uncertainty_over_the_recording_and_each_alarm_once(
    growing: GrowingRecording, tmp_path: Path
) -> None:
    log = growing.logs["ballbar"]
    rows = np.flatnonzero(log.t >= 44.6)
    log.put(rows, "b2", log.numbers("b2")[rows] + 3e-3 * log.scales["b2"])
    states = watched(growing, 44.0, 45.0, 46.0)
    stream = rr.RecordingStream(APPLICATION)
    with stream:
        stream.save(tmp_path / "watch.rrd", default_blueprint=layout())
        view = WatchView(stream)
        for state in states:
            view.show(state.to_dict())
    shown = {}
    for chunk in RrdReader(tmp_path / "watch.rrd").stream():
        rows_of = shown.setdefault(str(chunk.entity_path), [])
        rows_of += chunk.to_record_batch().to_pylist()
    sigmas = [row["Scalars:scalars"][0] for row in shown[SIGMA]]
    assert sigmas == [state.estimate.tcp_sigma * 1e3 for state in states]
    assert len(shown[ALARMS]) == 1


@pytest.mark.slow
def test_the_command_prints_a_line_of_json_for_each_update_and_ends_when_it_is_told_to(
    growing: GrowingRecording,
) -> None:
    growing.write_until(50.0)
    command = [sys.executable, "-m", "ballbar", "watch", str(growing.folder), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        first = json.loads(process.stdout.readline())
        process.terminate()
        last = [json.loads(text) for text in process.stdout][-1]
    assert process.returncode == 0
    assert first["schema"] == last["schema"] == "ballbar-watch/1"
    assert last["verdict"] == "good"
    assert last["recorded_s"] == pytest.approx(50.0, abs=0.2)


def test_the_scale_stays_and_the_rest_falls_until_the_end() -> None:
    scale, rest = 2e-5, 5e-5
    half = replace(ESTIMATE, until=60.0, without_scale=rest, tcp_sigma=float(np.hypot(rest, scale)))
    at_the_end = foretold(half, 120.0, scale=scale)
    fell = np.log(rest / np.sqrt(at_the_end**2 - scale**2)) / np.log(2.0)
    assert fell == pytest.approx(POWER)
    assert foretold(half, 60.0, scale=scale) == pytest.approx(half.tcp_sigma)
    assert foretold(half, 50.0, scale=scale) == pytest.approx(half.tcp_sigma)  # it went on longer


def test_doubts_may_be_gone_at_the_end() -> None:
    """Recordings whose fits state 0.077 mm with doubt end at 0.041 mm without it."""
    sound = replace(ESTIMATE, until=119.0, tcp_sigma=5e-5, without_scale=4e-5, doubt=0.0)
    doubted = replace(sound, without_scale=6.4e-5, tcp_sigma=7.1e-5, doubt=5e-5)
    without, with_doubt = (foretold(e, 120.0, scale=3e-5) for e in (sound, doubted))
    assert without < with_doubt < 0.85 * doubted.tcp_sigma
    apart = replace(sound, tcp_sigma=float(np.hypot(4e-5, 9e-5)))  # lengths contradict each other
    assert foretold(apart, 120.0, scale=3e-5) < 0.75 * apart.tcp_sigma
