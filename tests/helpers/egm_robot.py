"""A robot that speaks EGM: Google's protobuf makes its messages from the published description."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import Message

PERIOD_NS = 4_032_000
START_S = 1_795_000_000

_UINT32, _UINT64, _DOUBLE, _REPEATED_DOUBLE = 13, 4, 1, 101
_EGM: dict[str, list[tuple[str, int, int | str]]] = {
    "EgmHeader": [("seqno", 1, _UINT32), ("tm", 2, _UINT32), ("mtype", 3, _UINT32)],
    "EgmJoints": [("joints", 1, _REPEATED_DOUBLE)],
    "EgmClock": [("sec", 1, _UINT64), ("usec", 2, _UINT64)],
    "EgmFeedBack": [
        ("joints", 1, "EgmJoints"),
        ("externalJoints", 3, "EgmJoints"),
        ("time", 4, "EgmClock"),
    ],
    "EgmMotorState": [("state", 1, _UINT32)],
    "EgmRobot": [
        ("header", 1, "EgmHeader"),
        ("feedBack", 2, "EgmFeedBack"),
        ("planned", 3, "EgmFeedBack"),
        ("motorState", 4, "EgmMotorState"),
        ("utilizationRate", 10, _DOUBLE),
    ],
}


def _robot_class() -> type[Message]:
    file = descriptor_pb2.FileDescriptorProto(
        name="live_egm.proto", package="live_egm", syntax="proto2"
    )
    for name, fields in _EGM.items():
        message = file.message_type.add(name=name)
        for field, number, kind in fields:
            made = message.field.add(
                name=field, number=number, label=3 if kind == _REPEATED_DOUBLE else 1
            )
            if isinstance(kind, str):
                made.type, made.type_name = 11, f".live_egm.{kind}"
            else:
                made.type = kind % 100
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("live_egm.EgmRobot"))


_ROBOT = _robot_class()


def egm_message(seqno: int, joints_deg: Sequence[float]) -> bytes:
    """EgmRobot number `seqno`, with the fields that the recorder does not read."""
    elapsed_ns = seqno * PERIOD_NS
    clock = {"sec": START_S + elapsed_ns // 10**9, "usec": elapsed_ns % 10**9 // 1000}
    feedback = {
        "joints": {"joints": list(joints_deg)},
        "externalJoints": {"joints": [0.0] * 6},
        "time": clock,
    }
    robot = _ROBOT(
        header={"seqno": seqno, "tm": elapsed_ns // 10**6 % 2**32, "mtype": 2},
        feedBack=feedback,
        planned=feedback,
        motorState={"state": 1},
        utilizationRate=12.5,
    )
    return robot.SerializeToString()


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
