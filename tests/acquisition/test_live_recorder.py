"""The live recorder on loopback: nothing lost or doubled, files readable wherever it broke off."""

from __future__ import annotations

import re
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from ballbar.acquisition.live.ads import AdsMemory
from ballbar.acquisition.live.egm_source import EgmSource
from ballbar.acquisition.live.folder import CellNames, RecordingFolder, SegmentFile
from ballbar.acquisition.live.plc_source import PlcSource
from ballbar.acquisition.live.recorder import POLL, LiveRecording, Recorder
from ballbar.acquisition.live.source import Batch, RecorderState, Source, Tally
from ballbar.acquisition.recording import read_recording
from ballbar.cell.errors import InputError
from ballbar.cell.load import load_robot
from ballbar.cell.plc_ring import HEADER, LAYOUT, RING, SAMPLE
from ballbar.cell.recording import load_recording_file
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.sim.live.plc import loopback_address
from tests.helpers.command_line import ballbar
from tests.helpers.egm_robot import egm_message, frames_of
from tests.helpers.plc_server import Plc, numbers_of
from tests.helpers.ring_memory import RingMemory
from tests.helpers.source_imports import ROOT, imported

CELL = CellNames("irb2400", "lund_600", "plate_250", 3600)
LINES = 3600
NAMES = ("--robot", "irb2400", "--ballbar", "lund_600")
PATIENCE = 20.0  # [s] a busy machine may take for what needs a fraction of it


@pytest.fixture
def address() -> str:
    """A loopback address that no other test process uses: the port of ADS is fixed."""
    return loopback_address()


@pytest.fixture
def egm() -> Iterator[EgmSource]:
    source = EgmSource(0)
    yield source
    source.close()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def plc_source(plc: Plc) -> PlcSource:
    return PlcSource(AdsMemory(plc.net_id, 851, symbol=RING), lines=LINES)


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited too long"
        time.sleep(0.02)


def started(folder: Path, *sources: Source) -> LiveRecording:
    recording = LiveRecording(RecordingFolder(folder, CELL), sources)
    recording.start()
    return recording


def recorder_command(folder: Path, plc: Plc) -> list[str]:
    return [sys.executable, "-m", "ballbar", "record", str(folder), *NAMES, "--plc", plc.net_id]


def with_robot_log(folder: Path) -> Path:
    """The recording, with the robot's log added manually as the recorder asks for."""
    t = np.arange(200) * 0.004032
    motors = np.sin(np.outer(t, np.arange(1, 7))) * 20.0
    rows = [
        ",".join(f"{value:.6f}" for value in (time_s, *row))
        for time_s, row in zip(t, motors, strict=True)
    ]
    (folder / "raw" / "robot.csv").write_text("\n".join(["time,m1,m2,m3,m4,m5,m6", *rows, ""]))
    description = yaml.safe_load((folder / "recording.yaml").read_text())
    description["sources"]["robot"] = {"files": ["raw/robot.csv"], "dialect": "abb-motor"}
    (folder / "recording.yaml").write_text(yaml.safe_dump(description))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("rate", [100, 1000])
def test_what_the_plc_made_is_in_the_file_once_byte_by_byte(
    rate: int, address: str, tmp_path: Path
) -> None:
    with Plc(address, rate) as plc:
        recording = started(tmp_path / "r", plc_source(plc))
        until(lambda: recording.progress[0].records > 1.5 * rate)
        made = plc.written
        recording.stop()
        recording.finish()
        _, last = numbers_of((tmp_path / "r" / "raw" / "ballbar.csv").read_bytes(), plc)
    assert last >= made - 1
    (progress,) = recording.progress
    assert progress.state is RecorderState.END
    assert (progress.segments, progress.lost, progress.gaps) == (1, 0, 0)
    # By the stamps, so it does not depend on the machine's load.
    assert progress.rate == pytest.approx(rate, rel=0.01)
    read = read_recording(with_robot_log(tmp_path / "r"))
    assert read.ballbar_log is not None
    assert read.ballbar_log.t.size == progress.records
    assert read.ballbar_log.joints == (1, 2, 4, 5)
    assert not [finding for finding in read.report.findings if "robot" not in finding.file]


@pytest.mark.slow
def test_a_connection_that_is_lost_and_comes_back_makes_a_new_file_and_loses_nothing(
    address: str, tmp_path: Path
) -> None:
    with Plc(address, 100) as plc:
        recording = started(tmp_path / "r", plc_source(plc))
        until(lambda: recording.progress[0].records > 30)
        plc.disconnect()
        until(lambda: recording.progress[0].state is RecorderState.WAIT)
        plc.connect()
        until(lambda: recording.progress[0].segments == 2 and recording.progress[0].records > 100)
        recording.finish()
        first, second = (
            numbers_of((tmp_path / "r" / "raw" / name).read_bytes(), plc)
            for name in ("ballbar.csv", "ballbar_2.csv")
        )
    assert second[0] == first[1] + 1  # the ring held what was made meanwhile
    (progress,) = recording.progress
    assert (progress.lost, progress.records) == (0, second[1] - first[0] + 1)
    description = yaml.safe_load((tmp_path / "r" / "recording.yaml").read_text())
    assert description["sources"]["ballbar"]["files"] == ["raw/ballbar.csv", "raw/ballbar_2.csv"]
    assert "ballbar: segment 1 ended: PLC" in description["notes"]
    read = read_recording(with_robot_log(tmp_path / "r"))
    assert read.ballbar_log is not None
    assert read.ballbar_log.t.size == progress.records


@pytest.mark.slow
def test_kill_9_loses_at_most_the_last_poll(address: str, tmp_path: Path) -> None:
    """A poll is on disk before the next begins: within 0.2 s, on a machine that keeps up."""
    folder, file = tmp_path / "r", tmp_path / "r" / "raw" / "ballbar.csv"
    with Plc(address, 1000) as plc:
        recorder = subprocess.Popen(
            recorder_command(folder, plc), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        until(lambda: file.exists() and file.stat().st_size > 50_000)
        recorder.send_signal(signal.SIGKILL)
        recorder.wait()
        polls = plc.header_reads
        raw = file.read_bytes()
        whole = raw[: raw.rindex(b"\n") + 1]
        _, last = numbers_of(whole, plc)
    assert last >= polls[-4] - 1  # of the last poll but one; each poll looks twice
    assert POLL <= 0.1
    read = read_recording(with_robot_log(folder))
    assert read.ballbar_log is not None
    assert read.ballbar_log.t.size == len(whole.splitlines()) - 1


@pytest.mark.slow
def test_a_full_disk_is_named_and_leaves_a_file_of_whole_rows(address: str, tmp_path: Path) -> None:
    folder, limit = tmp_path / "r", 30_001
    with Plc(address, 1000) as plc:
        recorder = subprocess.run(
            recorder_command(folder, plc),
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        )
        raw = (folder / "raw" / "ballbar.csv").read_bytes()
        numbers_of(raw, plc)
    rows = len(raw.splitlines()) - 1
    assert recorder.returncode == 1
    assert (
        f"raw/ballbar.csv: cannot be written: File too large. {rows} whole records are in it"
        in recorder.stderr
    )
    longest = 18 + 8 * 11 + 2  # a stamp, eight counters of ten digits, CRLF
    assert limit - longest < len(raw) <= limit
    read = read_recording(with_robot_log(folder))
    assert read.ballbar_log is not None
    assert read.ballbar_log.t.size == rows


@pytest.mark.slow
def test_ctrl_c_ends_cleanly_and_says_what_is_missing(address: str, tmp_path: Path) -> None:
    folder = tmp_path / "r"
    with Plc(address, 100) as plc:
        recorder = subprocess.Popen(
            recorder_command(folder, plc),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        until((folder / "recording.yaml").exists)
        made = plc.written
        recorder.send_signal(signal.SIGINT)
        said, _ = recorder.communicate(timeout=PATIENCE)
        _, last = numbers_of((folder / "raw" / "ballbar.csv").read_bytes(), plc)
    assert recorder.returncode == 0
    assert last >= made - 1
    assert "0 lost, 0 gaps" in said
    assert "Still missing: the robot's log" in said


def test_egm_messages_are_kept_as_they_came_and_lost_ones_counted(
    egm: EgmSource, tmp_path: Path
) -> None:
    recording = started(tmp_path / "r", egm)
    messages = [egm_message(n, [10.0 * j + 1e-3 * n for j in range(6)]) for n in range(100, 300)]
    dropped, swapped = 50, 80
    sent = [*messages[:dropped], *messages[dropped + 3 :]]
    sent[swapped], sent[swapped + 1] = sent[swapped + 1], sent[swapped]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for message in sent:
            robot.sendto(message, egm.address)
        until(lambda: recording.progress[0].records == len(sent))
    recording.finish()
    assert frames_of((tmp_path / "r" / "raw" / "robot.egm").read_bytes()) == sent
    (progress,) = recording.progress
    assert (progress.lost, progress.refused, progress.segments) == (3, 0, 1)
    assert progress.latest is not None
    assert progress.latest.tolist() == pytest.approx([10.0 * j + 0.299 for j in range(6)])
    description = load_recording_file(tmp_path / "r")
    assert description.sources.robot.dialect == "abb-egm"
    assert description.encoders == {}


def test_a_new_egm_session_goes_into_a_new_file(egm: EgmSource, tmp_path: Path) -> None:
    recording = started(tmp_path / "r", egm)
    sessions = [[egm_message(n, [0.0] * 6) for n in range(first, first + 60)] for first in (500, 1)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for message in [*sessions[0], *sessions[1]]:
            robot.sendto(message, egm.address)
        until(lambda: recording.progress[0].records == 120)
    recording.finish()
    files = [tmp_path / "r" / "raw" / name for name in ("robot.egm", "robot_2.egm")]
    assert [frames_of(file.read_bytes()) for file in files] == sessions
    assert recording.progress[0].lost == 0


def test_what_is_no_egm_message_or_comes_from_elsewhere_is_left_out_and_counted(
    egm: EgmSource, tmp_path: Path
) -> None:
    recording = started(tmp_path / "r", egm)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        robot.sendto(b"\xff\xff not protobuf", egm.address)
        robot.sendto(egm_message(1, [0.0] * 6), egm.address)
        until(lambda: recording.progress[0].records == 1)
        stranger.sendto(egm_message(2, [9.0] * 6), egm.address)
        robot.sendto(b"", egm.address)
        robot.sendto(egm_message(2, [0.0] * 6), egm.address)
        until(lambda: recording.progress[0].records == 2 and recording.progress[0].refused == 3)
    recording.finish()
    assert frames_of((tmp_path / "r" / "raw" / "robot.egm").read_bytes()) == [
        egm_message(n, [0.0] * 6) for n in (1, 2)
    ]


def test_the_receiver_listens_on_this_machine_alone_by_default(egm: EgmSource) -> None:
    host, port = egm.address
    assert host == "127.0.0.1"
    with pytest.raises(InputError, match=rf"--egm 127.0.0.1:{port}: another program listens there"):
        EgmSource(port)


@pytest.mark.slow
def test_both_devices_make_a_complete_recording(
    address: str, egm: EgmSource, tmp_path: Path
) -> None:
    angles = [[10.0 * np.sin(0.01 * n + j) for j in range(6)] for n in range(80)]
    with Plc(address, 1000) as plc, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        recording = started(tmp_path / "r", plc_source(plc), egm)
        for n, joints in enumerate(angles):
            robot.sendto(egm_message(n, joints), egm.address)
        until(lambda: min(source.records for source in recording.progress) >= 80)
        recording.finish()
    assert recording.missing == ()
    read = read_recording(tmp_path / "r")
    robot_file = load_robot("irb2400")
    assert np.allclose(
        controller_to_joints(robot_file, np.deg2rad(angles)), read.robot_log.q, atol=1e-12
    )
    assert np.allclose(
        read.robot_log.t, np.arange(80) * 0.004032, atol=1e-6
    )  # the message has microseconds
    assert read.ballbar_log is not None
    assert read.ballbar_log.t.size == recording.progress[0].records
    fitted = {
        name: (encoder.lines, encoder.bits) for name, encoder in read.description.encoders.items()
    }
    assert fitted == dict.fromkeys(("b1", "b2", "b4", "b5"), (3600, 12))


def test_a_plc_that_is_not_there_is_waited_for_and_named(address: str, tmp_path: Path) -> None:
    recording = started(
        tmp_path / "r", PlcSource(AdsMemory(f"{address}.1.1", 851, symbol=RING), lines=LINES)
    )
    until(lambda: bool(recording.progress[0].reason))
    assert f"PLC {address}.1.1:851" in recording.progress[0].reason
    recording.finish()
    assert recording.progress[0].records == 0
    assert not (tmp_path / "r" / "recording.yaml").exists()


@pytest.mark.slow
def test_a_live_view_that_fails_does_not_end_the_recording(egm: EgmSource, tmp_path: Path) -> None:
    def fail(source: Source, batch: Batch) -> None:
        raise ConnectionError("no window")

    recording = LiveRecording(RecordingFolder(tmp_path / "r", CELL), [egm], on_batch=fail)
    recording.start()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for n in range(2):
            robot.sendto(egm_message(n, [0.0] * 6), egm.address)
            until(lambda n=n: recording.progress[0].records == n + 1)
    recording.finish()
    assert (
        "robot: the live view ended: no window."
        in yaml.safe_load((tmp_path / "r" / "recording.yaml").read_text())["notes"]
    )


class KilledError(BaseException):
    """Stands for SIGKILL: nothing that follows is done."""


@pytest.mark.parametrize("at", ["declare", "append", "declared"])
def test_a_recorder_killed_at_its_first_record_leaves_a_recording_or_nothing(
    at: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed between its first rows and recording.yaml it left rows that nothing could read."""
    memory = RingMemory(Plc("", 1000, capacity=2000))
    own = tmp_path / "own.yaml"
    own.write_text("schema: ballbar-robot/1\n")
    folder = RecordingFolder(tmp_path / "r", CELL, [own])
    source = PlcSource(memory, lines=LINES)
    recorder = Recorder(source, folder, threading.Event())

    def killed(*_: object) -> None:
        raise KilledError

    with monkeypatch.context() as patch:
        patch.setattr(Recorder, "_close_file", lambda _: None)
        patch.setattr(PlcSource, "disconnect", lambda _: None)
        if at == "declare":
            patch.setattr("ballbar.acquisition.live.folder.write_yaml", killed)
            (tmp_path / "r" / ".recording.yaml.part").write_text("schema: ballb")
        elif at == "append":
            patch.setattr(SegmentFile, "append", killed)
        else:
            patch.setattr(Tally, "count", killed)
        source.connect()
        memory.plc.write(50)
        patch.setattr(PlcSource, "connect", lambda _: None)
        with pytest.raises(KilledError):
            recorder.run()
    rows = (tmp_path / "r" / "raw" / "ballbar.csv").read_bytes().splitlines()[1:]
    assert len(rows) == (50 if at == "declared" else 0)
    if rows:
        assert (tmp_path / "r" / "recording.yaml").is_file()
        with pytest.raises(InputError, match="exists already"):
            RecordingFolder(tmp_path / "r", CELL, [own])
    else:
        RecordingFolder(tmp_path / "r", CELL, [own])
        names = {path.name for path in (tmp_path / "r").rglob("*")}
        assert names == {"raw", "own.yaml"}


def test_a_first_record_that_finds_the_disk_full_leaves_a_folder_to_record_into(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory = RingMemory(Plc("", 1000, capacity=2000))
    source = PlcSource(memory, lines=LINES)
    recorder = Recorder(source, RecordingFolder(tmp_path / "r", CELL), threading.Event())
    source.connect()
    memory.plc.write(50)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(PlcSource, "connect", lambda _: None)
        patch.setattr(SegmentFile, "append", full)
        recorder.run()
    assert "No space left on device" in str(recorder.failure)
    assert not list((tmp_path / "r" / "raw").iterdir())
    RecordingFolder(tmp_path / "r", CELL)


def test_a_folder_that_holds_something_is_not_recorded_into(tmp_path: Path) -> None:
    (tmp_path / "recording.yaml").write_text("schema: ballbar-recording/1\n")
    with pytest.raises(InputError, match="exists already; nothing was written"):
        RecordingFolder(tmp_path, CELL)


@pytest.mark.slow
def test_only_one_module_needs_the_extra() -> None:
    files = [
        file for package in ("acquisition", "ballbar") for file in (ROOT / package).rglob("*.py")
    ]
    assert [file.name for file in files if "pyads" in imported(file)] == ["ads.py"]


PROGRAM = ROOT / "docs" / "plc" / "ball_bar.st"
SIZES = {"ULINT": "<u8", "UDINT": "<u4", "UINT": "<u2"}


def structure(name: str) -> np.dtype[np.void]:
    """A structure of the Structured Text listing, members aligned as TwinCAT does it."""
    listing = PROGRAM.read_text()
    body = re.search(rf"TYPE ST_{name} :\nSTRUCT\n(.*?)END_STRUCT", listing, re.DOTALL)
    assert body
    members: list[tuple[str, object, int]] = []
    for member, low, high, kind in re.findall(
        r"(\w+)\s*: (?:ARRAY\[(\d)\.\.(\d+)\] OF )?(\w+);", body[1]
    ):
        count = int(high) - int(low) + 1 if high else 1
        element = (
            structure(kind.removeprefix("ST_")) if kind.startswith("ST_") else np.dtype(SIZES[kind])
        )
        members.append((member[1:].lower(), element, count))
    return np.dtype(
        [
            (name, element) if count == 1 else (name, element, count)
            for name, element, count in members
        ],
        align=True,
    )


def test_the_listing_for_the_plc_has_the_layout_that_the_recorder_reads() -> None:
    assert structure("BallBarSample") == np.dtype(SAMPLE.descr, align=True)
    assert structure("BallBarSample").itemsize == SAMPLE.itemsize
    ring = structure("BallBarRing")
    assert ring.fields is not None
    header = [(name, ring.fields[name][0].str, ring.fields[name][1]) for name in HEADER.names]
    assert header == [
        (name, HEADER.fields[name][0].str, HEADER.fields[name][1]) for name in HEADER.names
    ]
    assert ring.fields["sample"][1] == HEADER.itemsize
    assert f"nLayout := 16#{LAYOUT:X};" in PROGRAM.read_text()
    assert f"CAPACITY : UDINT := {ring.fields['sample'][0].shape[0]};" in PROGRAM.read_text()
    assert "stRing : ST_BallBarRing;" in PROGRAM.read_text()
    assert RING == "GVL_BallBar.stRing"


def test_torques_come_by_egm_only_where_that_is_declared(tmp_path: Path) -> None:
    for torque, dialect in ((False, "abb-egm"), (True, "abb-egm-torque")):
        source = EgmSource(0, torque=torque)
        assert source.entry == {"dialect": dialect}
        source.close()
    code, _, error = ballbar(
        "record", tmp_path / "made", "--robot", "irb2400", "--ballbar", "lund_600",
        "--plc", "5.12.82.20.1.1", "--egm-torque",
    )  # fmt: skip
    assert code == 2
    assert "--egm-torque: belongs to --egm, which is not named" in error
