"""Feedback of an ABB controller over EGM: each UDP message as it came.

The robot sends, the recorder only listens. It hears the first sender of a segment and counts what
others send. The form of the file: ballbar.acquisition.formats.egm.
"""

from __future__ import annotations

import errno
import socket
import time
from collections.abc import Mapping
from itertools import islice

import numpy as np

from ballbar.acquisition.formats.egm import EgmFeedback, decode
from ballbar.acquisition.live.source import Batch, DeviceSilentError, Encoders
from ballbar.cell.egm_file import FILE_START, LONGEST_MESSAGE, frame
from ballbar.cell.errors import InputError, LogError
from ballbar.cell.logs import SourceName

LOOPBACK = "127.0.0.1"
DEFAULT_PORT = 6510  # ABB's for UdpUc devices
# [s] without a message: the EGM session has ended; gaps of a running session reach 25 ms
# (notes/log_formats sec. D).
SILENCE = 2.0
_REFUSED = {
    errno.EADDRINUSE: "another program listens there",
    errno.EADDRNOTAVAIL: "no network card has this address",
}
_BUFFER = 1 << 22  # bytes for the kernel to hold: several seconds of messages
# Messages; a network may swap neighbours, a new session goes back further.
_REORDERED = 10
# Messages a poll: a sender faster than the reader must not keep a poll from ending.
_MOST = 10_000
_LONGEST_POLL = 0.1  # [s] of a poll, for the same reason
_LONGEST = 4096  # bytes of a message; a robot's have some hundred
_AXES = 6


class EgmSource:
    """A UDP socket that takes EGM feedback.

    torque : whether test signals 1 to 6 are the axes' torques, which the messages do not say.

    It is bound at once, so that a port in use is known before the recording begins.

    Raises InputError if the address cannot be bound.
    """

    name: SourceName = "robot"
    file_suffix = ".egm"
    encoders = Encoders()
    channels = tuple(f"q{j}" for j in range(1, _AXES + 1))
    unit = "deg"

    def __init__(
        self, port: int = DEFAULT_PORT, *, address: str = LOOPBACK, torque: bool = False
    ) -> None:
        self.entry: Mapping[str, object] = {"dialect": "abb-egm-torque" if torque else "abb-egm"}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        try:
            self._socket.bind((address, port))
        except OSError as error:
            self._socket.close()
            reason = _REFUSED.get(error.errno or 0, error.strerror)
            raise InputError(f"--egm {address}:{port}: {reason}. Name another port.") from None
        self.quiet = "no EGM message at {}:{} yet".format(*self.address)
        self._sender: tuple[str, int] | None = None
        self._last_seqno: int | None = None
        self._held: list[tuple[bytes, EgmFeedback]] = []  # of the next session
        self._missing: set[int] = set()  # numbers skipped lately
        self._heard = 0.0

    @property
    def address(self) -> tuple[str, int]:
        """Where it listens."""
        host, port = self._socket.getsockname()
        return host, port

    def file_start(self) -> bytes:
        return FILE_START

    def connect(self) -> None:
        """Forgets the sender and the numbers of the last session."""
        self._sender, self._last_seqno, self._missing = None, None, set()
        self._heard = time.monotonic()

    def poll(self) -> Batch:
        messages, refused = self._held, 0
        self._held = []
        until = time.monotonic() + _LONGEST_POLL
        for content, sender in islice(iter(self._receive, None), _MOST):
            read = _read(content) if self._sender in (None, sender) else None
            if read is None:
                refused += 1
            else:
                self._sender = sender
                messages.append((content, read))
            if time.monotonic() > until:
                break
        if messages:
            self._heard = time.monotonic()
        elif self._last_seqno is not None and time.monotonic() - self._heard > SILENCE:
            raise DeviceSilentError(f"no EGM message for {SILENCE:g} s. Start EGM on the robot")
        return self._batch(messages, refused)

    def disconnect(self) -> None:
        """The socket stays bound: the robot may start its next session at any time."""

    def close(self) -> None:
        """Frees the port."""
        self._socket.close()

    def _receive(self) -> tuple[bytes, tuple[str, int]] | None:
        try:
            return self._socket.recvfrom(LONGEST_MESSAGE)
        except (BlockingIOError, InterruptedError):
            return None

    def _of_session(
        self, messages: list[tuple[bytes, EgmFeedback]]
    ) -> tuple[list[tuple[bytes, EgmFeedback]], int]:
        """The messages of the running session, and how many were lost; later ones are held."""
        lost, last = 0, self._last_seqno
        for i, (_, feedback) in enumerate(messages):
            number = feedback.seqno
            if number is None:
                continue
            if last is not None and last - number > _REORDERED:
                self._held = messages[i:]
                messages = messages[:i]
                break
            skipped = range(number if last is None else last + 1, number)
            lost += len(skipped) - (number in self._missing)  # late is not lost
            recent = {*self._missing, *skipped[-_REORDERED:]} - {number}
            self._missing = {n for n in recent if n > number - _REORDERED}
            last = number if last is None else max(last, number)
        self._last_seqno = last
        return messages, lost

    def _batch(self, messages: list[tuple[bytes, EgmFeedback]], refused: int) -> Batch:
        messages, lost = self._of_session(messages)
        ends = "the controller started a new EGM session" if self._held else ""
        complete = [feedback for _, feedback in messages if len(feedback.joints_deg) >= _AXES]
        angles = [feedback.joints_deg[:_AXES] for feedback in complete]
        stamps = [(f.tm_ms or 0) * 1_000_000 if f.time_ns is None else f.time_ns for f in complete]
        return Batch(
            records=[frame(content) for content, _ in messages],
            t_ns=np.array(stamps, dtype=np.int64),
            values=np.array(angles, dtype=np.float64).reshape(len(complete), _AXES),
            status=np.zeros(0, dtype=np.int64),
            lost=lost,
            refused=refused,
            ends=ends,
        )


def _read(content: bytes) -> EgmFeedback | None:
    """The message, or None if the datagram is none that a reader could use."""
    if not 0 < len(content) <= _LONGEST:
        return None
    try:
        return decode(content)
    except LogError:
        return None
