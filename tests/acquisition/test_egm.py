"""EGM messages: the decoder agrees with Google's protobuf on real, odd and damaged messages."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError, Message

from ballbar.acquisition.formats.egm import decode, read_frames
from ballbar.cell.egm_file import FILE_START, LONGEST_MESSAGE, frame
from ballbar.cell.errors import LogError
from ballbar.sim.logging.containers import double, number, part, varint

_DOUBLE, _MESSAGE, _UINT32, _UINT64, _BOOL = 1, 11, 13, 4, 8
# The published egm.proto of RobotWare 7; numbers, types and labels only.
_PROTO: dict[str, list[tuple[str, int, int | str, bool]]] = {
    "Header": [
        ("seqno", 1, _UINT32, False),
        ("tm", 2, _UINT32, False),
        ("mtype", 3, _UINT32, False),
    ],
    "Joints": [("joints", 1, _DOUBLE, True)],
    "Clock": [("sec", 1, _UINT64, False), ("usec", 2, _UINT64, False)],
    "Timestamp": [("sec", 1, _UINT64, False), ("nsec", 2, _UINT64, False)],
    "Cartesian": [("x", 1, _DOUBLE, False), ("y", 2, _DOUBLE, False), ("z", 3, _DOUBLE, False)],
    "Pose": [("pos", 1, "Cartesian", False)],
    "FeedBack": [
        ("joints", 1, "Joints", False),
        ("cartesian", 2, "Pose", False),
        ("externalJoints", 3, "Joints", False),
        ("time", 4, "Clock", False),
        ("timeStamp", 5, "Timestamp", False),
    ],
    "Robot": [
        ("header", 1, "Header", False),
        ("feedBack", 2, "FeedBack", False),
        ("planned", 3, "FeedBack", False),
        ("mciConvergenceMet", 6, _BOOL, False),
        ("testSignals", 7, "Joints", False),
        ("utilizationRate", 10, _DOUBLE, False),
        ("moveIndex", 11, _UINT32, False),
    ],
}


def _robot_class() -> type[Message]:
    file = descriptor_pb2.FileDescriptorProto(name="egm.proto", package="egm", syntax="proto2")
    for name, fields in _PROTO.items():
        message = file.message_type.add(name=name)
        for field, key, kind, repeated in fields:
            made = message.field.add(name=field, number=key, label=3 if repeated else 1)
            made.type = _MESSAGE if isinstance(kind, str) else kind  # type: ignore[assignment]
            if isinstance(kind, str):
                made.type_name = f".egm.{kind}"
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("egm.Robot"))


ROBOT = _robot_class()


def random_message(rng: np.random.Generator) -> bytes:
    """A message of protobuf's making, each field there or not."""
    robot = ROBOT()
    if rng.random() < 0.9:
        robot.header.seqno, robot.header.tm = (int(rng.integers(2**32)) for _ in range(2))
    if rng.random() < 0.9:
        robot.feedBack.joints.joints.extend(
            rng.uniform(-400.0, 400.0, int(rng.integers(8))).tolist()
        )
        robot.feedBack.cartesian.pos.x = rng.normal()
        robot.feedBack.externalJoints.joints.extend([1.0, 2.0])
    if rng.random() < 0.7:
        robot.feedBack.time.sec, robot.feedBack.time.usec = (
            int(rng.integers(2**31)),
            int(rng.integers(10**6)),
        )
    if rng.random() < 0.3:
        robot.feedBack.timeStamp.sec, robot.feedBack.timeStamp.nsec = (
            int(rng.integers(2**31)),
            int(rng.integers(10**9)),
        )
    if rng.random() < 0.5:
        robot.planned.joints.joints.extend([9.0] * 6)
        robot.testSignals.joints.extend(rng.normal(0.0, 500.0, int(rng.integers(13))).tolist())
        robot.mciConvergenceMet, robot.moveIndex = True, 3
    return robot.SerializeToString()


def assert_as_protobuf(message: bytes) -> None:
    feedback_read, robot = decode(message), ROBOT.FromString(message)
    header, feedback = robot.header, robot.feedBack
    assert feedback_read.seqno == (header.seqno if header.HasField("seqno") else None)
    assert feedback_read.tm_ms == (header.tm if header.HasField("tm") else None)
    assert feedback_read.joints_deg == tuple(feedback.joints.joints)
    assert feedback_read.test_signals == tuple(robot.testSignals.joints)
    if feedback.HasField("timeStamp"):
        assert feedback_read.time_ns == feedback.timeStamp.sec * 10**9 + feedback.timeStamp.nsec
    elif feedback.HasField("time"):
        assert feedback_read.time_ns == feedback.time.sec * 10**9 + feedback.time.usec * 1000
    else:
        assert feedback_read.time_ns is None


def test_messages_of_protobuf_are_decoded_as_protobuf_does() -> None:
    rng = np.random.default_rng(1)
    for _ in range(2000):
        assert_as_protobuf(random_message(rng))


def test_unknown_fields_are_skipped_wherever_they_stand() -> None:
    rng = np.random.default_rng(2)
    strange = [
        number(99, 2**63),
        part(100, b"anything"),
        double(2**28, 1.0),
        varint(77 << 3 | 5) + b"four",
        number(2000, 0),
    ]
    for _ in range(300):
        parts = [strange[int(i)] for i in rng.integers(len(strange), size=3)]
        inner = parts[0] + part(1, parts[1] + double(1, 3.5)) + parts[2]
        assert_as_protobuf(
            parts[0]
            + part(1, number(1, 5) + parts[1])
            + part(2, inner)
            + parts[2]
            + random_message(rng)
        )


def test_packed_and_split_joints_are_joined_as_protobuf_does() -> None:
    packed = part(1, struct.pack("<3d", 1.0, 2.0, 3.0))
    assert_as_protobuf(part(2, part(1, packed + double(1, 4.0))) + part(2, part(1, double(1, 5.0))))
    assert decode(part(2, part(1, packed + double(1, 4.0)))).joints_deg == (1.0, 2.0, 3.0, 4.0)


def test_numbers_too_long_for_their_field_keep_the_digits_that_protobuf_keeps() -> None:
    assert_as_protobuf(part(1, number(1, 2**40 + 17)))
    assert_as_protobuf(part(1, b"\x08" + b"\xff" * 9 + b"\x01"))


def test_damaged_messages_give_what_protobuf_gives_or_an_error() -> None:
    rng, equal, refused = np.random.default_rng(3), 0, 0
    for _ in range(3000):
        message = bytearray(random_message(rng))
        if not message:
            continue
        for _ in range(int(rng.integers(1, 4))):
            message[int(rng.integers(len(message)))] ^= 1 << int(rng.integers(8))
        damaged = (
            bytes(message[: int(rng.integers(len(message))) + 1])
            if rng.random() < 0.3
            else bytes(message)
        )
        try:
            feedback_read = decode(damaged)
        except LogError:
            refused += 1
            continue
        try:
            robot = ROBOT.FromString(damaged)
        except DecodeError:
            continue  # damage in what we skip: poses, planned positions
        assert feedback_read.joints_deg == tuple(robot.feedBack.joints.joints)
        assert feedback_read.test_signals == tuple(robot.testSignals.joints)
        equal += 1
    assert equal > 300
    assert refused > 300


REFUSED = {
    "a field that runs over the end": (
        part(2, b"")[:1] + varint(2**40),
        "claims 1099511627776 bytes, 0 are left",
    ),
    "a number without end": (b"\x08" + b"\xff" * 30, "has no end"),
    "a group": (b"\x0b\x0c", "wire type 3"),
    "field number zero": (b"\x02\x01x", "field number 0"),
    "an angle that is no number": (part(2, part(1, double(1, math.nan))), "not finite"),
    "half a double": (part(2, part(1, part(1, b"abc"))), "a double has 8"),
    "microseconds beyond a second": (
        part(2, part(4, number(1, 5) + number(2, 1_000_000))),
        "cannot be",
    ),
    "a time beyond 64 bits": (part(2, part(4, number(1, 2**60) + number(2, 0))), "cannot be"),
    "a time without microseconds": (part(2, part(4, number(1, 5))), "without its fraction"),
    "more than a datagram": (bytes(LONGEST_MESSAGE + 1), "at most 65507"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_damaged_message_is_refused_in_words(what: str) -> None:
    message, words = REFUSED[what]
    with pytest.raises(LogError, match=words):
        decode(message)


def test_frames_come_back_as_written_and_a_torn_end_is_named() -> None:
    rng = np.random.default_rng(4)
    messages = [rng.bytes(int(size)) for size in rng.integers(1, 300, size=50)]
    content = FILE_START + b"".join(map(frame, messages))
    assert read_frames(content).messages == messages
    cut = read_frames(content[:-5])
    assert (cut.messages, cut.torn) == (
        messages[:-1],
        (len(content) - len(messages[-1]) - 8, len(content) - 6),
    )


def test_a_message_that_is_no_datagram_is_not_written() -> None:
    for message in (b"", bytes(LONGEST_MESSAGE + 1)):
        with pytest.raises(ValueError, match="1 to 65507 bytes"):
            frame(message)
