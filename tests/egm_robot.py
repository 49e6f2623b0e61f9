"""A robot that speaks EGM: messages put together by the protobuf wire format, independently of the decoder."""

from __future__ import annotations

import struct
from collections.abc import Sequence

PERIOD_NS = 4_032_000


def varint(number: int) -> bytes:
    groups = []
    while number > 0x7F:
        groups.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*groups, number])


def field(number: int, content: bytes | int) -> bytes:
    if isinstance(content, int):
        return varint(number << 3) + varint(content)
    return varint(number << 3 | 2) + varint(len(content)) + content


def egm_message(seqno: int, joints_deg: Sequence[float]) -> bytes:
    """EgmRobot with header, feedback joints and controller time, and a motor state (field 4) that nobody reads."""
    time_ns = 1_795_000_000_000_000_000 + seqno * PERIOD_NS
    clock = field(1, time_ns // 10**9) + field(2, time_ns % 10**9 // 1000)
    joints = b"".join(varint(1 << 3 | 1) + struct.pack("<d", angle) for angle in joints_deg)
    header = field(1, seqno) + field(2, time_ns // 10**6 % 2**32) + field(3, 2)
    return field(1, header) + field(2, field(1, joints) + field(4, clock)) + field(4, field(1, 1))


def frames_of(raw: bytes) -> list[bytes]:
    """The messages of a file of raw EGM messages, by its description."""
    start = b"EGM-RAW/1\r\n"
    assert raw.startswith(start)
    messages, at = [], len(start)
    while at < len(raw):
        length, _ = struct.unpack_from("<II", raw, at)
        messages.append(raw[at + 8 : at + 8 + length])
        at += 8 + length
    assert at == len(raw)
    return messages
