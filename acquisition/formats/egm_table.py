"""Files of raw EGM messages as a table: the controller's time and the axis angles of each message."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.formats.columns import DAMAGED_LIMIT, one_file, stored_bytes, wanted_columns
from acquisition.formats.egm import EgmFeedback, Frames, decode, read_frames
from acquisition.report import Finding, finding
from acquisition.table.header import Layout
from acquisition.table.table import Form, Table
from cell.errors import LogError

_AXES = tuple(f"J{axis}" for axis in range(1, 7))
_REORDERED = (
    100  # messages that a network may hold back; a sequence number further back is a restart
)


def read_egm(
    path: Path, file: str, time: str, layout: Layout, findings: list[Finding]
) -> tuple[Table, Form]:
    """Time [ns] and axis angles J1 to J6 [deg] of every message with feedback, in order of their sequence numbers.

    The lines are message numbers, counted from 1. Repeated messages, leading zeros and a torn end are left out and reported.
    Raises LogError if the file is damaged beyond DAMAGED_LIMIT, or messages have no joint angles or no time.
    """
    raw = stored_bytes(path, file, findings)
    try:
        frames = read_frames(raw)
    except LogError as error:
        raise LogError(f"{file}: {error}") from None
    _report_frames(frames, raw, file, findings)
    wanted = wanted_columns(layout, time, _AXES, file)
    feedback, number = _feedback(frames, file)
    feedback, number = _in_sequence(feedback, number, file, findings)
    feedback, number = _from_first_angles(feedback, number, file, findings)
    angles = np.array([one.joints_deg[:6] for one in feedback])
    far = np.argwhere(np.abs(angles) > 1e6)  # 9E9 is ABB's mark of an axis that is not there
    if far.size:
        row, axis = (int(index) for index in far[0])
        raise LogError(
            f"{file}:{number[row]}: {_AXES[axis]} is {angles[row, axis]:g} deg: an axis that is not there, or damage."
        )
    columns: dict[str, NDArray[Any]] = {time: _times(feedback, number, file, findings)}
    columns |= {name: angles[:, _AXES.index(name)].copy() for name in wanted}
    return one_file(columns, file, number), Form(
        "protobuf", "none", "none", len(frames.numbers) + len(frames.damaged)
    )


def _report_frames(frames: Frames, raw: bytes, file: str, findings: list[Finding]) -> None:
    if frames.torn:
        first, last = frames.torn
        longest = max((len(message) for message in frames.messages), default=0)
        if (
            raw[first:].strip(b"\0") and last - first > 2 * longest + 8
        ):  # more than a message under way
            before = f"{len(frames.messages)} messages stand before it"
            raise LogError(
                f"{file}: damaged at byte {first}: {before}, {last - first + 1} bytes behind it. Cut the file there."
            )
        sentence = (
            f"the file ends within a message or in NUL bytes (bytes {first} to {last}); left out."
        )
        findings.append(finding("torn end", "repaired", file, sentence, count=1))
    count = len(frames.messages) + len(frames.damaged)
    if len(frames.damaged) > max(1.0, DAMAGED_LIMIT * count):
        raise LogError(
            f"{file}:{frames.damaged[0]}: {len(frames.damaged)} of {count} messages have a wrong checksum: the file is damaged."
        )
    if frames.damaged:
        findings.append(
            finding("checksum", "repaired", file, "message damaged; dropped.", lines=frames.damaged)
        )
    if not frames.messages:
        raise LogError(f"{file}: no complete message.")


def _feedback(frames: Frames, file: str) -> tuple[list[EgmFeedback], NDArray[np.int64]]:
    feedback = []
    for message, number in zip(frames.messages, frames.numbers, strict=True):
        try:
            one = decode(message)
        except LogError as error:
            raise LogError(f"{file}:{number}: {error}") from None
        if len(one.joints_deg) not in {0, 6}:
            raise LogError(
                f"{file}:{number}: {len(one.joints_deg)} joint angles; six axes are read."
            )
        feedback.append(one)
    return feedback, np.array(frames.numbers, dtype=np.int64)


def _in_sequence(
    feedback: list[EgmFeedback], number: NDArray[np.int64], file: str, findings: list[Finding]
) -> tuple[list[EgmFeedback], NDArray[np.int64]]:
    """In order of the sequence numbers, each once; lost messages are reported. As they came if the numbers start again."""
    if any(one.seqno is None for one in feedback):
        return feedback, number
    seqno = np.array([one.seqno for one in feedback], dtype=np.int64)
    step = np.diff(seqno)
    if step.min(initial=0) < -_REORDERED:
        return feedback, number  # a restart; the time tells whether it goes back
    if step.min(initial=1) < 0:
        sentence = "message came behind one that was sent later; put in order."
        findings.append(
            finding("reordered message", "repaired", file, sentence, lines=number[1:][step < 0])
        )
    order = np.argsort(seqno, kind="stable")
    repeated = np.diff(seqno[order], prepend=-1) == 0
    for i in np.flatnonzero(repeated):
        if feedback[order[i]] != feedback[order[i - 1]]:
            raise LogError(
                f"{file}:{number[order[i]]}: sequence number {seqno[order[i]]} stands twice, with another content."
            )
    if repeated.any():
        sentence = "same message as the one before; the first is kept."
        findings.append(
            finding("repeated message", "repaired", file, sentence, lines=number[order][repeated])
        )
    kept = order[~repeated]
    lost = np.diff(seqno[kept]) - 1
    if lost.any():
        sentence = f"{lost.sum()} messages lost before these."
        findings.append(
            finding("lost messages", "warning", file, sentence, lines=number[kept][1:][lost > 0])
        )
    return [feedback[i] for i in kept], number[kept]


def _from_first_angles(
    feedback: list[EgmFeedback], number: NDArray[np.int64], file: str, findings: list[Finding]
) -> tuple[list[EgmFeedback], NDArray[np.int64]]:
    """Without the messages before the first feedback, which have no joint angles, or zeros for all."""
    start = next((i for i, one in enumerate(feedback) if any(one.joints_deg)), None)
    if start is None:
        raise LogError(f"{file}: no message has joint angles other than zero.")
    if start:
        sentence = "no joint angles, or zeros for all, before the first feedback; left out."
        findings.append(finding("leading zeros", "repaired", file, sentence, lines=number[:start]))
    later = next((i for i in range(start, len(feedback)) if not feedback[i].joints_deg), None)
    if later is not None:
        raise LogError(f"{file}:{number[later]}: no joint angles in this message.")
    return feedback[start:], number[start:]


def _times(
    feedback: list[EgmFeedback], number: NDArray[np.int64], file: str, findings: list[Finding]
) -> NDArray[np.int64]:
    """[ns] of the controller's clock at the feedback, or of sending if no message has it."""
    if all(one.time_ns is None for one in feedback):
        sentence = "no time in the feedback (RobotWare before 6.07): the time of sending is used, in whole milliseconds."
        findings.append(finding("time of sending", "warning", file, sentence, count=len(feedback)))
        feedback = [
            replace(one, time_ns=None if one.tm_ms is None else one.tm_ms * 1_000_000)
            for one in feedback
        ]
    without = next((i for i, one in enumerate(feedback) if one.time_ns is None), None)
    if without is not None:
        raise LogError(f"{file}:{number[without]}: no time in this message.")
    return np.array([one.time_ns for one in feedback], dtype=np.int64)
