"""A PLC on loopback: the program of docs/recorder.md in Python, behind pyads' ADS test server.

Sample n follows from n alone, so that a recording can be compared with the PLC byte by byte.
"""

from __future__ import annotations

import threading
import time
from types import TracebackType

import numpy as np
from numpy.typing import NDArray
from pyads.constants import ADST_VOID
from pyads.testserver import AdsTestServer, AdvancedHandler, PLCVariable

from acquisition.live.ring import HEADER, LAYOUT, SAMPLE

SYMBOL = "GVL_BallBar.stRing"
GROUP, OFFSET = 0x4040, 4096  # where TwinCAT keeps data of a PLC
START = 848_000_000_000_000_000  # [ns] DC time in November 2026
CAPACITY = 4096
JOINTS = (1, 2, 4, 5)


def plc_samples(first: int, count: int, period_ns: int) -> NDArray[np.void]:
    """Samples `first` .. of a PLC.

    Counters wrap and run both ways; status words have a toggle bit and rare faults.
    """
    n = np.arange(first, first + count, dtype=np.int64)
    samples = np.zeros(count, dtype=SAMPLE)
    samples["sequence"] = n + 1
    samples["time"] = START + n * period_ns
    phase = 1e-9 * period_ns * n
    for j in range(5):
        swing = np.rint(2e6 * np.sin((0.4 + 0.1 * j) * phase)).astype(np.int64) + 7 * j
        samples["counter"][:, j] = swing % 2**32
        samples["status"][:, j] = (n % 2) << 15
    return samples


def text_of(samples: NDArray[np.void], joints: tuple[int, ...] = JOINTS) -> bytes:
    """The file that the recorder must make of samples, written down independently of it."""
    lines = ["time;" + ";".join(f"b{j}" for j in joints) + ";" + ";".join(f"s{j}" for j in joints)]
    for sample in samples:
        words = [int(sample["time"])]
        words += [int(sample["counter"][j - 1]) for j in joints]
        words += [int(sample["status"][j - 1]) for j in joints]
        lines.append(";".join(str(word) for word in words))
    return ("\r\n".join(lines) + "\r\n").encode()


class _Memory(AdvancedHandler):
    """The data area of the PLC: reads may begin anywhere inside a variable, as on TwinCAT."""

    def __init__(self, ring: bytearray, header_reads: list[int]) -> None:
        super().__init__()
        self.ring, self.header_reads = ring, header_reads
        self.add_variable(
            PLCVariable(SYMBOL, bytes(len(ring)), ADST_VOID, "ST_BallBarRing", GROUP, OFFSET)
        )

    def get_variable_by_indices(self, index_group: int, index_offset: int) -> PLCVariable:
        if index_offset == OFFSET:
            self.header_reads.append(
                int(np.frombuffer(self.ring, dtype=HEADER, count=1)["written"][0])
            )
        found = super().get_variable_by_indices(index_group, OFFSET)
        found.value = memoryview(self.ring)[index_offset - OFFSET :]
        return found


class Plc:
    """Samples at a rate until the block ends; the server can be taken away and brought back."""

    def __init__(
        self,
        address: str,
        rate: float,
        *,
        capacity: int = CAPACITY,
        joints: tuple[int, ...] = JOINTS,
        counters: NDArray[np.int64] | None = None,
    ) -> None:
        """counters : (N, 5) of the samples, in place of those that follow from their numbers."""
        self._counters = counters
        self.address, self.period_ns, self.capacity = address, round(1e9 / rate), capacity
        self.net_id = f"{address}.1.1"
        self.header_reads: list[int] = []  # `written` whenever a recorder looked at it
        self._ring = bytearray(HEADER.itemsize + capacity * SAMPLE.itemsize)
        self._header = np.frombuffer(self._ring, dtype=HEADER, count=1)
        self._slots = np.frombuffer(self._ring, dtype=SAMPLE, offset=HEADER.itemsize)
        fitted = sum(1 << (j - 1) for j in joints)
        self._header[0] = (LAYOUT, capacity, fitted, 12, START, 0)
        self._stop = threading.Event()
        self._task = threading.Thread(target=self._cycle, daemon=True)
        self._server: AdsTestServer | None = None

    @property
    def written(self) -> int:
        return int(self._header["written"][0])

    def __enter__(self) -> Plc:
        self.connect()
        self._task.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._task.join()
        self.disconnect()

    def connect(self) -> None:
        self._server = AdsTestServer(
            _Memory(self._ring, self.header_reads), ip_address=self.address, logging=False
        )
        self._server.start()

    def disconnect(self) -> None:
        """Ends the connections and the server; the program goes on."""
        if self._server is not None:
            self._server.close()
            self._server.join()
            self._server = None

    def restart(self) -> None:
        """A cold start: samples count from 0 again."""
        self._header["written"] = 0
        self._header["started"] += 1

    def peek(self, offset: int, size: int) -> bytes:
        """The ring's memory, without a network."""
        return bytes(self._ring[offset : offset + size])

    def set_back(self, *, at: int, by_ns: int) -> None:
        """Sets the clock back from sample `at` of the ring on."""
        self._slots["time"][at:] -= np.uint64(by_ns)

    def set_clock(self, to_ns: int) -> None:
        """Gives every sample in the ring the same stamp."""
        self._slots["time"] = to_ns

    def poke(self, **header: int) -> None:
        """Changes the header."""
        for name, value in header.items():
            self._header[name] = value

    def _cycle(self) -> None:
        """Writes all samples that are due, one a millisecond; a late cycle writes several."""
        begin = time.monotonic_ns()
        while not self._stop.wait(0.001):
            due = (time.monotonic_ns() - begin) // self.period_ns
            self.write(due - self.written)

    def write(self, count: int) -> None:
        """The next samples, each into its slot and only then counted."""
        first = self.written
        samples = plc_samples(first, count, self.period_ns)
        if self._counters is not None:
            rows = np.arange(first, first + count) % len(self._counters)
            samples["counter"] = self._counters[rows]
            samples["status"] = 0
        for sample in samples:
            self._slots[self.written % self.capacity] = sample
            self._header["written"] += 1
