"""Encoders of robot logs that are no tables of text: one function for each container.

Each takes the names of the columns, time first, and times (N,) and angles (N, J) in the units of
the dialect, followed by test signals where the container has them, and gives the content of a file.
Formats: the readers of the same name in ballbar.acquisition.formats.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Sequence

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.dialect import Container
from ballbar.cell.egm_file import FILE_START, frame

Encoder = Callable[[Sequence[str], Array, Array], bytes]

_MPE_VERSION = 10011
_MPE_STAMP = b"2026-01-01T00-00-00"
_TOPICS = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
    "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
)
_MESSAGES = (
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
    "timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
)


def json_lines(names: Sequence[str], times: Array, angles: Array) -> bytes:
    """One object a row; whole times."""
    lines = [
        json.dumps({**dict(zip(names[1:], row, strict=True)), names[0]: time})
        for time, row in zip(times.tolist(), angles.tolist(), strict=True)
    ]
    return ("\n".join(lines) + "\n").encode("ascii")


def kuka_rsi(names: Sequence[str], times: Array, angles: Array) -> bytes:
    """One message a row; the angles are attributes of one element, named as `AIPos.A1`."""
    element = names[1].partition(".")[0]
    keys = [name.partition(".")[2] for name in names[1:]]
    lines = []
    for time, row in zip(times.tolist(), angles.tolist(), strict=True):
        values = " ".join(f'{key}="{value:.9f}"' for key, value in zip(keys, row, strict=True))
        body = f"<{element} {values}/><{names[0]}>{time}</{names[0]}>"
        lines.append(f'<Rob Type="KUKA">{body}</Rob>')
    return ("\n".join(lines) + "\n").encode("ascii")


def abb_mpe(names: Sequence[str], times: Array, angles: Array) -> bytes:
    """Rows of float32 behind a head, all of one command; seconds."""
    header = ",".join((names[0], "cmdnum", *names[1:])).encode("ascii")
    head = struct.pack("<ff", _MPE_VERSION, len(_MPE_STAMP)) + _MPE_STAMP
    head += struct.pack("<f", len(header)) + header
    rows = np.column_stack((times - times[0], np.ones(times.size), angles))
    return head + rows.astype("<f4").tobytes()


def egm(_names: Sequence[str], times: Array, values: Array) -> bytes:
    """Framed EgmRobot messages with header, angles, clock and test signals; nanoseconds."""
    rows = zip(times.tolist(), values.tolist(), strict=True)
    messages = (egm_message(k, time, row[:6], row[6:]) for k, (time, row) in enumerate(rows))
    return FILE_START + b"".join(map(frame, messages))


def egm_message(
    seqno: int, time_ns: int, joints: Sequence[float], signals: Sequence[float] = ()
) -> bytes:
    """One EgmRobot message (ballbar.acquisition.formats.egm); joints [deg], test signals."""
    positions = b"".join(double(1, angle) for angle in joints)
    clock = number(1, time_ns // 10**9) + number(2, time_ns % 10**9 // 1000)
    header = number(1, seqno) + number(2, time_ns // 10**6 % 2**32)
    message = part(1, header) + part(2, part(1, positions) + part(4, clock))
    return message + (part(7, b"".join(double(1, s) for s in signals)) if len(signals) else b"")


def rosbag(names: Sequence[str], times: Array, angles: Array) -> bytes:
    """A bag in SQLite of JointState messages, as rosbag2 writes it; nanoseconds."""
    import sqlite3  # noqa: PLC0415  slow to import, and needed here alone

    connection = sqlite3.connect(":memory:")
    connection.execute(_TOPICS)
    connection.execute(_MESSAGES)
    topic = (1, "/joint_states", "sensor_msgs/msg/JointState", "cdr", "")
    connection.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", topic)
    rows = zip(times.tolist(), angles.tolist(), strict=True)
    connection.executemany(
        "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)",
        ((time, joint_state(time, names[1:], row)) for time, row in rows),
    )
    connection.commit()
    content = connection.serialize()
    connection.close()
    return content


def joint_state(stamp_ns: int, names: Sequence[str], positions: Sequence[float]) -> bytes:
    """A JointState message in little-endian CDR, without velocities and efforts."""
    body = struct.pack("<iI", stamp_ns // 10**9, stamp_ns % 10**9) + _cdr_text("base")
    body += bytes(-len(body) % 4) + struct.pack("<I", len(names))
    for name in names:
        body += bytes(-len(body) % 4) + _cdr_text(name)
    body += bytes(-len(body) % 4) + struct.pack("<I", len(positions))
    body += bytes(-len(body) % 8) + struct.pack(f"<{len(positions)}d", *positions)
    return b"\0\1\0\0" + body + struct.pack("<II", 0, 0)


def _cdr_text(text: str) -> bytes:
    raw = text.encode() + b"\0"
    return struct.pack("<I", len(raw)) + raw


def varint(value: int) -> bytes:
    """A number in base 128, lowest digits first."""
    digits = []
    while value > 0x7F:
        digits.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*digits, value])


def part(field: int, content: bytes) -> bytes:
    """A length-delimited field of a protobuf message."""
    return varint(field << 3 | 2) + varint(len(content)) + content


def number(field: int, value: int) -> bytes:
    """A varint field of a protobuf message."""
    return varint(field << 3) + varint(value)


def double(field: int, value: float) -> bytes:
    """A field of eight bytes of a protobuf message."""
    return varint(field << 3 | 1) + struct.pack("<d", value)


ENCODERS: dict[Container, tuple[Encoder, str]] = {  # with the suffix of their files
    "json-lines": (json_lines, ".jsonl"),
    "kuka-rsi": (kuka_rsi, ".xml"),
    "abb-mpe": (abb_mpe, ".bin"),
    "egm": (egm, ".egm"),
    "rosbag": (rosbag, ".db3"),
}


def robot_log_name(container: Container) -> str:
    """File of a robot's log in a recording."""
    return f"raw/robot{ENCODERS[container][1] if container in ENCODERS else '.csv'}"
