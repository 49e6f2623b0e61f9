"""Files of raw EGM messages as a table: controller time, axis angles and test signals of each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.formats.columns import DAMAGED_LIMIT, one_file, wanted_columns
from ballbar.acquisition.formats.egm import EgmFeedback, EgmFrames, decode, read_frames
from ballbar.acquisition.report import Finding, finding
from ballbar.acquisition.table.header import Layout
from ballbar.acquisition.table.table import Form, Table
from ballbar.acquisition.table.text import read_filled
from ballbar.cell.errors import LogError

_AXES = tuple(f"J{axis}" for axis in range(1, 7))
# Messages that a network may hold back; a sequence number further back is a restart.
_REORDERED = 100
_SIGNALS = 12  # channels of test signals that an ABB controller has
_FEEDBACK = "feedback"  # column of the decoded messages


def read_egm(path: Path, file: str, time: str, layout: Layout) -> tuple[Table, Form]:
    """Time [ns], axis angles J1 to J6 [deg] and test signals S1, S2, .. of messages with feedback.

    They are in order of their sequence numbers; the lines are message numbers, counted from 1.
    Repeated messages, leading zeros and a torn end are left out and reported.
    Raises LogError if the file is damaged beyond DAMAGED_LIMIT, or messages have no joint angles or
    time.
    """
    content = read_filled(path, file)
    try:
        frames = read_frames(content.raw)
    except LogError as error:
        raise LogError(f"{file}: {error}") from None
    findings = (*content.findings, *_frame_findings(frames, content.raw, file))
    rows = np.empty(len(frames.messages), dtype=object)
    rows[:] = _feedback(frames, file)
    table = one_file({_FEEDBACK: rows}, file, np.array(frames.numbers, dtype=np.int64), findings)
    table = _from_first_angles(_in_sequence(table))
    feedback = table.columns[_FEEDBACK].tolist()
    angles = np.array([entry.joints_deg for entry in feedback])
    far = np.argwhere(np.abs(angles) > 1e6)  # 9E9 is ABB's mark of an axis that is not there
    if far.size:
        row, axis = (int(index) for index in far[0])
        raise LogError(
            f"{table.location(row)}: {_AXES[axis]} is {angles[row, axis]:g} deg: an axis that is "
            "not there, or damage. Record a robot of six axes, or copy the file again."
        )
    measured = dict(zip(_AXES, angles.T, strict=True))
    table, signals = _test_signals(table, feedback, layout)
    measured |= signals
    table, times = _times(table, feedback)
    wanted = wanted_columns(layout, time, measured, file)
    columns: dict[str, NDArray[Any]] = {time: times}
    columns |= {name: measured[name].copy() for name in wanted}
    form = Form("protobuf", "none", "none", len(frames.numbers) + len(frames.damaged))
    return replace(table, columns=columns), form


def _torn_end(frames: EgmFrames, raw: bytes, file: str, first: int, last: int) -> Finding:
    """The finding about an end at bytes `first` to `last`; LogError for more than one message."""
    longest = max((len(message) for message in frames.messages), default=0)
    if raw[first:].strip(b"\0") and last - first > 2 * longest + 8:
        raise LogError(
            f"{file}: damaged at byte {first}: {len(frames.messages)} messages stand before it, "
            f"{last - first + 1} bytes behind it. Cut the file there."
        )
    sentence = f"the file ends within a message or in NUL (bytes {first} to {last}); left out."
    return finding("torn end", file, sentence, count=1)


def _frame_findings(frames: EgmFrames, raw: bytes, file: str) -> list[Finding]:
    """Findings about a torn end and damaged messages.

    Raises LogError if there are too many, or no message is left.
    """
    findings = [_torn_end(frames, raw, file, *frames.torn)] if frames.torn else []
    damaged, count = frames.damaged, len(frames.messages) + len(frames.damaged)
    if len(damaged) > max(1.0, DAMAGED_LIMIT * count):
        what = f"{len(damaged)} of {count} messages have a wrong checksum: the file is damaged."
        raise LogError.at(f"{file}:{damaged[0]}", what, "Copy it again.")
    if damaged:
        sentence = "message damaged; dropped."
        findings.append(finding("checksum", file, sentence, lines=damaged))
    if not frames.messages:
        what = "no complete message."
        raise LogError.at(file, what, "Copy it again, or record while the robot sends EGM.")
    return findings


def _feedback(frames: EgmFrames, file: str) -> list[EgmFeedback]:
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


def _in_sequence(table: Table) -> Table:
    """The messages in order of their sequence numbers, each once; lost ones are reported.

    As they came if the numbers start again.
    """
    feedback = table.columns[_FEEDBACK]
    numbers = [entry.seqno for entry in feedback if entry.seqno is not None]
    if len(numbers) < len(feedback):
        return table
    seqno = np.array(numbers, dtype=np.int64)
    step = np.diff(seqno)
    if step.min(initial=0) < -_REORDERED:
        return table  # a restart; the time shows whether it goes back
    if step.min(initial=1) < 0:
        sentence = "message came behind one that was sent later; put in order."
        late = np.flatnonzero(step < 0) + 1
        table = table.remarked("reordered message", sentence, rows=late)
    order = np.argsort(seqno, kind="stable")
    repeated = np.flatnonzero(np.diff(seqno[order], prepend=-1) == 0)
    for before, row in zip(order[repeated - 1], order[repeated], strict=True):
        if feedback[row] != feedback[before]:
            raise LogError(
                f"{table.location(row)}: sequence number {seqno[row]} stands twice, with another "
                "content. Are two recordings in one file? Split it, or copy it again."
            )
    if repeated.size:
        sentence = "same message as the one before; the first is kept."
        table = table.remarked("repeated message", sentence, rows=order[repeated])
    first = np.delete(order, repeated)
    lost, table = np.diff(seqno[first]) - 1, table.take(first)
    if lost.any():
        sentence = f"{lost.sum()} messages lost before these."
        behind = np.flatnonzero(lost) + 1
        table = table.remarked("lost messages", sentence, rows=behind)
    return table


def _from_first_angles(table: Table) -> Table:
    """Without the messages before the first feedback, which have no joint angles or only zeros."""
    angles = [entry.joints_deg for entry in table.columns[_FEEDBACK]]
    start = _first(map(any, angles))
    if start is None:
        what = "no message has joint angles other than zero."
        raise LogError.at(table.files[0], what, "Record again while the robot sends its feedback.")
    missing = _first(not entry for entry in angles[start:])
    if missing is not None:
        raise LogError(
            f"{table.location(start + missing)}: no joint angles in this message. Cut the file "
            "before it, or record again."
        )
    if start:
        sentence = "no joint angles, or zeros for all, before the first feedback; left out."
        table = table.remarked("leading zeros", sentence, rows=np.arange(start))
    return table.take(np.arange(start, len(table)))


def _test_signals(
    table: Table, feedback: list[EgmFeedback], layout: Layout
) -> tuple[Table, dict[str, NDArray[Any]]]:
    """The test signals that all messages have, by name; none, and reported, if they are empty.

    Controllers are known that send zeros whatever was defined (ros-industrial/abb_libegm, issue
    86); a torque of zero would be believed.
    """
    names = [f"S{channel}" for channel in range(1, _SIGNALS + 1)]
    if not any(name in layout.optional or name in layout.required for name in names):
        return table, {}
    fewest = min((len(entry.test_signals) for entry in feedback), default=0)
    values = np.array([entry.test_signals[:fewest] for entry in feedback])
    if fewest and values.any():
        return table, dict(zip(names, values.T, strict=False))
    what = "holds zeros only" if fewest else "is not in every message"
    sentence = f"the field of test signals {what}; they are left out."
    return table.remarked("no test signals", sentence, count=len(feedback)), {}


def _times(table: Table, feedback: list[EgmFeedback]) -> tuple[Table, NDArray[np.int64]]:
    """(N,) [ns] of the controller's clock at the feedback, or of sending if no message has it."""
    times: Sequence[int | None] = [entry.time_ns for entry in feedback]
    if all(time is None for time in times):
        sentence = "no time in the feedback (RobotWare before 6.07): that of sending is used."
        table = table.remarked("time of sending", sentence, count=len(times))
        times = [None if e.tm_ms is None else e.tm_ms * 1_000_000 for e in feedback]
    missing = _first(time is None for time in times)
    if missing is not None:
        what = "no time in this message."
        raise LogError.at(table.location(missing), what, "Cut the file before it, or record again.")
    return table, np.array(times, dtype=np.int64)


def _first(where: Iterable[bool]) -> int | None:
    """Index of the first true value, if there is any."""
    return next((i for i, true in enumerate(where) if true), None)
