"""No sample of the PLC's ring buffer lost or doubled unnoticed; its layout is in cell.plc_ring.

The slots below `written` are complete, and sample n is overwritten from the moment that `written`
reaches n + capacity: `written` is read again after the samples, and those that may have been
overwritten meanwhile are left out and counted as lost. If `started` changes, the PLC was restarted
and its samples count from 0 again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquisition.live.source import DeviceSilentError, Encoders
from cell.plc_ring import HEADER, LAYOUT, SAMPLE

CAPACITIES = range(16, 1 << 20)  # samples
SAMPLES_A_READ = 500  # 24 kB; larger ADS reads only keep the PLC's router busy longer

Read = Callable[[int, int], bytes]  # offset, size -> the ring's bytes; raises DeviceSilentError


@dataclass(frozen=True, eq=False)
class Taken:
    """Samples out of the ring, in order."""

    samples: NDArray[np.void]  # (N,) SAMPLE
    lost: int  # samples before or among them that were overwritten unread


@dataclass(frozen=True)
class _Header:
    capacity: int
    started: int
    written: int
    encoders: Encoders


class RingReader:
    """Takes samples out of the ring, each once.

    `read` may fail at any time; the position survives, also a reconnection.
    """

    def __init__(self, read: Read) -> None:
        self._read = read
        self._life: int | None = None  # `started` of the PLC's life that `_next` counts in
        self._next = 0  # the sample wanted next
        self.encoders = Encoders()

    def attach(self) -> None:
        """Finds the sample to go on with: the present at first, later the one after the last taken.

        Raises DeviceSilentError if the memory holds no ring of this layout.
        """
        header = self._header()
        if self._life is None:
            self._next = header.written
        elif header.started != self._life or header.written < self._next:
            self._next = 0
        self._life = header.started
        self.encoders = header.encoders

    def take(self) -> Taken:
        """The samples since the last call, at most SAMPLES_A_READ.

        Raises DeviceSilentError if the PLC was restarted or its memory has moved: attach again.
        """
        before = self._living_header()
        first = max(self._next, before.written - before.capacity)
        count = min(before.written - first, SAMPLES_A_READ)
        samples = self._slots(first, count, before.capacity)
        after = self._living_header()
        overwritten = min(max(0, after.written - after.capacity + 1 - first), count)
        samples = samples[overwritten:]
        expected = np.arange(first + overwritten, first + count, dtype=np.uint64) + np.uint64(1)
        if not np.array_equal(samples["sequence"], expected):
            raise DeviceSilentError(
                "the ring's sequence numbers do not follow one another; the PLC's program was "
                "changed. End this recording and begin another"
            )
        lost = first + overwritten - self._next
        self._next = first + count
        return Taken(samples, lost)

    def _slots(self, first: int, count: int, capacity: int) -> NDArray[np.void]:
        parts, number = [np.zeros(0, dtype=SAMPLE)], first
        while number < first + count:  # twice where the ring ends between
            slot = number % capacity
            size = min(first + count - number, capacity - slot)
            raw = self._read(HEADER.itemsize + slot * SAMPLE.itemsize, size * SAMPLE.itemsize)
            parts.append(np.frombuffer(raw, dtype=SAMPLE))
            number += size
        return np.concatenate(parts)

    def _living_header(self) -> _Header:
        header = self._header()
        if header.started != self._life or header.written < self._next:
            raise DeviceSilentError("the PLC was restarted")
        return header

    def _header(self) -> _Header:
        raw = np.frombuffer(self._read(0, HEADER.itemsize), dtype=HEADER)[0]
        layout, capacity, fitted, bits = (
            int(raw[name]) for name in ("layout", "capacity", "fitted", "bits")
        )
        if layout != LAYOUT or capacity not in CAPACITIES:
            raise DeviceSilentError(
                "the PLC's ring has another layout than that of docs/recorder.md, or its program "
                "does not run yet. Load and start that program"
            )
        if not 0 < fitted < 32 or not 8 <= bits <= 13:
            raise DeviceSilentError(
                f"the PLC's ring names no encoder, or none of an EL5021: fitted = {fitted}, bits = "
                f"{bits}. "
                "Correct them in the PLC's program"
            )
        encoders = Encoders(tuple(j for j in range(1, 6) if fitted >> (j - 1) & 1), bits)
        return _Header(capacity, int(raw["started"]), int(raw["written"]), encoders)
