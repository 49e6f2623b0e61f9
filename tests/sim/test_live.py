"""Devices of a simulated cell: rows that grow, faults that begin at an instant, and containers."""

from __future__ import annotations

import json
import sqlite3
import struct
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from ballbar.cell.plc_ring import LAYOUT
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.sim.live.delivery import Device, Pace
from ballbar.sim.live.device_logs import WORD, TextLog
from ballbar.sim.live.faults import AT_REST, DWELL, FAULTS, Logs, moving_at, stands
from ballbar.sim.live.plc import STARTED, LoggedSamples, Plc, logged_samples
from ballbar.sim.logging.containers import (
    ENCODERS,
    abb_mpe,
    double,
    egm_message,
    joint_state,
    json_lines,
    kuka_rsi,
    number,
    part,
    robot_log_name,
    rosbag,
    varint,
)
from ballbar.sim.plant.instrument_plant import rod_position
from tests.helpers.egm_robot import _ROBOT

T = 0.01 * np.arange(1000)  # [s]
SCALES = {"ballbar": 1000.0, "robot": 100.0}  # counts, and degrees or so, in a rad


def log(kind: str, columns: dict[str, Any]) -> TextLog:
    """Stamps [ns], then columns; motion of half a rad."""
    cells = np.empty((T.size, 1 + len(columns)), dtype=object)
    cells[:, 0] = [str(round(t * 1e9)) for t in T]
    made = TextLog(",".join(["t", *columns]), ",", cells, T, {}, kind == "ballbar")
    for name, values in columns.items():
        made.put(np.arange(T.size), name, values)
    measured = {name: SCALES[kind] for name in columns if name[0] != "s"}
    return TextLog(made.head, ",", cells, T, measured, made.counts)


def logs() -> Logs:
    angles = {k: 0.5 * np.sin(0.7 * T + k) for k in range(1, 7)}
    bar = {f"b{k}": SCALES["ballbar"] * angles[k] for k in (1, 2)}
    bar |= {f"s{k}": np.full(T.size, 32768.0) for k in (1, 2)}
    return {
        "ballbar": log("ballbar", bar),
        "robot": log("robot", {f"m{k}": SCALES["robot"] * angles[k] for k in range(1, 7)}),
    }


def differing(before: TextLog, after: TextLog) -> dict[str, list[int]]:
    """Rows of each column that are not as before."""
    other = before.cells != after.cells
    return {
        name: np.flatnonzero(other[:, before.column(name)]).tolist()
        for name in before.head.split(",")
        if other[:, before.column(name)].any()
    }


def faulty(name: str, at: float = 4.005, seed: int = 1) -> tuple[Logs, Logs, float]:
    before, after = logs(), logs()
    seen = FAULTS[name](after, at, np.random.default_rng(seed))
    return before, after, seen


FIRST = 401  # row behind 4.005 s


@pytest.mark.parametrize(
    ("name", "source"), [("encoder_frozen", "ballbar"), ("motor_frozen", "robot")]
)
def test_a_frozen_channel_repeats_the_value_before(name: str, source: str) -> None:
    before, after, seen = faulty(name)
    ((column, rows),) = differing(before[source], after[source]).items()
    assert (seen, rows[0], rows[-1]) == (4.005, FIRST, T.size - 1)
    cells = after[source].cells[FIRST - 1 :, after[source].column(column)]
    assert set(cells) == {before[source].cells[FIRST - 1, before[source].column(column)]}


def test_a_frozen_log_repeats_all_of_its_row() -> None:
    before, after, _ = faulty("robot_log_frozen")
    assert len(differing(before["robot"], after["robot"])) == 6
    assert (after["robot"].cells[FIRST:, 1:] == before["robot"].cells[FIRST - 1, 1:]).all()


def test_exchanged_channels_hold_each_other_s_values() -> None:
    before, after, _ = faulty("motors_exchanged")
    first, second = differing(before["robot"], after["robot"])
    for one, other in ((first, second), (second, first)):
        mine, theirs = after["robot"].numbers(one), before["robot"].numbers(other)
        assert (mine[FIRST:] == theirs[FIRST:]).all()
        assert (mine[:FIRST] == before["robot"].numbers(one)[:FIRST]).all()


@pytest.mark.parametrize(("name", "factor"), [("encoder_reversed", -1.0), ("line_count", 2.0)])
def test_an_encoder_counts_so_many_times_as_far_also_across_a_wrap(
    name: str, factor: float
) -> None:
    before, after, _ = faulty(name)
    ((column, _),) = differing(before["ballbar"], after["ballbar"]).items()

    def way(log: TextLog) -> Any:
        counts = log.numbers(column)[FIRST - 1 :]
        return (counts - counts[0] + WORD / 2) % WORD - WORD / 2

    np.testing.assert_allclose(way(after["ballbar"]), factor * way(before["ballbar"]), atol=0.5)


@pytest.mark.parametrize(
    ("name", "source", "least", "most"),
    [("slip", "ballbar", 1e-3, 5e-3), ("tool_moved", "robot", 2e-3, 5e-3)],
)
def test_a_channel_that_moved_is_off_by_the_same_size_from_then_on(
    name: str, source: str, least: float, most: float
) -> None:
    sizes = set()
    for seed in range(8):
        before, after, _ = faulty(name, seed=seed)
        ((column, rows),) = differing(before[source], after[source]).items()
        assert rows[0] == FIRST
        assert source == "ballbar" or column in ("m4", "m5", "m6"), "a wrist's motor"
        off = (after[source].numbers(column) - before[source].numbers(column))[FIRST:]
        off = (off + WORD / 2) % WORD - WORD / 2
        size = off / SCALES[source]
        assert np.ptp(size) < 1.1e-3 * (source == "ballbar") + 1e-6
        assert least - 1e-3 < abs(np.median(size)) < most + 1e-3
        sizes.add(np.sign(np.median(size)))
    assert sizes == {-1.0, 1.0}


def test_a_clock_goes_back_by_the_same_time_in_every_row() -> None:
    before, after, _ = faulty("stamps_back")
    ((column, rows),) = differing(before["ballbar"], after["ballbar"]).items()
    assert (column, rows[0]) == ("t", FIRST)
    back = before["ballbar"].numbers("t") - after["ballbar"].numbers("t")
    assert np.ptp(back[FIRST:]) < 1000
    assert 1e9 <= back[FIRST] <= 1e10


def test_a_weak_signal_shows_in_the_status_alone() -> None:
    before, after, _ = faulty("weak_signal")
    ((column, rows),) = differing(before["ballbar"], after["ballbar"]).items()
    assert column.startswith("s")
    assert rows[0] == FIRST
    assert set(after["ballbar"].cells[FIRST:, after["ballbar"].column(column)]) == {"16"}


def test_a_robot_that_stands_is_seen_after_the_longest_dwell() -> None:
    _, after, seen = faulty("robot_stands")
    assert seen == pytest.approx(4.005 + DWELL)
    for source, made in after.items():
        for name, scale in made.scales.items():
            left = made.numbers(name)[FIRST:] / scale
            left = (left + WORD / scale / 2) % (WORD / scale) - WORD / scale / 2
            assert left.std() < 2.0 * AT_REST + 1e-3 * (source == "ballbar")
            whole = made.numbers(name)[FIRST - 1] / scale
            whole = (whole + WORD / scale / 2) % (WORD / scale) - WORD / scale / 2
            assert left.mean() == pytest.approx(whole, abs=5e-3)


def test_a_tracker_that_stops_writes_no_more_rows() -> None:
    made = {"tracker": log("robot", {"m1": T})}
    FAULTS["tracker_stops"](made, 4.0, np.random.default_rng(1))
    assert made["tracker"].t.size == len(made["tracker"].cells) == 400
    assert made["tracker"].t[-1] < 4.0


def test_a_dwell_is_waited_out_in_whole_seconds() -> None:
    made = logs()
    still = (T > 2.0) & (T < 6.0)
    for name in made["robot"].scales:
        values = made["robot"].numbers(name)
        values[still] = values[np.argmax(still)]
        made["robot"].put(np.arange(T.size), name, values)
    assert not stands(made, 0.6)
    assert stands(made, 3.0)
    assert moving_at(made, 3.0) == 5.0
    assert moving_at(made, 0.6) == 0.6


# -- delivery


def test_a_pace_goes_on_at_its_rate_and_real_time_while_it_is_held_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [100.0]
    monkeypatch.setattr("ballbar.sim.live.delivery.time.monotonic", lambda: now[0])
    pace = Pace(8.0)
    now[0] += 5.0
    assert pace.delivered == 0.0
    pace.start()
    now[0] += 2.0
    assert pace.delivered == 16.0
    pace.hold_back(wanted=True)
    now[0] += 3.0
    assert pace.delivered == 19.0
    pace.hold_back(wanted=False)
    now[0] += 1.0
    assert pace.delivered == 27.0
    slow = Pace(0.5)
    slow.start()
    slow.hold_back(wanted=True)
    now[0] += 4.0
    assert slow.delivered == 2.0


def test_a_device_works_until_all_is_done() -> None:
    class Three(Device):
        left, closed = 3, False

        def _cycle(self) -> bool:
            self.left -= 1
            return not self.left

        def _close(self) -> None:
            self.closed = True

    with Three(1e-3) as device:
        device.start()
        assert device.wait(10.0)
        assert not device.closed
    assert (device.left, device.closed) == (0, True)


def test_a_plc_samples_a_log_again_into_its_ring() -> None:
    pace = Pace(1.0)
    made = logs()["ballbar"]
    program, joints = logged_samples(made, pace)
    assert joints == (1, 2)
    assert isinstance(program, LoggedSamples)
    plc = Plc("127.0.0.1", program, joints=joints, capacity=8)
    plc.write(11)
    assert plc.written == 11
    slots = plc._slots
    assert slots["sequence"].tolist() == [9, 10, 11, 4, 5, 6, 7, 8]
    assert slots["counter"][2, :2].tolist() == [
        int(made.numbers(f"b{j}")[10]) % WORD for j in (1, 2)
    ]
    assert not slots["counter"][:, 2:].any()
    assert (slots["status"][:, :2] == 32768).all()
    assert plc._header[0].tolist() == (LAYOUT, 8, 0b11, 12, STARTED, 11)
    assert program.due(0) == 1, "the row at the beginning"


# -- containers


NAMES = ["t", *(f"A{k}" for k in range(1, 7))]
STAMPS = np.array([1_795_000_000_123_456_789, 1_795_000_001_000_000_001])
ANGLES = np.arange(12.0).reshape(2, 6) / 7.0


def test_numbers_of_a_protobuf_are_in_base_128() -> None:
    """The examples of the protobuf documentation: 150 as 96 01, and in field 1 as 08 96 01."""
    assert varint(150) == b"\x96\x01"
    assert (varint(0), varint(127), varint(128)) == (b"\0", b"\x7f", b"\x80\x01")
    assert number(1, 150) == b"\x08\x96\x01"
    assert part(2, b"testing") == b"\x12\x07testing"
    assert double(3, 0.5) == b"\x19" + struct.pack("<d", 0.5)


def test_an_egm_message_is_what_another_decoder_reads() -> None:
    message = egm_message(7, int(STAMPS[0]), ANGLES[1].tolist(), [0.25, -3.0])
    read: Any = _ROBOT.FromString(message)
    assert read.header.seqno == 7
    assert read.header.tm == STAMPS[0] // 10**6 % 2**32
    clock = read.feedBack.time
    assert clock.sec * 10**6 + clock.usec == STAMPS[0] // 1000
    np.testing.assert_array_equal(read.feedBack.joints.joints, ANGLES[1])
    assert len(message) - len(egm_message(7, int(STAMPS[0]), ANGLES[1].tolist())) == 2 + 2 * 9


def test_a_bag_holds_the_messages_that_ros_reads() -> None:
    content = rosbag(NAMES, STAMPS, ANGLES)
    connection = sqlite3.connect(":memory:")
    connection.deserialize(content)
    rows = connection.execute("SELECT topic_id, timestamp, data FROM messages").fetchall()
    assert [row[:2] for row in rows] == [(1, stamp) for stamp in STAMPS.tolist()]
    store = get_typestore(Stores.ROS2_HUMBLE)
    for (_, stamp, data), angles in zip(rows, ANGLES, strict=True):
        read: Any = store.deserialize_cdr(data, "sensor_msgs/msg/JointState")
        assert read.header.stamp.sec * 10**9 + read.header.stamp.nanosec == stamp
        assert read.header.frame_id == "base"
        assert list(read.name) == NAMES[1:]
        np.testing.assert_array_equal(read.position, angles)
        assert (read.velocity.size, read.effort.size) == (0, 0)
    assert joint_state(5, ["a"], [1.0])[:4] == b"\0\1\0\0"


def test_rows_of_text_containers_hold_names_times_and_angles() -> None:
    lines = [json.loads(line) for line in json_lines(NAMES, STAMPS, ANGLES).splitlines()]
    assert [line.pop("t") for line in lines] == STAMPS.tolist()
    assert [list(line.values()) for line in lines] == ANGLES.tolist()
    names = ["IPOC", *(f"AIPos.A{k}" for k in range(1, 7))]
    first = kuka_rsi(names, np.array([4, 8]), ANGLES).decode().splitlines()[1]
    assert first.startswith('<Rob Type="KUKA"><AIPos A1="0.857142857" A2="1.000000000"')
    assert first.endswith("/><IPOC>8</IPOC></Rob>")


def test_rows_of_an_mpe_log_stand_behind_its_head_in_single_precision() -> None:
    made = abb_mpe(NAMES, np.array([3.0, 3.5]), ANGLES)
    rows = np.frombuffer(made[-2 * 8 * 4 :], dtype="<f4").reshape(2, 8)
    np.testing.assert_array_equal(rows[:, :2], [[0.0, 1.0], [0.5, 1.0]])
    np.testing.assert_allclose(rows[:, 2:], ANGLES, rtol=1e-6)
    version, length = struct.unpack("<ff", made[:8])
    assert (version, length) == (10011.0, len("2026-01-01T00-00-00"))
    head = made[8 + int(length) : -2 * 8 * 4]
    (size,) = struct.unpack("<f", head[:4])
    assert head[4:].decode() == "t,cmdnum,A1,A2,A3,A4,A5,A6"
    assert size == len(head) - 4


def test_each_container_has_a_file_of_its_own() -> None:
    assert {robot_log_name(kind) for kind in ENCODERS} == {
        f"raw/robot{suffix}" for suffix in (".jsonl", ".xml", ".bin", ".egm", ".db3")
    }
    assert robot_log_name("delimited") == "raw/robot.csv"  # type: ignore[arg-type]


# -- rod


@pytest.mark.parametrize("end", [[0.3, 0.4, 1.2], [0.0, 0.0, 2.0], [-1.0, 0.1, 0.0]])
def test_a_rod_lies_from_its_cup_to_its_end(end: list[float]) -> None:
    seat = np.array([0.1, -0.2, 0.3])
    w, x, y, z, slide = rod_position(seat, seat + end, 0.5)
    assert slide == pytest.approx(np.linalg.norm(end) - 0.5)
    assert w * w + x * x + y * y + z * z == pytest.approx(1.0)
    angle = 2.0 * np.arccos(np.clip(w, -1.0, 1.0))
    axis = np.array([x, y, z]) / max(np.linalg.norm([x, y, z]), 1e-12)
    turned = matrix_from_rotvec((angle * axis)[:, None])[..., 0] @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(turned, np.array(end) / np.linalg.norm(end), atol=1e-9)
