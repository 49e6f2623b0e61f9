"""The ball-bar's encoders, from the ring buffer of a PLC to lines of the dialect `twincat-plc`.

No sample of the ring (ballbar.cell.plc_ring) is lost or doubled unnoticed. The slots below
`written` are complete, and sample n is overwritten from the moment that `written` reaches n +
capacity: `written` is read again after the samples, and those that may have been overwritten
meanwhile are left out and counted as lost. If `started` changes, the PLC was restarted and its
samples count from 0 again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.faults.encoders import counts_to_rad, unwrap_counter
from ballbar.acquisition.live.source import Batch, DeviceSilentError, Encoders
from ballbar.cell.logs import SourceName
from ballbar.cell.plc_ring import HEADER, LAYOUT, SAMPLE

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
                "the PLC's ring has another layout than that of docs/plc/ball_bar.st, or that "
                "program does not run yet. Load and start it"
            )
        if not 0 < fitted < 32 or not 8 <= bits <= 13:
            what = f"fitted = {fitted}, bits = {bits}. Correct them in the PLC's program"
            raise DeviceSilentError(f"the ring names no encoder, or none of an EL5021: {what}")
        encoders = Encoders(tuple(j for j in range(1, 6) if fitted >> (j - 1) & 1), bits)
        return _Header(capacity, int(raw["started"]), int(raw["written"]), encoders)


class Memory(Protocol):
    """The ring in the PLC's memory."""

    def open(self) -> None:
        """Raises DeviceSilentError when the PLC does not answer."""

    def read(self, offset: int, size: int) -> bytes:
        """Raises DeviceSilentError when the PLC has gone."""

    def close(self) -> None:
        """Never raises."""


class PlcSource:
    """Lines of raw counters and status words with DC stamps, for each encoder that the PLC reads.

    lines : of each encoder, for the angles shown on the way.
    """

    name: SourceName = "ballbar"
    entry: Mapping[str, object] = {"dialect": "twincat-plc"}
    unit = "deg"
    file_suffix = ".csv"
    quiet = "the PLC answers, but writes no samples: is its program running?"

    def __init__(self, memory: Memory, *, lines: int) -> None:
        self._memory = memory
        self._lines = lines
        self._ring = RingReader(memory.read)
        self.encoders = Encoders()  # as the PLC states them, once it was connected
        self.channels: tuple[str, ...] = ()  # of these encoders
        # Taken and not yet handed on; those after a step of the clock wait for the next file.
        self._held = _no_samples()
        self._last_time: int | None = None  # stamp of the segment's last sample
        # Counter words, and counts since the first sample.
        self._last: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None

    def file_start(self) -> bytes:
        names = ["time", *self.channels, *(f"s{j}" for j in self.encoders.joints)]
        return (";".join(names) + "\r\n").encode("ascii")

    def connect(self) -> None:
        self._memory.open()
        self._ring.attach()
        if self.encoders.joints and self._ring.encoders != self.encoders:
            raise DeviceSilentError(
                "the PLC reads other encoders than before, or at another resolution: end this "
                "recording"
            )
        self.encoders = self._ring.encoders
        self.channels = tuple(f"b{j}" for j in self.encoders.joints)
        self._last_time = None

    def poll(self) -> Batch:
        lost = 0
        while True:
            try:
                taken = self._ring.take()
            except DeviceSilentError as error:
                if not self._held.size:
                    raise
                return self._batch(lost, ends=str(error))
            self._held = np.concatenate((self._held, taken.samples))
            lost += taken.lost
            if taken.samples.size + taken.lost < SAMPLES_A_READ:
                return self._batch(lost)

    def disconnect(self) -> None:
        self._memory.close()

    def _batch(self, lost: int, *, ends: str = "") -> Batch:
        """The samples held, up to a step back of their clock."""
        samples, self._held = self._held, _no_samples()
        time = samples["time"].astype(np.int64)
        before = time[:1] if self._last_time is None else self._last_time
        back = np.flatnonzero(np.diff(time, prepend=before) < 0)
        if back.size:
            ends = "the PLC's clock was set back"
            samples, self._held = samples[: back[0]], samples[back[0] :]
        time = samples["time"].astype(np.int64)
        self._last_time = int(time[-1]) if time.size else self._last_time
        columns = [joint - 1 for joint in self.encoders.joints]
        counter, status = (samples[k][:, columns].astype(np.int64) for k in ("counter", "status"))
        rows = np.column_stack((time, counter, status)).tolist()
        records = [(";".join(map(str, row)) + "\r\n").encode("ascii") for row in rows]
        return Batch(
            records=records,
            t_ns=time,
            values=self._angles(counter),
            status=np.bitwise_or.reduce(status, axis=0),
            lost=lost,
            ends=ends,
        )

    def _angles(self, counter: NDArray[np.int64]) -> NDArray[np.float64]:
        """(N, K) [deg] turned since the first sample of the recording; counter (N, K) words."""
        if not len(counter):
            return np.zeros(counter.shape)
        last, total = self._last or (counter[0], np.zeros(counter.shape[1], dtype=np.int64))
        words = np.vstack((last, counter)).T
        counts = np.stack([unwrap_counter(column) for column in words], axis=1)
        counts += total - counts[0]
        self._last, bits = (counter[-1], counts[-1]), self.encoders.bits
        return np.rad2deg(counts_to_rad(counts[1:], lines=self._lines, bits=bits, sign=1))


def _no_samples() -> NDArray[np.void]:
    return np.zeros(0, dtype=SAMPLE)
