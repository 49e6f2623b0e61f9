"""One ROS 2 JointState message (sensor_msgs/msg/JointState) from CDR, the wire format of DDS.

    encapsulation (4 bytes: 00 01 = little-endian) | stamp sec int32, nanosec uint32 | frame_id |
    name[] | position[] | ...

Every number is aligned to its own size, counted from behind the encapsulation; strings and
sequences begin with a uint32 count. Bags bring the definitions of their messages along, from which
general readers make code; this message is always the same, and nothing in a bag is executed.
Source: OMG DDS-XTypes 1.3, section 7.4.3 (plain CDR); sensor_msgs/msg/JointState.msg.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import NamedTuple

from cell.errors import LogError

_REMEDY = "Copy the bag again, or correct the publisher and record again."
_LARGEST = 1_000_000  # bytes; a robot's message has a few hundred
_FORMS = 20  # remembered; a topic has one for each publisher


class JointState(NamedTuple):
    """Positions of some joints at one time."""

    stamp_ns: int  # header.stamp, not the time of recording
    positions: dict[str, float]  # [rad] by name: the order may change from message to message


@dataclass(frozen=True)
class MessageForm:
    """What messages of one publisher have in common: all but the numbers."""

    size: int  # [bytes]
    start: bytes  # encapsulation
    text: bytes  # what stands between the stamp and the positions
    stamp: struct.Struct
    values: struct.Struct  # of the positions
    names: tuple[str, ...]  # of the joints; () where there are no positions
    # The counts of velocities and efforts, and where they stand.
    counts: tuple[tuple[bytes, int, int], ...]

    def read(self, message: bytes) -> JointState | None:
        """A message of this form; None if it is of another, or its numbers cannot be."""
        begin = 12 + len(self.text)
        if len(message) != self.size or message[12:begin] != self.text or message[:4] != self.start:
            return None
        if any(message[first:stop] != count for count, first, stop in self.counts):
            return None
        seconds, nanoseconds = self.stamp.unpack_from(message, 4)
        positions = self.values.unpack_from(message, begin)
        if seconds < 0 or nanoseconds >= 1_000_000_000 or not math.isfinite(sum(positions)):
            return None
        return JointState(
            seconds * 1_000_000_000 + nanoseconds, dict(zip(self.names, positions, strict=True))
        )


class _Cdr:
    """A message that is read from its beginning to its end."""

    def __init__(self, message: bytes) -> None:
        if not 4 < len(message) <= _LARGEST or message[0] or message[1] not in {0, 1}:
            raise LogError(
                f"JointState: {len(message)} bytes that begin with {message[:4].hex()!r} are no "
                "plain CDR message. "
                f"{_REMEDY}"
            )
        self.order = "<" if message[1] else ">"
        self._body = message[4:]
        self._at = 0

    @property
    def position(self) -> int:
        """Byte of the message at which the next field begins, before its alignment."""
        return 4 + self._at

    def numbers(self, code: str, count: int = 1) -> tuple[float, ...]:
        """The next `count` numbers of a type code of the struct module."""
        size = struct.calcsize(code)
        at = self._at + -self._at % size if count else self._at
        if count * size > len(self._body) - at:
            raise LogError(
                f"JointState: {count} numbers of {size} bytes claimed at byte {at + 4}, "
                f"{len(self._body) - at} bytes are left. {_REMEDY}"
            )
        self._at = at + count * size
        return struct.unpack_from(f"{self.order}{count}{code}", self._body, at)

    def count(self) -> int:
        """The count before a string or a sequence."""
        return int(self.numbers("I")[0])

    def text(self) -> str:
        """A string, which ends in NUL."""
        count = self.count()
        stop = self._at + count
        if not 0 < count <= len(self._body) - self._at or self._body[stop - 1]:
            raise LogError(
                f"JointState: a text of {count} bytes at byte {self._at + 4} has no end. {_REMEDY}"
            )
        text = self._body[self._at : stop - 1]
        self._at = stop
        try:
            return text.decode("utf-8")
        except UnicodeDecodeError:
            raise LogError(f"JointState: {text[:30]!r} is no UTF-8. {_REMEDY}") from None


class JointStateDecoder:
    """Decodes the messages of a topic; it reads those of a known form without looking closer."""

    def __init__(self) -> None:
        self._forms: list[MessageForm] = []

    def decode(self, message: bytes) -> JointState:
        """Stamp and positions of one message.

        Raises LogError if the bytes are no such message, a joint stands twice, or a position is not
        finite.
        """
        for form in self._forms:
            state = form.read(message)
            if state is not None:
                return state
        state, form = _decoded(message)
        if len(self._forms) < _FORMS:
            self._forms.append(form)
        return state


def _decoded(message: bytes) -> tuple[JointState, MessageForm]:
    """The content of a message, and its form."""
    cdr = _Cdr(message)
    (seconds,), (nanoseconds,) = cdr.numbers("i"), cdr.numbers("I")
    if seconds < 0 or nanoseconds >= 1_000_000_000:
        raise LogError(
            f"JointState: a stamp of {seconds} s and {nanoseconds} ns cannot be. {_REMEDY}"
        )
    cdr.text()
    names = [cdr.text() for _ in range(_at_most(cdr.count(), len(message)))]
    positions = cdr.numbers("d", _at_most(cdr.count(), len(message)))
    begin, counts = cdr.position - 8 * len(positions), []
    if len(set(names)) < len(names) or len(positions) not in {0, len(names)}:
        raise LogError(
            f"JointState: {len(positions)} positions for the joints {', '.join(names[:12])}. "
            f"{_REMEDY}"
        )
    if not all(math.isfinite(position) for position in positions):
        raise LogError(f"JointState: a position is not finite: {positions[:12]}. {_REMEDY}")
    for _ in range(2):  # velocity and effort, often empty: only the end of the message is checked
        count = cdr.count()
        counts.append((message[cdr.position - 4 : cdr.position], cdr.position - 4, cdr.position))
        cdr.numbers("d", _at_most(count, len(message)))
    form = MessageForm(
        size=len(message),
        start=message[:4],
        text=message[12:begin],
        stamp=struct.Struct(f"{cdr.order}iI"),
        values=struct.Struct(f"{cdr.order}{len(positions)}d"),
        names=tuple(names) if positions else (),
        counts=tuple(counts),
    )
    stamp_ns = int(seconds) * 1_000_000_000 + int(nanoseconds)
    return JointState(stamp_ns, dict(zip(names, positions, strict=False))), form


def _at_most(count: int, size: int) -> int:
    if count > size:
        raise LogError(
            f"JointState: a sequence of {count} claimed in a message of {size} bytes. {_REMEDY}"
        )
    return count
