"""The command `ballbar record`: its options, what it shows, and what it says at the end."""

from __future__ import annotations

import io
import json
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader
from rich.console import Console

from ballbar.acquisition.live.plc_source import PlcSource
from ballbar.acquisition.live.source import Progress, RecorderState
from ballbar.cell.errors import InputError
from ballbar.cell.plc_ring import RING
from ballbar.cell.recording import load_recording_file
from ballbar.record.show import (
    Recorded,
    RecordOptions,
    _ads_memory,
    _cell_names,
    _listen,
    record_data,
    say,
    silent,
)
from ballbar.record.terminal import say_recording, show_until_stopped, status_table, status_words
from ballbar.record.view import APPLICATION, TIMELINE, LiveView, layout
from ballbar.replay import viewer as replay_viewer
from ballbar.watch.show import line, panel
from tests.helpers.command_line import ballbar
from tests.helpers.egm_robot import egm_message
from tests.helpers.plc_server import Plc
from tests.helpers.ring_memory import RingMemory
from tests.helpers.source_imports import ROOT

if TYPE_CHECKING:
    from ballbar.watch.beside import WatchBeside

LINES = 3600
NAMES = ("--robot", "irb2400", "--ballbar", "lund_600")


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.mark.parametrize(
    ("word", "said"),
    [
        (0x8000, "ok"),
        (1 << 4, "amplitude error"),
        (1 << 3 | 1 << 14, "frequency error, invalid process data"),
    ],
)
def test_status_words_are_said_in_words(word: int, said: str) -> None:
    assert status_words(word) == said


def test_the_table_shows_rate_losses_and_what_an_encoder_complained_of() -> None:
    progress = Progress(
        "ballbar",
        RecorderState.RECORD,
        segments=2,
        records=1234,
        lost=7,
        rate=99.98,
        heard=time.monotonic(),
        channels=("b1", "b2"),
        latest=np.array([1.5, -2.0]),
        status=np.array([0x8000, 0x10]),
        ever=np.array([0x10, 0x10]),
        events=("PLC restarted",),
    )
    console = Console(file=io.StringIO(), width=100)
    console.print(status_table([progress], 12.0))
    say_recording(console, [progress])
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert "ballbar  recording  2        1234  100.0 Hz     7     0" in shown
    assert "b1    +1.500 deg  ok  (was: amplitude error)" in shown
    assert "b2    -2.000 deg  amplitude error " in shown
    assert "ballbar: segment 1 ended: PLC restarted." in shown
    console.print(status_table([replace(progress, heard=time.monotonic() - 5.0)], 12.0))
    # type: ignore[attr-defined]
    assert "ballbar  silent for 5 s  2        1234           7     0" in console.file.getvalue()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "nothing to record"),
        (["--plc", "192.168.1.5"], "an AMS address is NETID"),
        (["--plc", "5.12.82.20.1.999"], "an AMS address is NETID"),
        (["--egm", "localhost"], "give a port such as 6510"),
        (["--egm", "70000"], "give a port such as 6510"),
    ],
)
def test_options_that_cannot_be_are_refused(options: list[str], words: str, tmp_path: Path) -> None:
    code, _, error = ballbar("record", tmp_path / "r", *NAMES, *options)
    assert code == 2
    assert words in error
    assert not (tmp_path / "r").exists()


def test_a_robot_file_of_the_user_s_own_goes_into_the_recording(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_bytes((ROOT / "cell" / "robots" / "irb2400.yaml").read_bytes())
    folder = tmp_path / "r"
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        beat = threading.Event()

        def send() -> None:
            for n in range(10_000):
                if beat.wait(0.01):
                    return
                robot.sendto(egm_message(n, [0.0] * 6), ("127.0.0.1", port))

        sending = threading.Thread(target=send)
        sending.start()
        names = ("--robot", mine, "--ballbar", "lund_600")
        code, out, _ = ballbar(
            "record", folder, *names, "--egm", port, "--duration", "0.2", "--json"
        )
        beat.set()
        sending.join()
    assert code == 0
    reported = json.loads(out)
    assert reported["recording"] == str(folder)
    assert reported["sources"]["robot"]["records"] > 5
    assert reported["sources"]["robot"]["lost"] == 0
    assert load_recording_file(folder).robot == "mine.yaml"
    assert (folder / "mine.yaml").read_bytes() == mine.read_bytes()


def test_a_viewer_that_does_not_start_is_named_before_anything_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replay_viewer, "_rerun", lambda: "false")
    monkeypatch.setenv("DISPLAY", ":0")
    code, _, error = ballbar("record", tmp_path / "r", *NAMES, "--egm", free_port(), "--live")
    assert code == 1
    assert "Leave out --live where there is no screen" in error
    assert not (tmp_path / "r").exists()


def test_without_the_extra_the_command_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "ballbar.acquisition.live.ads", raising=False)
    monkeypatch.setitem(sys.modules, "pyads", None)
    code, _, error = ballbar("record", tmp_path / "r", *NAMES, "--plc", "5.12.82.20.1.1")
    assert code == 2
    assert "pip install 'ballbar-bench[ads]'" in error


def test_the_live_view_shows_angles_and_faults_on_one_timeline(tmp_path: Path) -> None:
    memory = RingMemory(Plc("", 1000, capacity=2000))
    source = PlcSource(memory, lines=LINES)
    source.connect()
    stream = rr.RecordingStream(APPLICATION)
    shown = []
    with stream:
        stream.save(tmp_path / "live.rrd", default_blueprint=layout([source]))
        view = LiveView(stream)
        for _ in range(3):
            memory.plc.write(100)
            shown.append(source.poll())
            view.on_batch(source, shown[-1])
    chunks = [
        chunk
        for chunk in RrdReader(tmp_path / "live.rrd").stream().filter(content="/ballbar/value")
        if not chunk.is_static
    ]
    batches = [chunk.to_record_batch() for chunk in chunks]
    angles = np.concatenate(
        [batch.column("Scalars:scalars").flatten().to_numpy().reshape(-1, 4) for batch in batches]
    )
    times = np.concatenate([batch.column(TIMELINE).cast("int64").to_numpy() for batch in batches])
    assert np.array_equal(angles, np.concatenate([batch.values[::10] for batch in shown]))
    assert np.allclose(np.diff(times), 10e6, atol=1e3)  # 10 ms, to the microsecond


def test_what_native_libraries_report_does_not_reach_standard_error(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import os, sys\n"
        "from ballbar.record.terminal import quiet_libraries\n"
        "from ballbar.terminal import err\n"
        "with quiet_libraries():\n"
        "    os.write(2, b'connection closed by remote\\n')\n"
        "    print('a warning', file=sys.stderr)\n"
        "    err.print('a line of the command')\n"
        "os.write(2, b'afterwards\\n')\n"
    )
    run = [sys.executable, str(script)]
    done = subprocess.run(run, capture_output=True, text=True, check=True)
    assert done.stderr.split("\n") == ["a warning", "a line of the command", "afterwards", ""]


def shown(*, width: int = 100, **console: Any) -> Console:
    return Console(file=io.StringIO(), width=width, **console)


def text_of(console: Console) -> list[str]:
    assert isinstance(console.file, io.StringIO)
    return [" ".join(line.split()) for line in console.file.getvalue().splitlines()]


def test_a_source_that_waits_says_why_and_one_of_a_robot_shows_its_unit() -> None:
    waiting = Progress("robot", RecorderState.WAIT, reason="no datagram on port 6510")
    turning = replace(
        waiting, state=RecorderState.RECORD, segments=1, records=20, rate=248.04, unit="rad",
        heard=time.monotonic() - 0.5, channels=("q1", "q2"), latest=np.array([0.25, -1.5]),
    )  # fmt: skip
    console = shown()
    console.print(status_table([waiting, turning, replace(turning, latest=None)], 61.6))
    lines = text_of(console)
    assert lines[:2] == [
        "62 s (Ctrl-C ends the recording)", "source state file records rate lost gaps",
    ]  # fmt: skip
    assert lines[2:5] == [
        "robot waiting 0 0 0",
        "robot recording 1 20 248.0 Hz 0 0",
        "robot recording 1 20 248.0 Hz 0 0",
    ]
    assert lines[5:] == ["robot: no datagram on port 6510", "rad: q1 +0.250 q2 -1.500"]


def test_a_source_that_ends_delivers_no_more() -> None:
    console = shown()
    flushing = Progress("robot", RecorderState.FLUSH, rate=10.0, heard=time.monotonic())
    closing = replace(flushing, state=RecorderState.CLOSE)
    console.print(status_table([flushing, closing], 1.0))
    assert text_of(console)[2:4] == ["robot recording 0 10.0 Hz 0 0", "robot closing 0 0 0"]


def test_what_was_recorded_is_counted_with_every_fault_since_the_start() -> None:
    console = shown()
    one = Progress("robot", segments=1, records=7, gaps=1)
    two = replace(
        one, name="ballbar", segments=2, lost=3, gaps=0, refused=4, channels=("b1", "b2", "b4"),
        status=np.array([0, 0, 0]), ever=np.array([0x2000, 0x8000, 0x18]), warnings=("a [b]",),
    )  # fmt: skip
    say_recording(console, [one, two])
    assert text_of(console) == [
        "robot: 7 records in 1 file, 0 lost, 1 gap",
        "ballbar: 7 records in 2 files, 3 lost, 0 gaps",
        "encoder b1: sync error",
        "encoder b4: frequency error, amplitude error",
        "ballbar: 3 records were lost before they came.",
        "ballbar: 4 datagrams were not of this robot and were left out.",
        "ballbar: a [b].",
    ]


class Events:
    """A recording whose sources change between the looks at it, and then ends."""

    def __init__(self, *looks: list[Progress]) -> None:
        self._looks = list(looks)

    @property
    def progress(self) -> list[Progress]:
        return self._looks.pop(0)

    def wait(self, _seconds: float) -> bool:
        return not self._looks


def test_in_a_pipe_each_change_of_a_source_is_one_line() -> None:
    waits = Progress("robot", reason="no [answer]")
    records = replace(waits, state=RecorderState.RECORD, segments=1, records=5)
    again = replace(waits, reason="", events=("controller restarted",), segments=1, records=9)
    console = shown()
    recording: Any = Events([waits], [waits], [records], [replace(records, records=9)], [again])
    show_until_stopped(console, recording, duration=None)
    assert text_of(console) == [
        "robot: no [answer]",
        "robot: recording to file 1",
        "robot: controller restarted; waiting",
    ]


def test_the_duration_counts_from_the_first_records(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([100.0, 101.0, 109.5, 110.5])  # read once records are there
    monkeypatch.setattr("ballbar.record.terminal.time.monotonic", lambda: next(clock))
    waits, records = Progress("robot"), Progress("robot", RecorderState.RECORD, records=1)
    recording: Any = Events([waits], [waits], [records], [records], [records], [waits])
    show_until_stopped(shown(), recording, duration=10.0)
    assert recording.progress == [waits]  # and it did not look once more


STATE = {
    "recorded_s": 30.04, "waiting": "", "tcp_sigma_m": 4.2e-5, "tcp_sigma_without_scale_m": 2.1e-5,
    "tcp_sigma_end_m": 1.4e-5, "model": "complete", "verdict": "good", "enough": False,
    "clock_offset_s": None, "axes_covered": [0.5, 0.25], "sphere_covered": 0.125,
    "noise": {"joint": 1.25e-5, "length": 2e-6}, "predicted": 1.104, "alarms": [],
}  # fmt: skip
ALARM = {"kind": "silent", "subject": "robot", "raised": 28.4, "sentence": "no new row for 3 s."}


def test_an_identification_beside_the_recorder_is_printed_once_an_update() -> None:
    beside = SimpleNamespace(latest=None, updates=0, failure="")

    class Meanwhile(Events):
        def wait(self, seconds: float) -> bool:
            left = len(self._looks)
            beside.latest, beside.updates = (None, 0) if left > 4 else (STATE, 1 + (left < 3))
            beside.failure = "exit [code] 3" if left < 2 else ""
            return super().wait(seconds)

    console = shown(width=200)
    recording: Any = Meanwhile(*[[Progress("robot", reason="off")] for _ in range(6)])
    show_until_stopped(console, recording, cast("WatchBeside", beside), duration=None)
    fact = (
        "30.0 s: TCP uncertainty 0.0420 mm with the scale, 0.0210 mm without, at the end about "
        "0.014 mm (estimate); verdict good, model complete; latest rows 1.10 times what the fit of "
        "the others explains"
    )
    ended = "identification ended: exit [code] 3"
    assert text_of(console) == ["robot: off", fact, fact, ended]


def test_the_panel_of_a_recording_states_its_coverage_and_noise() -> None:
    console = shown(width=200)
    console.print(panel(STATE | {"alarms": [ALARM]}))
    lines = text_of(console)
    assert lines[0] == "30 s recorded"
    assert "coverage sphere 12 %; axes 50 25 %" in lines
    assert "noise joint 12 urad length 0.0020 mm" in lines
    assert lines[-1] == "silent at 28 s: no new row for 3 s."
    followed = STATE | {"model": "poses", "enough": True, "tcp_sigma_end_m": None}
    console = shown(width=200)
    console.print(panel(followed | {"sphere_covered": None, "predicted": None}))
    lines = text_of(console)
    assert "TCP uncertainty 0.0210 mm, without the scale of the instrument - enough" in lines
    assert "coverage axes 50 25 %" in lines
    assert lines[-1] == "no alarm"


def test_the_state_of_a_recording_is_one_line_with_its_alarms() -> None:
    assert line(STATE | {"waiting": "no rows\x1b yet", "alarms": [ALARM]}) == (
        "30.0 s: waiting no rows\\x1b yet; ALARM silent: no new row for 3 s."
    )


def test_the_clock_of_a_recording_is_shown_as_exactly_as_it_is_known() -> None:
    timed = STATE | {"clock_offset_s": 0.1372, "clock_skew": 5e-5, "clock_sigma": [1e-5, 1e-7]}
    console = shown(width=200)
    console.print(panel(timed))
    (clock,) = (text for text in text_of(console) if text.startswith("clock"))
    assert clock == "clock offset +137.2000 ms (sigma 10 us); skew +50.000 ppm (sigma 0.10 ppm)"


def recorded(**changes: Any) -> Recorded:
    """A recording of a robot that delivered and of a ball-bar that did not."""
    progress = [Progress("robot", records=12, rate=250.0, segments=1, events=("cut",))]
    progress.append(Progress("ballbar", lost=2, gaps=3, refused=1, warnings=("late",)))
    recording = SimpleNamespace(progress=progress, missing=["the rows of sources.ballbar"])
    given = {"recording": recording, "identified": None} | changes
    return Recorded(**given)


def test_counts_of_a_recording_are_plain_data() -> None:
    data = record_data(Path("out"), recorded())
    assert data == {
        "recording": "out",
        "missing": ["the rows of sources.ballbar"],
        "sources": {
            "robot": {
                "records": 12, "lost": 0, "gaps": 0, "refused": 0, "segments": 1,
                "rate_Hz": 250.0, "events": ["cut"], "warnings": [],
            },
            "ballbar": {
                "records": 0, "lost": 2, "gaps": 3, "refused": 1, "segments": 0,
                "rate_Hz": 0.0, "events": [], "warnings": ["late"],
            },
        },
    }  # fmt: skip
    more = record_data(Path("out"), recorded(identified=STATE, failure="exit code 3"))
    assert (more["identified"], more["identification_ended"]) == (STATE, "exit code 3")


def test_at_the_end_it_is_said_what_is_missing_and_what_to_do_next() -> None:
    console = shown(width=200)
    say(console, Path("out"), recorded(failure="exit code 3"))
    assert silent(recorded().recording) == ["ballbar"]
    assert text_of(console)[-4:] == [
        "ballbar: delivered nothing",
        "Still missing: the rows of sources.ballbar.",
        "identification ended: exit code 3",
        "Recording out",
    ]
    whole = SimpleNamespace(progress=[Progress("robot", records=1)], missing=[])
    console = shown(width=200)
    say(console, Path("out"), recorded(recording=whole))
    assert text_of(console)[-1] == "Recording out, look at it with: ballbar check out"
    nothing = SimpleNamespace(progress=[Progress("robot")], missing=["all of it"])
    console = shown(width=200)
    say(console, Path("out"), recorded(recording=nothing))
    assert text_of(console)[-1] == "robot: delivered nothing"


@pytest.mark.parametrize(
    ("option", "address"),
    [("6510", ("127.0.0.1", 6510)), ("192.168.125.10:65535", ("192.168.125.10", 65535))],
)
def test_a_port_is_of_this_machine_unless_an_address_is_named(
    option: str, address: tuple[str, int]
) -> None:
    assert _listen(option) == address


@pytest.mark.parametrize("option", ["0", "65536", "192.168.1:6510"])
def test_what_is_no_port_is_refused(option: str) -> None:
    with pytest.raises(InputError, match="give a port such as 6510"):
        _listen(option)


@pytest.mark.parametrize(
    ("option", "opened"),
    [
        ("5.12.82.20.1.1", ("5.12.82.20.1.1", 851, None)),
        ("5.12.82.20.1.255:852@plc.local", ("5.12.82.20.1.255", 852, "plc.local")),
    ],
)
def test_a_plc_is_asked_at_its_port_and_host(
    option: str, opened: tuple[object, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[object, ...]] = []

    def reader(net: str, port: int, *, symbol: str, host: str | None) -> None:
        asked.append((net, port, host))
        assert symbol == RING

    monkeypatch.setattr("ballbar.record.show.ads_reader", lambda _wanted: reader)
    _ads_memory(option)
    assert asked == [opened]


def options(**changes: Any) -> RecordOptions:
    base = {"plc": None, "egm": "6510", "egm_torque": False} | dict.fromkeys(("robot", "ballbar"))
    return RecordOptions(**base | changes)


def test_a_cell_is_named_as_in_the_recording_and_the_user_s_own_files_are_copied(
    tmp_path: Path,
) -> None:
    named = {"robot": "irb2400", "ballbar": "lund_600"}
    names, files = _cell_names(options(**named))
    assert (names.robot, names.ballbar, names.plate) == ("irb2400", "lund_600", "plate_250")
    assert (names.lines, names.described, files) == (3600, None, [])
    mine, other = tmp_path / "mine.yaml", tmp_path / "plates" / "MINE.yaml"
    mine.write_bytes((ROOT / "cell/robots/irb2400.yaml").read_bytes())
    other.parent.mkdir()
    other.write_bytes((ROOT / "cell/plates/plate_250.yaml").read_bytes())
    names, files = _cell_names(options(**named | {"robot": str(mine)}))
    assert (names.robot, names.plate, files) == ("mine.yaml", "plate_250", [mine])
    with pytest.raises(InputError, match="two files of one folder, or one and recording"):
        _cell_names(options(**named | {"robot": str(mine), "plate": str(other)}))
    taken = mine.rename(tmp_path / "recording.yaml")
    with pytest.raises(InputError, match="two files of one folder, or one and recording"):
        _cell_names(options(**named | {"robot": str(taken)}))


def test_the_recorder_of_an_instrument_without_encoders_wants_its_folder() -> None:
    with pytest.raises(InputError, match="name that folder with --files"):
        _cell_names(options(robot="irb2400", ballbar="tracker_point"))
    with pytest.raises(InputError, match="name the robot with --robot"):
        _cell_names(options(robot="irb2400"))
