"""Logs that other programs write are recorded row by row: a tracker's, and a robot's beside it."""

from __future__ import annotations

import io
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

from ballbar.acquisition.live.file_source import FileSource
from ballbar.acquisition.live.recorder import LiveRecording
from ballbar.acquisition.live.source import DeviceSilentError, Tally
from ballbar.acquisition.recording import read_recording
from ballbar.acquisition.sources import log_source
from ballbar.cell.errors import InputError
from ballbar.cell.recording import load_recording_file
from ballbar.record.show import Meanwhile, Recorded, RecordOptions, record, record_data
from ballbar.record.terminal import status_table
from ballbar.record.view import layout
from ballbar.watch.beside import WatchBeside
from tests.helpers.command_line import ballbar
from tests.helpers.followed_robot import FollowedRobot

MADE = FollowedRobot(seed=8)


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """The folder of both logs, and their texts aside."""
    return MADE.write(tmp_path / "logs", seconds=12.0)


def source_of(folder: Path, name: str = "tracker") -> FileSource:
    declared = load_recording_file(folder).sources.named[name]  # type: ignore[index]
    return FileSource(log_source(folder, name, declared, axes=6))  # type: ignore[arg-type]


def test_rows_come_once_whole_and_as_written_whatever_the_program_has_flushed(logs: Path) -> None:
    """Cut anywhere, also within a row; those of before the recording are left out."""
    file, rng = logs / "tracker.csv", np.random.default_rng(1)
    text = file.read_bytes()
    lines = text.splitlines(keepends=True)
    old = len(b"".join(lines[:40])) + 7
    file.write_bytes(text[:old])
    source, taken = source_of(logs), list[bytes]()
    source.connect()
    assert source.file_start() == lines[0]
    for end in [*np.sort(rng.integers(old, len(text), 30)), len(text)]:
        file.write_bytes(text[:end])
        taken += source.poll().records
    assert taken == lines[40:]


def test_stamps_and_values_are_shown_in_the_unit_of_the_log(logs: Path) -> None:
    file = logs / "tracker.csv"
    text = file.read_text()
    file.write_text(text.partition("\n")[0] + "\n")
    source = source_of(logs)
    source.connect()
    assert (source.channels, source.unit) == (("x", "y", "z"), "mm")
    file.write_text(text)
    batch, tally = source.poll(), Tally("tracker")
    tally.count(batch)
    np.testing.assert_allclose(batch.values, np.loadtxt(file, delimiter=",", skiprows=1)[:, 1:])
    np.testing.assert_allclose(np.diff(batch.t_ns) * 1e-9, 5e-3, atol=1e-6)
    assert tally.progress.gaps == 0
    assert status_table([tally.progress], 1.0)
    assert len(list(layout([source]).root_container.contents)) == 1
    robot = source_of(logs, "robot")
    assert (robot.channels[:2], robot.unit) == (("q1", "q2"), "rad")


def test_lost_rows_are_counted_as_a_gap_and_damaged_ones_are_kept(logs: Path) -> None:
    file = logs / "tracker.csv"
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(lines[0])
    source, tally = source_of(logs), Tally("tracker")
    source.connect()
    file.write_bytes(b"".join([*lines[:200], *lines[260:400]]))
    batch = source.poll()
    tally.count(batch)
    assert (len(batch.records), tally.progress.gaps) == (339, 1)
    file.write_bytes(b"".join([*lines[:200], *lines[260:400], b"12.5,#N/A,,7\r\n"]))
    assert source.poll().records == [b"12.5,#N/A,,7\r\n"]


def test_a_file_that_is_not_there_is_waited_for_and_one_started_again_is_read_whole(
    logs: Path,
) -> None:
    file = logs / "tracker.csv"
    text = file.read_bytes()
    file.unlink()
    source = source_of(logs)
    with pytest.raises(DeviceSilentError, match=r"tracker\.csv: No such file"):
        source.connect()
    file.write_bytes(b"")
    with pytest.raises(
        DeviceSilentError, match=r"holds no complete line|file is empty|nothing but NUL"
    ):
        source.connect()
    file.write_bytes(text)
    source.connect()
    lines = text.splitlines(keepends=True)
    assert source.poll().records == lines[1:]
    file.write_bytes(b"".join(lines[:30]))
    with pytest.raises(DeviceSilentError, match=r"tracker\.csv was started again"):
        source.poll()
    source.connect()
    assert source.poll().records == lines[1:30]


@pytest.mark.parametrize("files", [["a.csv", "b.csv"], ["a.csv.gz"]])
def test_several_files_and_packed_ones_are_refused(files: list[str], logs: Path) -> None:
    description = yaml.safe_load((logs / "recording.yaml").read_text())
    description["sources"]["tracker"]["files"] = files
    (logs / "recording.yaml").write_text(yaml.safe_dump(description))
    with pytest.raises(InputError, match=r"sources\.tracker\.files: one text file that grows"):
        source_of(logs)


@contextmanager
def growing(folder: Path, *, seconds: float, stops: str = "") -> Iterator[None]:
    """Both programs write what they have, within so many seconds.

    stops : the log of which half comes.
    """
    texts = {name: (folder / f"{name}.csv").read_bytes() for name in ("robot", "tracker")}
    ended = threading.Event()

    def write() -> None:
        begun, share, written = time.monotonic(), 0.0, dict.fromkeys(texts, 0)
        while share < 1.0 and not ended.wait(0.02):
            share = min(1.0, (time.monotonic() - begun - 0.5) / seconds)
            for name, text in texts.items():
                there = 0.5 if name == stops else 1.0
                end = int(len(text) * min(there, share))
                if end > written[name]:
                    with (folder / f"{name}.csv").open("ab") as file:
                        file.write(text[written[name] : end])
                    written[name] = end

    for name in texts:
        (folder / f"{name}.csv").unlink()
    writing = threading.Thread(target=write)
    writing.start()
    try:
        yield
    finally:
        ended.set()
        writing.join()


def until(condition: Callable[[], bool]) -> None:
    """Waits for what takes a second or some, on a busy machine much longer."""
    deadline = time.monotonic() + 90.0
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.05)


def recorded(logs: Path, out: Path, meanwhile: Meanwhile, *, identify: bool = False) -> Recorded:
    """The recording of both logs, which ends when `meanwhile` does."""
    options = RecordOptions(
        plc=None,
        egm=None,
        egm_torque=False,
        robot=None,
        ballbar=None,
        files=logs,
        identify=identify,
    )
    return record(out, options, Console(file=io.StringIO()), meanwhile=meanwhile)


def described(folder: Path, change: Callable[[dict[str, object]], None]) -> None:
    data = yaml.safe_load((folder / "recording.yaml").read_text())
    change(data)
    (folder / "recording.yaml").write_text(yaml.safe_dump(data))


def test_a_tracker_and_a_robot_are_recorded_and_can_be_identified(
    logs: Path, tmp_path: Path
) -> None:
    """The recording is that of both programs, byte by byte, with a dialect of the user's own."""
    whole = {name: (logs / name).read_bytes() for name in ("robot.csv", "tracker.csv")}
    mine = (Path(__file__).parents[2] / "cell/dialects/tracker-points.yaml").read_text()
    (logs / "mine").mkdir()
    (logs / "mine" / "own.yaml").write_text(mine)

    def own(data: dict[str, object]) -> None:
        data["sources"]["tracker"]["dialect"] = "mine/own.yaml"  # type: ignore[index]
        data["temperature_C"] = 21.5

    described(logs, own)
    out = tmp_path / "out"
    lines = {name: content.count(b"\n") - 1 for name, content in whole.items()}

    def all_came(recording: LiveRecording, _beside: WatchBeside | None) -> None:
        until(lambda: all(s.records == lines[f"{s.name}.csv"] for s in recording.progress))

    with growing(logs, seconds=1.0):
        made = recorded(logs, out, all_came)
    said = record_data(out, made)
    assert said["missing"] == []
    sources: Any = said["sources"]
    assert (sources["tracker"]["records"], sources["tracker"]["lost"]) == (lines["tracker.csv"], 0)
    for name, content in whole.items():
        assert (out / "raw" / name).read_bytes() == content
    read, kept = read_recording(out), load_recording_file(out)
    assert (kept.instrument, kept.robot, kept.temperature_C) == ("tracker_point", "ur10e", 21.5)
    assert kept.sources.tracker is not None
    assert kept.sources.tracker.dialect == "own.yaml"
    assert read.tracker_log is not None
    assert read.tracker_log.t.size == 2200
    code, text, err = ballbar("identify", out, "--out", tmp_path / "result")
    assert code in (0, 1), err
    assert "1 seat and 1 target" in text


@pytest.mark.slow
def test_a_log_of_which_nothing_comes_is_named_with_exit_code_1(logs: Path, tmp_path: Path) -> None:
    with growing(logs, seconds=1.0):
        (logs / "recording.yaml").write_text(
            (logs / "recording.yaml").read_text().replace("[tracker.csv]", "[other.csv]")
        )
        code, text, _ = ballbar("record", tmp_path / "out", "--files", logs, "--duration", "2")
    assert code == 1
    assert "tracker: delivered nothing" in text
    assert "Still missing: the rows of sources.tracker." in text


@pytest.mark.slow
def test_a_stream_that_stops_raises_an_alarm_while_it_is_recorded(tmp_path: Path) -> None:
    """The recording ends as soon as the alarm is there: five seconds behind the last row."""
    logs = MADE.write(tmp_path / "logs", seconds=12.0)
    raised = list[dict[str, str]]()

    def alarm_raised(_recording: LiveRecording, beside: WatchBeside | None) -> None:
        assert beside is not None

        def here() -> bool:
            alarms = beside.latest["alarms"] if beside.latest else ()
            raised.extend(alarm for alarm in alarms if alarm["subject"] == "raw/tracker.csv")
            return bool(raised or beside.failure)

        until(here)

    with growing(logs, seconds=2.0, stops="tracker"):
        recorded(logs, tmp_path / "out", alarm_raised, identify=True)
    assert raised[0]["kind"] == "silent"
    assert re.match(r"raw/tracker\.csv: no new row for \d+ s", raised[0]["sentence"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--robot", "ur10e"), "recording.yaml in that folder names robot and instrument"),
        (("--plc", "5.12.82.20.1.1"), "tracker_point has no encoders that a PLC reads"),
    ],
)
def test_options_that_contradict_the_folder_are_refused(
    options: tuple[str, ...], words: str, logs: Path, tmp_path: Path
) -> None:
    code, _, error = ballbar("record", tmp_path / "out", "--files", logs, *options)
    assert code == 2
    assert words in error
    assert not (tmp_path / "out").exists()


def test_an_instrument_without_encoders_is_recorded_by_the_file_of_its_program(
    tmp_path: Path,
) -> None:
    options = ("--egm", "6510", "--robot", "irb2400", "--ballbar", "tracker_point")
    code, _, error = ballbar("record", tmp_path / "out", *options)
    assert code == 2
    assert "name that folder with --files" in error
    code, _, error = ballbar("record", tmp_path / "out", "--egm", "6510")
    assert code == 2
    assert "name the robot with --robot" in error


def test_rows_that_repeat_a_lost_target_are_left_out(logs: Path) -> None:
    """Motion capture keeps a body that it no longer sees where it was; it was called motion."""
    file = logs / "tracker.csv"
    lines = file.read_text().splitlines(keepends=True)
    frozen = lines[900].partition(",")[2]
    for k in range(901, 1200):
        lines[k] = lines[k].partition(",")[0] + "," + frozen
    file.write_text("".join(lines))
    read = read_recording(logs)
    assert read.tracker_log is not None
    assert read.tracker_log.t.size == len(lines) - 1 - 299
    (found,) = [f for f in read.report.findings if f.kind == "frozen channel"]
    assert "columns x, y, z repeat one value in lines 902 to 1200" in found.sentence
