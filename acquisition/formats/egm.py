"""ABB EGM feedback: EgmRobot messages decoded from the wire and from files (ballbar.cell.egm_file).

EGM (externally guided motion) sends one protobuf message a UDP datagram, each 4.032 ms or a
multiple. Read are, by field number:

    EgmRobot     1 header, 2 feedBack, 7 testSignals
    EgmHeader    1 seqno, 2 tm [ms]
    EgmFeedBack  1 joints, 4 time, 5 timeStamp (RobotWare 7)
    EgmJoints    1 joints [deg], axis angles of the controller
    EgmClock     1 sec, 2 usec;  EgmTimestamp  1 sec, 2 nsec
    EgmTestSignals  1 signals, whatever the controller's user has defined them to be

Everything else is skipped, known or not. The clock starts where the controller likes: it is not
always Unix time.

Source: egm.proto in ros-industrial/abb_libegm (V1.1), the RobotWare 7 fields in ABBRobotEGM 1.0.7;
protobuf wire format.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

from ballbar.cell.egm_file import FILE_START, FRAME, LONGEST_MESSAGE
from ballbar.cell.errors import LogError

# Wire types; 3 and 4 are groups, which EGM never had.
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_REMEDY = "Copy the file again from the logger, or cut it before this message."
# Decoded messages that are kept: a file that grows is read again and again, and 20 us a message are
# three seconds for ten minutes. 17 minutes at 250 Hz, 200 MB.
REMEMBERED = 1 << 18
USUAL_MESSAGE = 500  # bytes; who sends longer ones shall not fill the memory
_LONGEST_VARINT = 10  # bytes of a 64-bit varint


@dataclass(frozen=True)
class EgmFeedback:
    """The robot's state in one message."""

    seqno: int | None
    tm_ms: int | None  # controller's time of sending, whole ms
    time_ns: int | None  # controller's clock at the feedback; from RobotWare 6.07
    joints_deg: tuple[float, ...]  # axis angles; empty before the first feedback
    test_signals: tuple[float, ...] = ()  # in the order of their channels


@dataclass(frozen=True)
class EgmFrames:
    """The messages of a file, and what of it could not be used."""

    messages: list[bytes]
    numbers: list[int]  # number in the file of each message, counted from 1
    damaged: list[int] = field(default_factory=list)  # numbers of the frames whose sum is wrong
    # First and last byte of an incomplete frame or a NUL block that ends the file.
    torn: tuple[int, int] | None = None


def decode(message: bytes) -> EgmFeedback:
    """The feedback in one EgmRobot message; absent fields are None, or empty.

    Raises LogError if the bytes are no such message, or hold a joint angle, a test signal or a time
    that cannot be.
    """
    if len(message) > LONGEST_MESSAGE:
        raise LogError(
            f"EGM message of {len(message)} bytes; a datagram has at most {LONGEST_MESSAGE}. "
            f"{_REMEDY}"
        )
    return _remembered(message) if len(message) <= USUAL_MESSAGE else _decoded(message)


def _damaged(what: str) -> LogError:
    """The error about a message that no controller sends."""
    return LogError(f"EGM message: {what} {_REMEDY}")


def _decoded(message: bytes) -> EgmFeedback:
    """The feedback in one message; raises as `decode`."""
    robot = _submessages(message)
    header, feedback = _fields(robot.get(1, b"")), robot.get(2, b"")
    parts = _submessages(feedback)
    numbers = {
        number: value & 0xFFFFFFFF  # uint32
        for number, wire, value in header
        if wire == _VARINT and isinstance(value, int)
    }
    joints = _doubles(parts.get(1, b""), "joint angles")
    signals = _doubles(robot.get(7, b""), "test signals")
    return EgmFeedback(numbers.get(1), numbers.get(2), _time_ns(parts), joints, signals)


_remembered = lru_cache(maxsize=REMEMBERED)(_decoded)


def read_frames(raw: bytes) -> EgmFrames:
    """The messages of a file, in order.

    A frame whose sum is wrong is left out; an incomplete one ends the file.

    Raises LogError if the file does not begin with FILE_START, or a frame claims a length that no
    message has.
    """
    if not raw.startswith(FILE_START):
        copied = raw.startswith(FILE_START.replace(b"\r\n", b"\n"))
        hint = (
            " It was copied in text mode: copy the file again in binary mode."
            if copied
            else " Name its dialect."
        )
        raise LogError(f"the file does not begin with {FILE_START!r}: no raw EGM messages.{hint}")
    messages, numbers, damaged = list[bytes](), list[int](), list[int]()
    at, end = len(FILE_START), len(raw.rstrip(b"\0"))
    while at < len(raw):
        torn = EgmFrames(messages, numbers, damaged, (at, len(raw) - 1))
        if end <= at or len(raw) - at < FRAME.size:  # NUL to the end, or half a frame's head
            return torn
        length, checksum = FRAME.unpack_from(raw, at)
        number = len(numbers) + len(damaged) + 1
        if not 0 < length <= LONGEST_MESSAGE:
            raise LogError(
                f"message {number} (byte {at}) claims {length} bytes; a datagram has 1 to "
                f"{LONGEST_MESSAGE}. Damaged here: cut the file before it."
            )
        message = raw[at + FRAME.size : at + FRAME.size + length]
        if len(message) < length:
            return torn
        if zlib.crc32(message, zlib.crc32(raw[at : at + 4])) == checksum:
            messages.append(message)
            numbers.append(number)
        else:
            damaged.append(number)
        at += FRAME.size + length
    return EgmFrames(messages, numbers, damaged)


def _time_ns(parts: dict[int, bytes]) -> int | None:
    """[ns] of timeStamp, else of time, else none."""
    for field_number, ticks_per_second in ((5, 1_000_000_000), (4, 1_000_000)):
        if field_number not in parts:
            continue
        fields = _fields(parts[field_number])
        clock = {number: value for number, wire, value in fields if wire == _VARINT}
        seconds, ticks = clock.get(1), clock.get(2)
        if not isinstance(seconds, int) or not isinstance(ticks, int):
            raise _damaged(f"a time {clock} without seconds, or without its fraction.")
        time_ns = seconds * 1_000_000_000 + ticks * (1_000_000_000 // ticks_per_second)
        if ticks >= ticks_per_second or time_ns >= 2**63:
            raise _damaged(f"a time of {seconds} s and {ticks}/{ticks_per_second} s cannot be.")
        return time_ns
    return None


def _doubles(message: bytes, what: str) -> tuple[float, ...]:
    """Repeated double field 1, one by one or packed; all of them finite."""
    values: list[float] = []
    for number, wire, value in _fields(message):
        if number == 1 and wire in (_FIXED64, _BYTES) and isinstance(value, bytes):
            if len(value) % 8:
                raise _damaged(f"{what} of {len(value)} bytes; a double has 8.")
            values += struct.unpack(f"<{len(value) // 8}d", value)
    if not all(math.isfinite(number) for number in values):
        raise _damaged(f"{what} {tuple(values)} are not finite.")
    return tuple(values)


def _submessages(message: bytes) -> dict[int, bytes]:
    """Length-delimited fields by number; repeated ones are joined, as protobuf merges messages."""
    parts: dict[int, list[bytes]] = {}
    for number, wire, value in _fields(message):
        if wire == _BYTES and isinstance(value, bytes):
            parts.setdefault(number, []).append(value)
    return {number: b"".join(values) for number, values in parts.items()}


def _fields(message: bytes) -> Iterator[tuple[int, int, int | bytes]]:
    """Number, wire type and value of each field; fixed-width and length-delimited ones as bytes."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        number, wire = key >> 3, key & 7
        if not 0 < number < 2**29:
            raise _damaged(f"field number {number} at byte {at - 1} cannot be.")
        if wire == _VARINT:
            value, at = _varint(message, at)
            yield number, wire, value
            continue
        if wire == _BYTES:
            length, at = _varint(message, at)
        elif wire in (_FIXED64, _FIXED32):
            length = 8 if wire == _FIXED64 else 4
        else:
            raise _damaged(f"field {number} has wire type {wire}, which EGM does not use.")
        if length > len(message) - at:
            raise _damaged(f"field {number} claims {length} bytes, {len(message) - at} are left.")
        yield number, wire, message[at : at + length]
        at += length


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """The number that begins at a byte, and where the next begins."""
    if at < len(message) and message[at] < 0x80:  # most are of one byte
        return message[at], at + 1
    value = 0
    for i, byte in enumerate(message[at : at + _LONGEST_VARINT]):
        value |= (byte & 0x7F) << (7 * i)
        if byte < 0x80:
            return value & (2**64 - 1), at + i + 1
    raise _damaged(f"the number at byte {at} has no end.")
