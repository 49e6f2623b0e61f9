"""Whoever else sends to a recorder, on loopback: it does not end, nor hang, nor take it as data."""

from __future__ import annotations

import os
import random
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from acquisition.live import egm_source
from acquisition.live.egm_source import EgmSource
from acquisition.live.folder import CellNames, RecordingFolder
from acquisition.live.session import LiveRecording
from acquisition.recording import read_recording
from tests.helpers.egm_robot import egm_message, frames_of

CELL = CellNames("irb2400", "lund_600", "plate_250", 3600)
ADS_PORT = 48898


@pytest.fixture
def egm() -> Iterator[EgmSource]:
    source = EgmSource(0)
    yield source
    source.close()


def joints(n: int) -> list[float]:
    return [10.0 * np.sin(0.01 * n + j) for j in range(6)]


def sent_to(egm: EgmSource, *messages: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for message in messages:
            sender.sendto(message, egm.address)


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < deadline, "waited too long"
        time.sleep(0.02)


def test_every_truncated_egm_message_is_left_out_or_decoded_never_fatal(egm: EgmSource) -> None:
    egm.connect()
    whole = egm_message(7, joints(7))
    sent_to(egm, *(whole[:length] for length in range(len(whole))))
    batch = egm.poll()
    assert len(batch.records) + batch.refused == len(whole)
    assert batch.refused > len(whole) // 2
    assert np.isfinite(batch.values).all()


def test_numbers_at_the_ends_of_their_range_are_no_faults_of_the_program(egm: EgmSource) -> None:
    egm.connect()

    def field(number: int, value: int) -> bytes:
        out = bytes([number << 3])
        while value > 127:
            out, value = out + bytes([value & 127 | 128]), value >> 7
        return out + bytes([value])

    def nested(number: int, content: bytes) -> bytes:
        return bytes([number << 3 | 2, len(content)]) + content

    angles = nested(1, b"".join(b"\x09" + struct.pack("<d", 1.0) for _ in range(6)))
    for seconds in (0, 1, 2**31, 2**33, 2**63, 2**64 - 1):
        for seqno in (0, 2**32 - 1, 2**64 - 1):
            clock = nested(4, field(1, seconds) + field(2, 2**64 - 1))
            sent_to(egm, nested(1, field(1, seqno)) + nested(2, angles + clock))
    batches = [egm.poll() for _ in range(20)]
    assert sum(len(batch.records) + batch.refused for batch in batches) == 18


def test_a_replayed_stretch_of_egm_is_a_session_of_its_own_and_reported(
    egm: EgmSource, tmp_path: Path
) -> None:
    recording = LiveRecording(RecordingFolder(tmp_path / "r", CELL), (egm,))
    recording.start()
    messages = [egm_message(n, joints(n)) for n in range(1, 201)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for message in [*messages, *messages[100:150]]:  # by the same sender
            robot.sendto(message, egm.address)
        until(lambda: recording.progress[0].records == 250)
    recording.finish()
    raw = tmp_path / "r" / "raw"
    assert frames_of((raw / "robot.egm").read_bytes()) == messages
    assert frames_of((raw / "robot_2.egm").read_bytes()) == messages[100:150]
    assert recording.progress[0].segments == 2


def test_a_flood_ends_no_recording_and_fills_no_memory(egm: EgmSource) -> None:
    egm.connect()
    sent_to(egm, egm_message(1, joints(1)))
    egm.poll()
    large = egm_message(2, joints(2)) + b"\x7a\xff\x7f" + bytes(16383)  # an unknown field
    stop = threading.Event()

    def flood() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            while not stop.is_set():
                stranger.sendto(large, egm.address)

    senders = [threading.Thread(target=flood) for _ in range(2)]
    for sender in senders:
        sender.start()
    try:
        refused, longest = 0, 0.0
        deadline = time.monotonic() + 20.0
        while refused <= 100 and time.monotonic() < deadline:
            begin = time.monotonic()
            batch = egm.poll()
            longest = max(longest, time.monotonic() - begin)
            assert not batch.records
            refused += batch.refused
    finally:
        stop.set()
        for sender in senders:
            sender.join()
    assert refused > 100
    assert longest < 2.0
    assert egm_source._read(large) is None, "too long for a robot's"


def test_an_egm_clock_that_goes_back_is_reported_where_it_does(
    egm: EgmSource, tmp_path: Path
) -> None:
    recording = LiveRecording(RecordingFolder(tmp_path / "r", CELL), (egm,))
    recording.start()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        for n in range(1, 401):
            clock = n if n <= 250 else n - 200  # set back by 0.8 s; the numbers go on
            message = egm_message(clock, joints(n))
            robot.sendto(renumbered(message, clock, n), egm.address)
        until(lambda: recording.progress[0].records == 400)
    recording.finish()
    read = read_recording(tmp_path / "r")
    assert read.robot_log.t.size == 400
    assert (np.diff(read.robot_log.t) > 0.0).all()
    (entry,) = (f for f in read.report.findings if f.kind == "clock set back")
    assert entry.lines == (251,)


def renumbered(message: bytes, before: int, after: int) -> bytes:
    """An EGM message with another sequence number."""

    def varint(value: int) -> bytes:
        return bytes([value & 127 | 128, value >> 7]) if value > 127 else bytes([value])

    header = message[: message.index(b"\x12")]
    body = message[2 : 2 + message[1]].replace(b"\x08" + varint(before), b"\x08" + varint(after), 1)
    assert header[:1] == b"\x0a"
    return b"\x0a" + bytes([len(body)]) + body + message[2 + message[1] :]


@contextmanager
def hostile_plc(address: str, serve: Callable[[socket.socket], None]) -> Iterator[None]:
    """A server at the port of ADS that does to each client what it likes."""
    server = socket.create_server((address, ADS_PORT))
    server.settimeout(0.2)
    stop = threading.Event()

    def accept() -> None:
        while not stop.is_set():
            try:
                client, _ = server.accept()
            except OSError:
                continue
            with client:
                client.settimeout(1.0)
                try:
                    serve(client)
                except OSError:
                    continue

    thread = threading.Thread(target=accept)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        server.close()


def hung_up(client: socket.socket) -> None:
    client.recv(100)


def noise(client: socket.socket) -> None:
    client.sendall(random.Random(1).randbytes(100_000))


def endless_length(client: socket.socket) -> None:
    client.recv(100)
    client.sendall(struct.pack("<HI", 0, 0xFFFFFFFF) + bytes(10_000))


def replayed_request(client: socket.socket) -> None:
    request = client.recv(1000)
    for _ in range(1000):
        client.sendall(request)


def truncated_answer(client: socket.socket) -> None:
    request = client.recv(1000)
    client.sendall(request[: len(request) // 2])


@pytest.mark.slow
@pytest.mark.parametrize(
    "serve",
    [
        endless_length,
        *(
            pytest.param(serve, marks=pytest.mark.long)
            for serve in (hung_up, noise, replayed_request, truncated_answer)
        ),
    ],
)
def test_a_hostile_plc_neither_ends_nor_fills_the_recorder(
    serve: Callable[[socket.socket], None], tmp_path: Path
) -> None:
    pid = os.getpid()
    address = f"127.{1 + pid // 62500 % 250}.{1 + pid // 250 % 250}.{1 + pid % 250}"
    command = [sys.executable, "-m", "ballbar", "record", str(tmp_path / "r")]
    command += ["--robot", "irb2400", "--ballbar", "lund_600", "--plc", f"{address}.1.1"]
    with hostile_plc(address, serve), (tmp_path / "said").open("wb") as said:
        recorder = subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT)
        time.sleep(5.0)
        assert recorder.poll() is None, (tmp_path / "said").read_text()
        # of the program itself; the usage of a child begins with what its parent holds
        status = Path(f"/proc/{recorder.pid}/status").read_text()
        recorder.send_signal(signal.SIGINT)
        recorder.wait(30.0)
    text = (tmp_path / "said").read_text(errors="replace")
    assert recorder.returncode == 1, text
    assert "Traceback" not in text
    (most,) = re.findall(r"VmHWM:\s*(\d+) kB", status)
    assert int(most) < 400_000
    assert not list(tmp_path.glob("r/raw/*"))
