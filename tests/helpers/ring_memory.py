"""The PLC's ring without a network, read while the PLC writes on, or does not answer."""

from __future__ import annotations

from collections.abc import Callable

from ballbar.acquisition.live.source import DeviceSilentError
from tests.helpers.plc_server import Plc


class RingMemory:
    """`meanwhile` says how many samples the PLC makes before each read; `cut` is a pulled cable."""

    def __init__(self, plc: Plc) -> None:
        self.plc = plc
        self.meanwhile: Callable[[], int] = lambda: 0
        self.cut = False

    def open(self) -> None:
        """Always there, unless cut."""

    def read(self, offset: int, size: int) -> bytes:
        if self.cut:
            raise DeviceSilentError("cable pulled")
        self.plc.write(self.meanwhile())
        return self.plc.peek(offset, size)

    def close(self) -> None:
        """Nothing is held."""
