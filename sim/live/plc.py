"""A PLC on this machine: docs/plc/ball_bar.st behind the ADS test server of pyads.

The server answers reads by byte offset, as TwinCAT does. Samples come from a program, which says
how many there are by an instant and what is in them.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray
from pyads.constants import ADST_VOID
from pyads.testserver import AdsTestServer, AdvancedHandler, PLCVariable

from ballbar.cell.arrays import Array
from ballbar.cell.plc_ring import HEADER, LAYOUT, RING, SAMPLE
from ballbar.sim.live.delivery import Device, Pace
from ballbar.sim.live.device_logs import WORD, TextLog

GROUP, OFFSET = 0x4040, 4096  # where TwinCAT keeps data of a PLC
STARTED = 848_000_000_000_000_000  # [ns] DC time of the first cycle, in November 2026
CAPACITY = 4096
BITS = 12  # of an EL5021's interpolation, as docs/plc/ball_bar.st has it
CYCLE = 1e-3  # [s]


class Program(Protocol):
    """The program that the PLC samples."""

    def due(self, elapsed_ns: int) -> int:
        """Samples made in the time since the program was started."""

    def samples(self, first: int, count: int) -> NDArray[np.void]:
        """(count,) SAMPLE from number `first` on."""


@dataclass(frozen=True, eq=False)
class LoggedSamples:
    """The rows of a log, each when its time has come."""

    rows: NDArray[np.void]  # (N,) SAMPLE
    times: Array  # (N,) [s] of the recording
    pace: Pace

    def due(self, elapsed_ns: int) -> int:
        del elapsed_ns  # the pace is common to all devices
        return int(np.searchsorted(self.times, self.pace.delivered, side="right"))

    def samples(self, first: int, count: int) -> NDArray[np.void]:
        return self.rows[first : first + count]


def logged_samples(log: TextLog, pace: Pace) -> tuple[LoggedSamples, tuple[int, ...]]:
    """The program that samples a ball-bar's log again, and the joints of its encoders.

    Counters come as the terminals count them, so the log's encoders must be declared with sign 1.
    """
    rows = np.zeros(len(log.cells), dtype=SAMPLE)
    rows["sequence"] = np.arange(1, len(rows) + 1)
    rows["time"] = log.cells[:, 0].astype(np.int64)
    joints = tuple(int(name[1:]) for name in log.scales)
    for j in joints:
        rows["counter"][:, j - 1] = log.cells[:, log.column(f"b{j}")].astype(np.int64) % WORD
        rows["status"][:, j - 1] = log.cells[:, log.column(f"s{j}")].astype(np.int64)
    return LoggedSamples(rows, log.t, pace), joints


class Plc(Device):
    """Samples of a program until the block ends, once the program is started.

    The server can be taken away and brought back.
    """

    def __init__(
        self, address: str, program: Program, *, joints: tuple[int, ...], capacity: int = CAPACITY
    ) -> None:
        """address : of this machine, for the server. joints : of the encoders, 1 to 5."""
        super().__init__(CYCLE)
        self.address, self.program, self.capacity = address, program, capacity
        self.net_id = f"{address}.1.1"
        self.header_reads: list[int] = []  # `written` whenever a recorder looked at it
        self._ring = bytearray(HEADER.itemsize + capacity * SAMPLE.itemsize)
        self._header = np.frombuffer(self._ring, dtype=HEADER, count=1)
        self._slots = np.frombuffer(self._ring, dtype=SAMPLE, offset=HEADER.itemsize)
        fitted = sum(1 << (j - 1) for j in joints)
        self._header[0] = (LAYOUT, capacity, fitted, BITS, STARTED, 0)
        self._began = 0  # [ns] when the program was started
        self._server: AdsTestServer | None = None

    @property
    def written(self) -> int:
        return int(self._header["written"][0])

    def __enter__(self) -> Self:
        self.connect()
        return self

    def start(self) -> None:
        """Starts the program."""
        self._began = time.monotonic_ns()
        super().start()

    def connect(self) -> None:
        """Starts the server."""
        memory = _Memory(self._ring, self.header_reads)
        self._server = AdsTestServer(memory, ip_address=self.address, logging=False)
        self._server.start()

    def disconnect(self) -> None:
        """Ends the connections and the server; the program goes on."""
        if self._server is not None:
            self._server.close()
            self._server.join()
            self._server = None

    def write(self, count: int) -> None:
        """The next samples, each into its slot and only then counted."""
        for sample in self.program.samples(self.written, count):
            self._slots[self.written % self.capacity] = sample
            self._header["written"] += 1

    def _cycle(self) -> bool:
        self.write(self.program.due(time.monotonic_ns() - self._began) - self.written)
        return False  # a PLC is never done

    def _close(self) -> None:
        self.disconnect()


class _Memory(AdvancedHandler):  # type: ignore[misc]  # pyads has no types
    """The data area of the PLC: reads may begin anywhere inside a variable, as on TwinCAT."""

    def __init__(self, ring: bytearray, header_reads: list[int]) -> None:
        super().__init__()
        self.ring, self.header_reads = ring, header_reads
        self.add_variable(
            PLCVariable(RING, bytes(len(ring)), ADST_VOID, "ST_BallBarRing", GROUP, OFFSET)
        )

    def get_variable_by_indices(self, index_group: int, index_offset: int) -> PLCVariable:
        if index_offset == OFFSET:
            header = np.frombuffer(self.ring, dtype=HEADER, count=1)
            self.header_reads.append(int(header["written"][0]))
        variable = super().get_variable_by_indices(index_group, OFFSET)
        variable.value = memoryview(self.ring)[index_offset - OFFSET :]
        return variable


def loopback_address() -> str:
    """An address of this machine that no other process is likely to use: the port of ADS is fixed.

    macOS has only the first one.
    """
    if sys.platform == "darwin":
        return "127.0.0.1"
    pid = os.getpid()
    return f"127.{1 + pid // 62500 % 250}.{1 + pid // 250 % 250}.{1 + pid % 250}"
