"""Small device files of every container, with the columns that a reader must find in them."""

from __future__ import annotations

import io
import json
import sqlite3
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from ballbar.cell.egm_file import FILE_START, frame
from ballbar.sim.logging.containers import double, joint_state, number, part
from tests.helpers.scope_exports import START_NS, Series, export

ROWS = 80
EPOCH_NS = 1_650_000_000_000_000_000  # 2022-04-15, UTC
JOINTS = tuple(f"joint_{axis}" for axis in range(1, 7))
AXES = tuple(f"J{axis}" for axis in range(1, 7))
SIGNALS = tuple(f"S{channel}" for channel in range(1, 7))

Columns = dict[str, NDArray]


@dataclass(frozen=True, eq=False)
class Written:
    """A device file and what stands in it."""

    dialect: str
    suffix: str
    content: bytes
    columns: Columns
    integers: tuple[str, ...] = ()  # encoder columns, which the recording names


def angles_deg(rows: int = ROWS, scale: float = 1.0) -> NDArray[np.float64]:
    """(N, 6) [deg] a smooth course at 4 ms; `scale` writes it in another unit."""
    t = 0.004 * np.arange(rows)
    return scale * np.stack(
        [40.0 * np.sin((1.0 + 0.2 * i) * t + 0.7 * i) + 3.0 * i for i in range(6)], axis=1
    )


def counts(rows: int = ROWS) -> NDArray[np.int64]:
    """(N, 2) counters of 32 bits, the second running through zero."""
    t = 0.01 * np.arange(rows)
    course = np.stack([2.0e6 + 3.0e5 * np.sin(t), -2.0e5 * np.sin(1.3 * t) - 5.0], axis=1)
    return np.rint(course).astype(np.int64) % 2**32


# ---- TwinCAT Scope


def scope(
    *,
    separator: str = "\t",
    decimal: str = ".",
    own_times: bool = False,
    eof: bool = False,
    rows: int = ROWS,
) -> Written:
    """Two counters at 10 ms and a fast channel at 2.5 ms, which goes on for longer."""
    values, fast = counts(rows), 2.5 * np.arange(rows + 7)
    channels = (
        Series("b1", "UINT32", values[:, 0], step_ms=10.0),
        Series("b2", "UINT32", values[:, 1], step_ms=10.0),
        Series("fast", "REAL64", 0.25 * fast, step_ms=2.5),
    )
    content = export(channels, separator=separator, decimal=decimal, own_times=own_times, eof=eof)
    time = START_NS + 10_000_000 * np.arange(rows)
    columns = {"time": time, "b1": values[:, 0], "b2": values[:, 1]}
    return Written("twincat-scope", ".csv", content, columns, ("b1", "b2"))


# ---- JSON lines


def json_lines(rows: int = ROWS, scale: float = 1.0) -> Written:
    """Ten axis slots of a Comau, four of them not there."""
    angles, time = angles_deg(rows, scale), EPOCH_NS // 1000 + 4000 * np.arange(rows)
    lines = [
        json.dumps(
            {
                **dict(zip(AXES, row, strict=True)),
                **dict.fromkeys(("J7", "J8", "J9", "J10"), 0.0),
                "time": int(stamp),
            }
        )
        for row, stamp in zip(angles.tolist(), time, strict=True)
    ]
    return Written(
        "comau-json",
        ".jsonl",
        ("\n".join(lines) + "\n").encode(),
        {"time": time, **_named(AXES, angles)},
    )


# ---- KUKA RSI


def rsi(rows: int = ROWS, scale: float = 1.0) -> Written:
    """Messages of KUKA RSI, one a line."""
    angles, time = angles_deg(rows, scale), 4_208_163_634 + 4 * np.arange(rows)
    lines = [
        '<Rob Type="KUKA"><RIst X="445.0" Y="0.0" Z="790.0"/><AIPos '
        + " ".join(f'A{k + 1}="{angle!r}"' for k, angle in enumerate(row))
        + f'/><Delay D="0"/><IPOC>{stamp}</IPOC></Rob>'
        for row, stamp in zip(angles.tolist(), time.tolist(), strict=True)
    ]
    names = tuple(f"AIPos.{axis}" for axis in ("A1", "A2", "A3", "A4", "A5", "A6"))
    content = ("\n".join(lines) + "\n").encode()
    return Written("kuka-rsi", ".xml", content, {"IPOC": time, **_named(names, angles)})


# ---- EGM


def egm_message(
    seqno: int, time_ns: int, joints: list[float], signals: Sequence[float] = ()
) -> bytes:
    """An EgmRobot message: header, feedback, a pose that nobody reads, motors, test signals."""
    angles = b"".join(double(1, angle) for angle in joints)
    pose = part(1, double(1, 900.0) + double(2, 1.5) + double(3, 1200.0))
    clock = number(1, time_ns // 10**9) + number(2, time_ns % 10**9 // 1000)
    feedback = part(1, angles) + part(2, pose) + part(4, clock)
    header = number(1, seqno) + number(2, time_ns // 10**6 % 2**32) + number(3, 2)
    message = part(1, header) + part(2, feedback) + part(4, number(1, 1)) + double(10, 12.5)
    return message + (part(7, b"".join(double(1, s) for s in signals)) if signals else b"")


def egm(rows: int = ROWS, scale: float = 1.0) -> Written:
    """Messages at 4.032 ms."""
    angles, time = angles_deg(rows, scale), EPOCH_NS + 4_032_000 * np.arange(rows)
    messages = [egm_message(7 + i, int(time[i]), row) for i, row in enumerate(angles.tolist())]
    return Written(
        "abb-egm",
        ".egm",
        FILE_START + b"".join(map(frame, messages)),
        {"time": time, **_named(AXES, angles)},
    )


def egm_torque(rows: int = ROWS, signals: int = 6) -> Written:
    """The same messages with test signals, which are declared to be torques."""
    angles, time = angles_deg(rows), EPOCH_NS + 4_032_000 * np.arange(rows)
    loads = 100.0 * np.cos(np.arange(rows)[:, None] + np.arange(signals))
    messages = [
        egm_message(7 + i, int(time[i]), row, load)
        for i, (row, load) in enumerate(zip(angles.tolist(), loads.tolist(), strict=True))
    ]
    columns = {"time": time, **_named(AXES, angles), **_named(SIGNALS[:signals], loads[:, :6])}
    content = FILE_START + b"".join(map(frame, messages))
    return Written("abb-egm-torque", ".egm", content, columns)


# ---- ROS 2 bags


def _joint_states(rows: int, scale: float) -> tuple[list[bytes], Columns]:
    """Messages whose joints change their order from one to the next."""
    angles, time = np.deg2rad(angles_deg(rows, scale)), EPOCH_NS + 4_000_001 * np.arange(rows)
    messages = []
    for i, row in enumerate(angles.tolist()):
        order = (np.arange(6) + i) % 6
        messages.append(
            joint_state(int(time[i]), tuple(JOINTS[k] for k in order), [row[k] for k in order])
        )
    return messages, {"stamp": time, **_named(JOINTS, angles)}


def db3(folder: Path, rows: int = ROWS, scale: float = 1.0) -> Written:
    """A bag in SQLite as rosbag2 of ROS 2 Humble writes it; folder : for the file meanwhile."""
    messages, columns = _joint_states(rows, scale)
    path = folder / "making.db3"
    path.unlink(missing_ok=True)
    connection = sqlite3.connect(path)
    connection.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
        "serialization_format TEXT NOT NULL, "
        "offered_qos_profiles TEXT NOT NULL)"
    )
    connection.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
        "timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
    )
    connection.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    connection.execute(
        "INSERT INTO topics VALUES (1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr', '')"
    )
    connection.executemany(
        "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", enumerate(messages)
    )
    connection.commit()
    connection.close()
    return Written("ros-joint-state", ".db3", path.read_bytes(), columns)


def mcap(rows: int = ROWS, scale: float = 1.0, *, packed: str = "ZSTD") -> Written:
    """A bag in MCAP with checksums; packed : NONE, LZ4 or ZSTD."""
    messages, columns = _joint_states(rows, scale)
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=4096, compression=CompressionType[packed])
    writer.start(profile="ros2", library="")
    schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"# see sensor_msgs")
    channel = writer.register_channel("/joint_states", "cdr", schema)
    for stamp, message in zip(columns["stamp"].tolist(), messages, strict=True):
        writer.add_message(channel, log_time=stamp, data=message, publish_time=stamp)
    writer.finish()
    return Written("ros-joint-state", ".mcap", stream.getvalue(), columns)


# ---- abb_motion_program_exec


def mpe(rows: int = ROWS, scale: float = 1.0) -> Written:
    """A log of one robot, 4 ms."""
    time = (0.004 * np.arange(1, rows + 1)).astype(np.float32)
    angles = angles_deg(rows, scale).astype(np.float32)
    command = np.full(rows, 3, dtype=np.float32)
    header, stamp = b"timestamp,cmdnum,J1,J2,J3,J4,J5,J6", b"2024-05-01T10-20-30"
    head = struct.pack("<ff", 10011, len(stamp)) + stamp + struct.pack("<f", len(header)) + header
    columns = {"timestamp": time.astype(np.float64), **_named(AXES, angles.astype(np.float64))}
    return Written(
        "abb-mpe",
        ".bin",
        head + np.column_stack((time, command, angles)).astype("<f4").tobytes(),
        columns,
    )


# ---- force sensor


def force_torque(rows: int = ROWS) -> Written:
    """A text log of six noisy loads, 1 ms."""
    t = 0.001 * np.arange(rows)
    noise = np.random.default_rng(5).normal(0.0, 0.1, (rows, 6))
    loads = np.round(20.0 * np.sin(5.0 * t)[:, None] * np.arange(1, 7) + noise, 4)
    names = ("fx", "fy", "fz", "tx", "ty", "tz")
    lines = [",".join(("time", *names))]
    lines += [
        f"{s:.6f}," + ",".join(f"{load:.4f}" for load in row)
        for s, row in zip(t.tolist(), loads.tolist(), strict=True)
    ]
    content = ("\n".join(lines) + "\n").encode()
    return Written("force-torque", ".csv", content, {"time": t, **_named(names, loads)})


def _named(names: tuple[str, ...], values: NDArray[np.float64]) -> Columns:
    return dict(zip(names, values.T, strict=True))
