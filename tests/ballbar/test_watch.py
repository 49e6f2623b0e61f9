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
from typing import Any

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from ballbar.cell.logs import RobotLog
from ballbar.cell.statistics import rms
from ballbar.ident.estimator.gauss_newton import SingularError
from ballbar.ident.identify import kinematic_result
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification
from ballbar.ident.verdict import Status
from ballbar.result.identify import identify
from ballbar.sim.live.device_logs import GrowingRecording
from ballbar.watch.alarms import standing
from ballbar.watch.beside import WatchBeside
from ballbar.watch.run import watch
from ballbar.watch.show import Data, line
from ballbar.watch.state import WHITE, WIDENED, Estimate, WatchState
from ballbar.watch.view import ALARMS, APPLICATION, SIGMA, WatchView, layout
from ballbar.watch.watch import PATIENCE, Watch
from tests.helpers.command_line import refusal
from tests.helpers.simulated_recordings import CLOCK, Recorded

ESTIMATE = Estimate(
    until=1.0,
    model="dh",
    status="good",
    sentence="",
    tcp_sigma=1.0,
    without_scale=1.0,
    white=1.0,
    widened=0.0,
    acceptable=True,
    clock=None,
    clock_sigma=(0.0, 0.0),
    noise={},
    sphere=0.0,
)


@pytest.fixture
def growing(recorded: Recorded, tmp_path: Path) -> GrowingRecording:
    return GrowingRecording(recorded.folder, tmp_path / "growing", CLOCK)


def slip(growing: GrowingRecording, encoder: str, since: float) -> None:
    """An encoder that slips by 3 mrad at a time [s]."""
    log = growing.logs["ballbar"]
    rows = np.flatnonzero(log.t >= since)
    log.put(rows, encoder, log.numbers(encoder)[rows] + 3e-3 * log.scales[encoder])


def watched(growing: GrowingRecording, *instants: float, **options: float) -> list[WatchState]:
    """The states of a watch at some instants [s]."""
    watch, states = Watch(growing.folder, **options), []
    for now in instants:
        growing.write_until(now)
        states.append(watch.update(now))
    return states


def test_a_sound_recording_raises_no_alarm_and_tells_more_and_more(
    growing: GrowingRecording,
) -> None:
    states = watched(growing, 30.0, 36.0, 45.0, 55.0, duration=60.0)
    assert [alarm for state in states for alarm in state.alarms] == []
    sigmas = [state.estimate.without_scale for state in states if state.estimate]
    assert len(sigmas) == 4
    assert all(later < earlier for earlier, later in pairwise(sigmas))
    assert 0.7 < states[-1].predicted < 1.3  # white noise that the fit has not seen


def test_what_is_stated_at_the_end_is_the_identification_of_the_recording(
    growing: GrowingRecording, recorded: Recorded
) -> None:
    growing.write_until(1e9)
    watch = Watch(growing.folder)
    watch.update(60.0)
    estimate = watch.finish(61.0).estimate
    result = identify(recorded.folder).data.identification
    assert estimate.tcp_sigma == pytest.approx(rms(result.robot.tcp_sigma), rel=1e-9)
    assert estimate.clock[0] == pytest.approx(result.recordings[0].clock.offset, abs=1e-12)


@pytest.mark.long
def test_enough_is_said_where_the_true_error_is_within_the_accuracy_in_95_percent(
    growing: GrowingRecording,
) -> None:
    """Within 1.96 standard deviations, not within one; and where later rows agree."""
    stated = watched(growing, 50.0, 51.0)[-1].estimate.tcp_sigma
    growing.write_until(51.0)
    for accuracy, enough in ((1e-9, 0), (1.2 * stated, 0), (1.9 * stated, 0), (2.02 * stated, 1)):
        watch = Watch(growing.folder, accuracy=accuracy)
        assert [watch.update(50.0).enough, watch.update(51.0).enough] == [False, bool(enough)]


def test_a_recording_that_has_hardly_begun_is_waited_for(
    growing: GrowingRecording, tmp_path: Path
) -> None:
    nothing = Watch(tmp_path / "nothing").update(0.0)
    assert "no such folder" in nothing.waiting
    states = watched(growing, 0.0, 0.01, 0.1, 1.0, 3.0)
    assert all(state.waiting and not state.alarms for state in states)


def test_a_half_written_row_is_left_for_the_next_update(growing: GrowingRecording) -> None:
    first, second = watched(growing, 20.0, 20.5)
    assert (growing.folder / "raw" / "robot.csv").read_bytes()[-1:] != b"\n"
    assert first.alarms == second.alarms == ()
    assert second.rows["robot"] > first.rows["robot"]


def test_a_file_that_no_longer_grows_is_reported(growing: GrowingRecording) -> None:
    growing.write_until(30.0)
    watch = Watch(growing.folder)
    assert watch.update(100.0).alarms == watch.update(104.0).alarms == ()
    assert [alarm.kind for alarm in watch.update(105.5).alarms] == ["silent", "silent"]


def test_a_slip_is_named_at_the_next_update(growing: GrowingRecording) -> None:
    slip(growing, "b2", 44.6)
    before, after = watched(growing, 44.0, 45.0)
    assert before.alarms == ()
    (alarm,) = after.alarms
    assert alarm.kind == "step"
    size = re.match(r"encoder b2 stepped by (.*) mrad", alarm.sentence)
    assert float(size[1]) == pytest.approx(-3.0, abs=0.1)  # a cubic through eight rows says it
    assert alarm.raised == pytest.approx(45.0, abs=0.2)


def test_a_clock_that_is_set_back_is_an_alarm_once_it_was_seen_twice(
    growing: GrowingRecording,
) -> None:
    log = growing.logs["ballbar"]
    for row in np.flatnonzero(log.t >= 43.5):
        log.cells[row, 0] = str(int(log.cells[row, 0]) - 5_000_000_000)
    states = watched(growing, 43.0, 44.0, 45.0)
    assert [[alarm.kind for alarm in state.alarms] for state in states][-1] == ["clock set back"]


def test_columns_exchanged_from_the_start_are_named_within_half_a_minute(
    growing: GrowingRecording,
) -> None:
    log = growing.logs["ballbar"]
    i, j = log.column("b1"), log.column("b4")
    log.cells[:, [i, j]] = log.cells[:, [j, i]]
    alarms = watched(growing, 20.0)[-1].alarms
    assert any("encoders b1 and b4 are exchanged" in alarm.sentence for alarm in alarms)


# --- output


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


def test_the_window_shows_the_uncertainty_over_the_recording_and_each_alarm_once(
    growing: GrowingRecording, tmp_path: Path
) -> None:
    slip(growing, "b2", 44.6)
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


def test_a_folder_that_is_not_there_is_refused_at_once(tmp_path: Path) -> None:
    """Regression: it was waited for, and the exit code was 0."""
    assert f"{tmp_path / 'mondya'}: no such folder." in refusal("watch", tmp_path / "mondya")


def test_scale_and_priors_stay_and_the_part_of_the_data_falls_until_the_end() -> None:
    scale, by_priors, white, widened = 2e-5, 3e-5, 4e-5, 6e-5
    rest = float(np.sqrt(by_priors**2 + white**2 + widened**2))
    half = replace(ESTIMATE, until=60.0, without_scale=rest, white=white, widened=widened)
    half = replace(half, tcp_sigma=float(np.hypot(rest, scale)))
    fell = white * 0.5**WHITE, widened * 0.5**WIDENED
    expected = np.linalg.norm([scale, by_priors, *fell])
    assert half.at_end(120.0, scale=scale) == pytest.approx(expected)
    assert half.at_end(60.0, scale=scale) == pytest.approx(half.tcp_sigma)
    assert half.at_end(50.0, scale=scale) == pytest.approx(half.tcp_sigma)  # it went on longer
    # where lengths contradict each other, half of the widening is predicted
    apart = replace(ESTIMATE, until=120.0, tcp_sigma=np.hypot(4e-5, 9e-5), without_scale=4e-5)
    assert apart.at_end(120.0, scale=3e-5) == pytest.approx(np.hypot(4e-5, np.sqrt(27e-10)))


@pytest.mark.slow
@pytest.mark.parametrize(
    "loss",
    [
        "gone",
        "description",
        *(pytest.param(loss, marks=pytest.mark.long) for loss in ("short", "empty")),
    ],
)
def test_nothing_is_enough_while_files_that_were_read_cannot_be(
    growing: GrowingRecording, loss: str
) -> None:
    growing.write_until(50.0)
    watch = Watch(growing.folder, accuracy=1.0)
    assert [watch.update(50.0).enough, watch.update(51.0).enough] == [False, True]
    file, described = growing.folder / "raw" / "ballbar.csv", growing.folder / "recording.yaml"
    if loss == "description":
        described.write_text("schema: [")
    elif loss == "gone":
        file.unlink()
    else:
        file.write_bytes(b"" if loss == "empty" else file.read_bytes()[:500])
    states = [watch.update(52.0 + k) for k in range(PATIENCE)]
    assert not any(state.enough for state in states)
    assert [alarm.kind for alarm in states[-1].alarms] == ["refused"]
    assert states[-1].estimate is not None, "what was known is still shown"
    assert not watch.finish(60.0).enough


def test_a_recording_that_begins_again_in_the_same_files_is_a_new_one(
    growing: GrowingRecording, tmp_path: Path, recorded: Recorded
) -> None:
    growing.write_until(50.0)
    watch = Watch(growing.folder, accuracy=1.0)
    watch.update(50.0)
    assert watch.update(51.0).enough
    again = GrowingRecording(recorded.folder, tmp_path / "again", CLOCK)
    for now in (8.0, 9.0):
        again.write_until(now)
        for name in ("robot.csv", "ballbar.csv"):
            (growing.folder / "raw" / name).write_bytes((again.folder / "raw" / name).read_bytes())
        state = watch.update(60.0 + now)
        assert state.estimate is None
        assert not state.enough
        assert state.alarms == ()


def test_encoders_that_come_later_are_fitted_from_then_on(growing: GrowingRecording) -> None:
    text = (growing.folder / "recording.yaml").read_text()
    source = re.search(r"  ballbar:\n(    .*\n)+", text)
    encoders = re.search(r"encoders:\n(  .*\n)+", text)
    alone = text.replace(source[0], "").replace(encoders[0], "encoders: {}\n")
    (growing.folder / "recording.yaml").write_text(alone)
    growing.write_until(40.0)
    watch = Watch(growing.folder)
    watch.update(40.0)
    first = watch.update(41.0)
    (growing.folder / "recording.yaml").write_text(text)
    growing.write_until(43.0)
    second = watch.update(43.0)
    assert first.estimate.clock is None
    assert second.estimate.clock is not None


def test_a_step_is_named_by_a_watch_that_begins_long_after_it_and_so_is_the_next(
    growing: GrowingRecording,
) -> None:
    slip(growing, "b2", 15.0)
    slip(growing, "b4", 44.6)
    before, after = watched(growing, 44.0, 45.0)
    assert [alarm.subject for alarm in before.alarms] == ["encoder b2"]
    assert [alarm.subject for alarm in after.alarms] == ["encoder b2", "encoder b4"]
    assert after.alarms[1].raised > before.alarms[0].raised


def test_fast_logs_of_a_robot_are_judged_from_five_seconds_on() -> None:
    """Fifty rows at 500 Hz are a tenth of a second, of which no dwell can be told."""
    t = 0.002 * np.arange(60)
    log = RobotLog(t=t, q=np.zeros((60, 6)))
    assert standing(Logs(log, None, name="short")) == []


def test_a_fit_that_fails_is_tried_again_later(
    growing: GrowingRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise SingularError("singular")

    growing.write_until(30.0)
    watch = Watch(growing.folder)
    with monkeypatch.context() as patch:
        patch.setattr("ballbar.watch.watch.kinematic_result", fails)
        assert watch.update(30.0).estimate is None
    growing.write_until(50.0)
    assert watch.update(50.0).estimate is not None


def test_a_fit_that_is_of_no_such_machine_is_an_alarm_once_it_is_no_longer_young(
    growing: GrowingRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    def implausible(*given: Any) -> Identification:
        result = kinematic_result(*given)
        return replace(result, verdict=replace(result.verdict, status=Status.IMPLAUSIBLE))

    monkeypatch.setattr("ballbar.watch.watch.kinematic_result", implausible)
    young, later = watched(growing, 25.0, 40.0)
    assert young.alarms == ()
    assert [alarm.kind for alarm in later.alarms] == ["implausible"]


def test_a_process_that_ends_by_itself_has_failed(tmp_path: Path) -> None:
    """Exit code 1 is also that of work that came to no result."""
    beside = WatchBeside(tmp_path / "nowhere", accuracy=None, duration=None)
    assert beside.failure == ""
    beside._process.kill()
    beside._process.wait()
    assert "exit code -9" in beside.failure
    assert beside.finish() is None


def test_ctrl_c_leaves_out_the_last_fit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: a recorder that had ended waited for it for up to two minutes."""
    beside = WatchBeside(tmp_path / "nowhere", accuracy=None, duration=None)
    wait = beside._process.wait

    def interrupted(timeout: float | None = None) -> int:
        if timeout is not None:
            raise KeyboardInterrupt
        return wait()

    monkeypatch.setattr(beside._process, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        beside.finish()
    assert beside._process.poll() is not None
    assert "which `ballbar identify` makes" in beside.failure
