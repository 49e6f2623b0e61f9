"""The protocol of a device: it delivers whole records of its log as they become available."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.logs import SourceName


class DeviceSilentError(Exception):
    """The device does not answer, or no longer; the recorder waits for it to come back.

    The text says why.
    """


@dataclass(frozen=True, eq=False)
class Batch:
    """Records that a device delivered since the last poll."""

    records: list[bytes]  # lines or frames of the file, each complete
    t_ns: NDArray[np.int64]  # (N,) [ns] the device's stamps of the records
    values: Array  # (N, K) [deg] to be shown: encoder angles unwrapped from 0, or joint angles
    # (K,) status words of the encoders, or-ed over the records; empty for a robot
    status: NDArray[np.int64]
    lost: int = 0  # records that the device made and that cannot be had any more
    refused: int = 0  # datagrams that are no message of this device
    ends: str = ""  # why the segment ends after these records; what follows goes into a new file


@dataclass(frozen=True)
class Encoders:
    """Which ball-bar encoders the device reads."""

    joints: tuple[int, ...] = ()  # of 1..5, increasing
    bits: int = 0  # of interpolation, EL5021 object 8001:11


class Source(Protocol):
    """A device. `connect` may be called again after each DeviceSilentError."""

    name: SourceName  # source of the recording that the device is
    dialect: str  # name of the dialect of its files
    file_suffix: str  # with the dot
    encoders: Encoders  # for recording.yaml, known once connected; empty for a robot
    quiet: str  # what to say of a device that is there and delivers nothing
    channels: tuple[str, ...]  # names of the columns of Batch.values

    def file_start(self) -> bytes:
        """Bytes before the records in each file."""

    def connect(self) -> None:
        """Raises DeviceSilentError when the device does not answer."""

    def poll(self) -> Batch:
        """Returns at once. Raises DeviceSilentError when the device has gone."""

    def disconnect(self) -> None:
        """Lets go of the device. Never raises."""
