"""A structure in the memory of a TwinCAT PLC, read by byte offset over ADS.

One read of a symbol tells where it lies; all others are plain reads of that memory, which cost the
PLC next to nothing.
"""

from __future__ import annotations

import ctypes

import pyads
from pyads.constants import ADSIGRP_SYM_INFOBYNAMEEX
from pyads.structs import SAdsSymbolEntry

from ballbar.acquisition.live.source import DeviceSilentError

# Beyond it the connection counts as lost; a healthy PLC answers within a few cycles.
TIMEOUT_MS = 1000
# What the common error codes of ADS mean for someone who stands at the machine.
_MEANING = {
    -1: "the connection was closed. Check the cable and TwinCAT",
    6: "nothing answers at that address. Is TwinCAT running, and this PC entered under its routes?",
    7: "not found. Is its net id right, and this PC entered under its routes?",
    1808: "it has no such variable. Is docs/plc/ball_bar.st loaded?",
    1861: f"no answer within {TIMEOUT_MS / 1000:g} s. Is the PLC on, and its cable plugged in?",
}


class AdsMemory:
    """The variable `symbol` of the PLC at an AMS address.

    net_id, port : such as 5.12.82.20.1.1 and 851.
    host : IP address of the PLC; default the first four numbers of the net id.
    """

    def __init__(self, net_id: str, port: int, *, symbol: str, host: str | None = None) -> None:
        self._symbol = symbol
        self._address = f"{net_id}:{port}"
        self._connection = pyads.Connection(net_id, port, host)
        self._group = self._offset = 0

    def open(self) -> None:
        """Connects, and finds the variable.

        Raises DeviceSilentError when no PLC answers or it has no such variable.
        """
        try:
            self._connection.open()
            self._connection.set_timeout(TIMEOUT_MS)
            # Not `get_symbol`, which also decodes the comment: one in UTF-8 may be no Windows text.
            entry = self._connection.read_write(
                ADSIGRP_SYM_INFOBYNAMEEX,
                0,
                SAdsSymbolEntry,
                self._symbol,
                pyads.PLCTYPE_STRING,
                return_ctypes=True,
            )
            self._group, self._offset = entry.iGroup, entry.iOffs
        except (pyads.ADSError, RuntimeError) as error:
            self.close()
            what = f"PLC {self._address}, {self._symbol}: {_words(error)}"
            raise DeviceSilentError(what) from None

    def read(self, offset: int, size: int) -> bytes:
        """Bytes of the variable.

        Raises DeviceSilentError when the PLC no longer answers.
        """
        try:
            raw = self._connection.read(
                self._group, self._offset + offset, ctypes.c_ubyte * size, return_ctypes=True
            )
        except (pyads.ADSError, RuntimeError) as error:
            raise DeviceSilentError(f"PLC {self._address}: {_words(error)}") from None
        if raw is None:
            raise DeviceSilentError(f"PLC {self._address}: not connected. Check power and cable")
        return bytes(raw)

    def close(self) -> None:
        """Ends the connection."""
        try:
            self._connection.close()
        except (pyads.ADSError, RuntimeError):
            return  # it was dead already


def _words(error: Exception) -> str:
    return (
        _MEANING.get(getattr(error, "err_code", 0))
        or str(error).removeprefix("ADSError: ").strip(" .")
        or "no answer"
    )
