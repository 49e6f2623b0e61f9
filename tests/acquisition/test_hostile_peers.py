"""Other senders to a recorder, on loopback, neither end it nor hang it, nor become its data."""

from __future__ import annotations

import itertools
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
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
import yaml

from ballbar.acquisition.live import ads, egm_source, recorder
from ballbar.acquisition.live.egm_source import EgmSource
from ballbar.acquisition.live.folder import CellNames, RecordingFolder
from ballbar.acquisition.live.plc_source import PlcSource
from ballbar.acquisition.live.recorder import LiveRecording
from ballbar.acquisition.live.source import DeviceSilentError, RecorderState
from ballbar.acquisition.recording import read_recording
from ballbar.cell.plc_ring import RING
from ballbar.sim.live.plc import loopback_address
from tests.helpers import ads_proxy
from tests.helpers.egm_robot import egm_message, frames_of
from tests.helpers.plc_server import Plc, numbers_of

CELL = CellNames("irb2400", "lund_600", "plate_250", 3600)


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
    decoded = refused = 0
    while decoded + refused < len(whole):  # a poll on a busy machine ends before all are read
        batch = egm.poll()
        assert batch.records or batch.refused
        assert np.isfinite(batch.values).all()
        decoded, refused = decoded + len(batch.records), refused + batch.refused
    assert decoded + refused == len(whole)
    assert refused > len(whole) // 2


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
    server = socket.create_server((address, ads_proxy.ADS_PORT))
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
    served = threading.Event()

    def serve_and_say(client: socket.socket) -> None:
        serve(client)
        served.set()

    with hostile_plc(address, serve_and_say), (tmp_path / "said").open("wb") as said:
        recorder = subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT)
        assert served.wait(60.0)
        time.sleep(1.0)  # in which it would fill its memory
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


def answer(frame: bytes, data: bytes) -> bytes:
    """An answer to a read with other data, all its lengths right."""
    return b"".join(
        (
            frame[:2],
            struct.pack("<I", ads_proxy.AMS_HEADER + 8 + len(data)),
            frame[6:26],
            struct.pack("<I", 8 + len(data)),
            frame[30:42],
            struct.pack("<I", len(data)),
            data,
        )
    )


def as_answer_to(latest: bytes, earlier: bytes) -> bytes:
    """An earlier answer with the number of the latest request."""
    return earlier[:34] + latest[34:38] + earlier[38:]


def meddling(kind: str, answers: Sequence[bytes], rng: random.Random) -> bytes:
    """The answer that a recorder gets in place of its PLC's latest one."""
    latest, data = answers[-1], answers[-1][ads_proxy.DATA :]
    match kind:
        case "a second sender":
            return latest[:14] + bytes([9, 9, 9, 9, 1, 1]) + latest[20:] + latest
        case "twice":
            return 2 * latest
        case "replayed":
            return as_answer_to(latest, rng.choice(answers))
        case "flooded":
            numbers = rng.sample(range(2**32), 500)
            return b"".join(latest[:34] + struct.pack("<I", n) + latest[38:] for n in numbers)
        case "too short":
            return answer(latest, data[: rng.randrange(len(data))])
        case "too long":
            return answer(latest, data + bytes(1000))
        case "lying length":
            return latest[:42] + struct.pack("<I", rng.choice([0, 5, 10**6, 2**32 - 1])) + data
        case "damaged head":
            at = rng.randrange(ads_proxy.DATA)
            return latest[:at] + bytes([latest[at] ^ 1 << rng.randrange(8)]) + latest[at + 1 :]
    return latest[: rng.randrange(len(latest))]  # truncated


MEDDLING = (
    "a second sender", "twice", "replayed", "flooded", "too short", "too long", "lying length",
    "damaged head", "truncated",
)  # fmt: skip


@pytest.fixture
def brisk(monkeypatch: pytest.MonkeyPatch) -> None:
    """A recorder that gives a silent PLC less time."""
    monkeypatch.setattr(ads, "TIMEOUT_MS", 100)
    monkeypatch.setattr(recorder, "RETRY", 0.02)


@pytest.mark.long
@pytest.mark.usefixtures("brisk")
def test_no_row_comes_from_whoever_meddles_with_the_answers_of_a_plc(tmp_path: Path) -> None:
    """Every tenth answer, by all kinds in turn; what the PLC made is in the files once."""
    rng, met = random.Random(3), Counter[str]()

    def meddle(answers: Sequence[bytes]) -> bytes:
        if len(answers) < 5 or rng.random() > 0.1:
            return answers[-1]
        kind = MEDDLING[met.total() % len(MEDDLING)]
        met[kind] += 1
        return meddling(kind, answers, rng)

    with plc_behind(meddle) as (plc, source):
        recording = LiveRecording(RecordingFolder(tmp_path / "r", CELL), (source,))
        recording.start()
        until(lambda: len(met) == len(MEDDLING) and min(met.values()) > 1)
        until(lambda: recording.progress[0].reason == "")
        recording.stop()
        recording.finish()
        declared = yaml.safe_load((tmp_path / "r/recording.yaml").read_text())["sources"]["ballbar"]
        files = [tmp_path / "r" / name for name in declared["files"]]
        parts = [numbers_of(file.read_bytes(), plc) for file in files]
    assert len(parts) > 1
    (progress,) = recording.progress
    assert sum(last - first + 1 for first, last in parts) == progress.records
    gaps = sum(b[0] - a[1] - 1 for a, b in itertools.pairwise(parts))
    assert gaps == progress.lost
    assert all(b[0] > a[1] for a, b in itertools.pairwise(parts))


@contextmanager
def plc_behind(meddle: Callable[[Sequence[bytes]], bytes]) -> Iterator[tuple[Plc, PlcSource]]:
    """A PLC with 1 kHz, and a recorder's way to it, on which somebody sits."""
    address = loopback_address()
    between = re.sub(r"\.\d+$", ".254", address)
    with Plc(address, 1000) as plc, ads_proxy.AdsProxy(between, address, meddle):
        memory = ads.AdsMemory(plc.net_id, 851, symbol=RING, host=between)
        yield plc, PlcSource(memory, lines=3600)


@pytest.mark.usefixtures("brisk")
def test_what_a_plc_says_of_its_variable_may_be_damaged_or_in_any_encoding() -> None:
    """A comment in UTF-8, or noise, ended the recording with an error of decoding."""
    rng = random.Random(1)

    def meddle(answers: Sequence[bytes]) -> bytes:
        damaged = bytearray(answers[-1])
        for _ in range(3):
            damaged[rng.randrange(ads_proxy.DATA, len(damaged))] = rng.choice([0, 0x81, 0x8D, 255])
        return bytes(damaged)

    opened = 0
    with plc_behind(meddle) as (plc, _):
        for _ in range(60):
            host = re.sub(r"\.\d+$", ".254", plc.address)
            memory = ads.AdsMemory(plc.net_id, 851, symbol=RING, host=host)
            with suppress(DeviceSilentError):
                memory.open()
                opened += 1
            memory.close()
    assert opened > 5


def test_two_recorders_of_one_plc_each_get_all_that_it_makes(tmp_path: Path) -> None:
    with Plc(loopback_address(), 1000) as plc:
        recordings = [
            LiveRecording(
                RecordingFolder(tmp_path / name, CELL),
                (PlcSource(ads.AdsMemory(plc.net_id, 851, symbol=RING), lines=3600),),
            )
            for name in ("one", "two")
        ]
        for recording in recordings:
            recording.start()
        until(lambda: all(one.progress[0].records > 1000 for one in recordings))
        made = plc.written
        for recording in recordings:
            recording.finish()
        for name in ("one", "two"):
            _, last = numbers_of((tmp_path / name / "raw/ballbar.csv").read_bytes(), plc)
            assert last >= made - 1
    assert [(one.progress[0].segments, one.progress[0].lost) for one in recordings] == [(1, 0)] * 2


@pytest.mark.usefixtures("brisk")
@pytest.mark.parametrize("other_encoders", [False, True])
def test_another_plc_at_the_same_address_is_a_file_of_its_own_or_refused(
    other_encoders: bool, tmp_path: Path
) -> None:
    address, raw = loopback_address(), tmp_path / "r" / "raw"
    with Plc(address, 1000) as plc:
        source = PlcSource(ads.AdsMemory(plc.net_id, 851, symbol=RING), lines=3600)
        recording = LiveRecording(RecordingFolder(tmp_path / "r", CELL), (source,))
        recording.start()
        until(lambda: recording.progress[0].records > 500)
    until(lambda: recording.progress[0].state is RecorderState.WAIT)
    other = Plc(address, 500)
    other.poke(started=1, **({"fitted": 31} if other_encoders else {}))
    with other:
        if other_encoders:
            until(lambda: "other encoders" in recording.progress[0].reason)
        else:
            until(lambda: recording.progress[0].segments == 2)
        recording.finish()
        numbers_of((raw / "ballbar.csv").read_bytes(), plc)
        assert (raw / "ballbar_2.csv").exists() != other_encoders
        if not other_encoders:
            assert numbers_of((raw / "ballbar_2.csv").read_bytes(), other)[0] == 0
