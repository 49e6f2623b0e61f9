"""Files of raw EGM messages as a table: controller time and axis angles of each message."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.formats.columns import DAMAGED_LIMIT, one_file, stored_bytes, wanted_columns
from acquisition.formats.egm import EgmFeedback, Frames, decode, read_frames
from acquisition.report import Finding, Severity, finding
from acquisition.table.header import Layout
from acquisition.table.table import Form, Table
from cell.errors import LogError

_AXES = tuple(f"J{axis}" for axis in range(1, 7))
# Messages that a network may hold back; a sequence number further back is a restart.
_REORDERED = 100


@dataclass(frozen=True, eq=False)
class _Messages:
    """The messages of a file, on their way to a table."""

    file: str
    feedback: list[EgmFeedback]
    number: NDArray[np.int64]  # (N,) of each message in the file, from 1
    findings: tuple[Finding, ...] = ()

    def take(self, indices: NDArray[np.intp]) -> _Messages:
        """The chosen messages."""
        feedback = [self.feedback[i] for i in indices]
        return replace(self, feedback=feedback, number=self.number[indices])

    def remarked(
        self, kind: str, severity: Severity, sentence: str, numbers: NDArray[np.int64]
    ) -> _Messages:
        """The messages with a finding about those of some numbers (K,)."""
        entry = finding(kind, severity, self.file, sentence, lines=numbers)
        return replace(self, findings=(*self.findings, entry))


def read_egm(path: Path, file: str, time: str, layout: Layout) -> tuple[Table, Form]:
    """Time [ns] and axis angles J1 to J6 [deg] of every message with feedback.

    They are in order of their sequence numbers; the lines are message numbers, counted from 1.
    Repeated messages, leading zeros and a torn end are left out and reported.
    Raises LogError if the file is damaged beyond DAMAGED_LIMIT, or messages have no joint angles or
    time.
    """
    content = stored_bytes(path, file)
    try:
        frames = read_frames(content.raw)
    except LogError as error:
        raise LogError(f"{file}: {error}") from None
    findings = (*content.findings, *_frame_findings(frames, content.raw, file))
    wanted = wanted_columns(layout, time, _AXES, file)
    number = np.array(frames.numbers, dtype=np.int64)
    messages = _Messages(file, _feedback(frames, file), number, findings)
    messages = _from_first_angles(_in_sequence(messages))
    angles = np.array([entry.joints_deg[:6] for entry in messages.feedback])
    far = np.argwhere(np.abs(angles) > 1e6)  # 9E9 is ABB's mark of an axis that is not there
    if far.size:
        row, axis = (int(index) for index in far[0])
        raise LogError(
            f"{file}:{messages.number[row]}: {_AXES[axis]} is {angles[row, axis]:g} deg: an axis "
            "that is not there, or damage. Record a robot of six axes, or copy the file again."
        )
    messages, times = _times(messages)
    columns: dict[str, NDArray[Any]] = {time: times}
    columns |= {name: angles[:, _AXES.index(name)].copy() for name in wanted}
    form = Form("protobuf", "none", "none", len(frames.numbers) + len(frames.damaged))
    return one_file(columns, file, messages.number, messages.findings), form


def _frame_findings(frames: Frames, raw: bytes, file: str) -> list[Finding]:
    """Findings about a torn end and damaged messages.

    Raises LogError if there are too many, or no message is left.
    """
    findings = []
    if frames.torn:
        first, last = frames.torn
        longest = max((len(message) for message in frames.messages), default=0)
        # More than a message under way.
        if raw[first:].strip(b"\0") and last - first > 2 * longest + 8:
            raise LogError(
                f"{file}: damaged at byte {first}: {len(frames.messages)} messages stand before "
                f"it, {last - first + 1} bytes behind it. Cut the file there."
            )
        sentence = (
            f"the file ends within a message or in NUL bytes (bytes {first} to {last}); left out."
        )
        findings.append(finding("torn end", "repaired", file, sentence, count=1))
    damaged, count = frames.damaged, len(frames.messages) + len(frames.damaged)
    if len(damaged) > max(1.0, DAMAGED_LIMIT * count):
        raise LogError(
            f"{file}:{damaged[0]}: {len(damaged)} of {count} messages have a wrong checksum: the "
            "file is damaged. Copy it again."
        )
    if damaged:
        sentence = "message damaged; dropped."
        findings.append(finding("checksum", "repaired", file, sentence, lines=damaged))
    if not frames.messages:
        raise LogError(
            f"{file}: no complete message. Copy it again, or record while the robot sends EGM."
        )
    return findings


def _feedback(frames: Frames, file: str) -> list[EgmFeedback]:
    feedback = []
    for message, number in zip(frames.messages, frames.numbers, strict=True):
        try:
            entry = decode(message)
        except LogError as error:
            raise LogError(f"{file}:{number}: {error}") from None
        if len(entry.joints_deg) not in {0, 6}:
            raise LogError(
                f"{file}:{number}: {len(entry.joints_deg)} joint angles; six axes are read. "
                "Record a robot of six axes, or copy the file again."
            )
        feedback.append(entry)
    return feedback


def _in_sequence(messages: _Messages) -> _Messages:
    """The messages in order of their sequence numbers, each once; lost ones are reported.

    As they came if the numbers start again.
    """
    numbers = [entry.seqno for entry in messages.feedback if entry.seqno is not None]
    if len(numbers) < len(messages.feedback):
        return messages
    seqno = np.array(numbers, dtype=np.int64)
    step = np.diff(seqno)
    if step.min(initial=0) < -_REORDERED:
        return messages  # a restart; the time shows whether it goes back
    if step.min(initial=1) < 0:
        sentence = "message came behind one that was sent later; put in order."
        late = messages.number[1:][step < 0]
        messages = messages.remarked("reordered message", "repaired", sentence, late)
    order = np.argsort(seqno, kind="stable")
    ordered, feedback = messages.number[order], [messages.feedback[i] for i in order]
    repeated = np.diff(seqno[order], prepend=-1) == 0
    for i in np.flatnonzero(repeated):
        if feedback[i] != feedback[i - 1]:
            raise LogError(
                f"{messages.file}:{ordered[i]}: sequence number {seqno[order[i]]} stands twice, "
                "with another content. Are two recordings in one file? Split it, or copy it again."
            )
    if repeated.any():
        sentence = "same message as the one before; the first is kept."
        messages = messages.remarked("repeated message", "repaired", sentence, ordered[repeated])
    first = order[~repeated]
    lost, messages = np.diff(seqno[first]) - 1, messages.take(first)
    if lost.any():
        sentence = f"{lost.sum()} messages lost before these."
        behind = messages.number[1:][lost > 0]
        messages = messages.remarked("lost messages", "warning", sentence, behind)
    return messages


def _from_first_angles(messages: _Messages) -> _Messages:
    """Without the messages before the first feedback, which have no joint angles or only zeros."""
    feedback, number = messages.feedback, messages.number
    start = _first(any(entry.joints_deg) for entry in feedback)
    if start is None:
        raise LogError(
            f"{messages.file}: no message has joint angles other than zero. "
            "Record again while the robot sends its feedback."
        )
    missing = _first(not entry.joints_deg for entry in feedback[start:])
    if missing is not None:
        raise LogError(
            f"{messages.file}:{number[start + missing]}: no joint angles in this message. "
            "Cut the file before it, or record again."
        )
    if start:
        sentence = "no joint angles, or zeros for all, before the first feedback; left out."
        messages = messages.remarked("leading zeros", "repaired", sentence, number[:start])
    return messages.take(np.arange(start, number.size))


def _times(messages: _Messages) -> tuple[_Messages, NDArray[np.int64]]:
    """(N,) [ns] of the controller's clock at the feedback, or of sending if no message has it."""
    times: Sequence[int | None] = [entry.time_ns for entry in messages.feedback]
    if all(time is None for time in times):
        sentence = (
            "no time in the feedback (RobotWare before 6.07): the time of sending is used, in "
            "whole milliseconds."
        )
        count = len(times)
        entry = finding("time of sending", "warning", messages.file, sentence, count=count)
        messages = replace(messages, findings=(*messages.findings, entry))
        sent = [feedback.tm_ms for feedback in messages.feedback]
        times = [None if tm is None else tm * 1_000_000 for tm in sent]
    missing = _first(time is None for time in times)
    if missing is not None:
        raise LogError(
            f"{messages.file}:{messages.number[missing]}: no time in this message. "
            "Cut the file before it, or record again."
        )
    return messages, np.array(times, dtype=np.int64)


def _first(where: Iterable[bool]) -> int | None:
    """Index of the first true value, if there is any."""
    return next((i for i, true in enumerate(where) if true), None)
