"""The ball-bar's encoders, from the ring buffer of a PLC to lines of the dialect `twincat-plc`."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from acquisition.faults.encoders import counts_to_rad, unwrap_counter
from acquisition.live.ring import SAMPLES_A_READ, RingReader
from acquisition.live.source import Batch, DeviceSilentError, Encoders
from cell.logs import SourceName
from cell.plc_ring import SAMPLE


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
    dialect = "twincat-plc"
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
        counter = samples["counter"][:, columns].astype(np.int64)
        status = samples["status"][:, columns].astype(np.int64)
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
