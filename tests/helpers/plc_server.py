"""A PLC on loopback whose sample n follows from n alone.

So a recording can be compared with the PLC byte by byte.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.plc_ring import SAMPLE
from ballbar.sim.live.plc import CAPACITY, STARTED
from ballbar.sim.live.plc import Plc as SimulatedPlc

JOINTS = (1, 2, 4, 5)


def plc_samples(first: int, count: int, period_ns: int) -> NDArray[np.void]:
    """Samples `first` .. of a PLC.

    Counters wrap and run both ways; status words have a toggle bit and rare faults.
    """
    n = np.arange(first, first + count, dtype=np.int64)
    samples = np.zeros(count, dtype=SAMPLE)
    samples["sequence"] = n + 1
    samples["time"] = STARTED + n * period_ns
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


def numbers_of(raw: bytes, plc: Plc) -> tuple[int, int]:
    """First and last sample of a file, which is what the PLC made in between, byte by byte."""
    first, last = (
        (int(line.split(b";")[0]) - STARTED) // plc.period_ns
        for line in (raw.splitlines()[1], raw.splitlines()[-1])
    )
    assert raw == text_of(plc_samples(first, last - first + 1, plc.period_ns))
    return first, last


@dataclass(frozen=True)
class Numbered:
    """Samples that follow from their numbers, one a period."""

    period_ns: int

    def due(self, elapsed_ns: int) -> int:
        return elapsed_ns // self.period_ns

    def samples(self, first: int, count: int) -> NDArray[np.void]:
        return plc_samples(first, count, self.period_ns)


class Plc(SimulatedPlc):
    """Numbered samples at a rate [Hz], and hands on the ring's memory."""

    def __init__(self, address: str, rate: float, *, capacity: int = CAPACITY) -> None:
        self.period_ns = round(1e9 / rate)
        super().__init__(address, Numbered(self.period_ns), joints=JOINTS, capacity=capacity)

    def __enter__(self) -> Plc:
        super().__enter__()
        self.start()
        return self

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
