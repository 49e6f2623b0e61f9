"""Devices of a live recording: what they deliver, whole records of a log, and the count of it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.stamps.order import GAP
from ballbar.cell.arrays import Array
from ballbar.cell.logs import SourceName


class DeviceSilentError(Exception):
    """The device does not answer, or no longer; the recorder waits for it to come back.

    The text says why.
    """


@dataclass(frozen=True, eq=False)
class Batch:
    """Records that a device delivered since the last poll."""

    records: list[bytes]  # lines or frames of the file, each complete
    t_ns: NDArray[np.int64]  # (N,) [ns] the device's stamps of the records
    # (N, K) to be shown, in the unit of the source; encoder angles are unwrapped from 0
    values: Array
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
    entry: Mapping[str, object]  # of recording.yaml, but for the files: dialect, unit, ..
    file_suffix: str  # with the dot
    encoders: Encoders  # for recording.yaml, known once connected; empty for a robot
    quiet: str  # what to say of a device that is there and delivers nothing
    channels: tuple[str, ...]  # names of the columns of Batch.values
    unit: str  # of these values

    def file_start(self) -> bytes:
        """Bytes before the records in each file."""

    def connect(self) -> None:
        """Raises DeviceSilentError when the device does not answer."""

    def poll(self) -> Batch:
        """Returns at once. Raises DeviceSilentError when the device has gone."""

    def disconnect(self) -> None:
        """Lets go of the device. Never raises."""


_RATE_POLLS = 20  # polls over which the rate is taken: two seconds


class RecorderState(Enum):
    """Where a recorder stands; the value is what the terminal shows."""

    WAIT = "waiting"
    OPEN = "opening"
    RECORD = "recording"
    FLUSH = "writing"
    CLOSE = "closing"
    END = "ended"


@dataclass(frozen=True, eq=False)
class Progress:
    """Counts and latest values of a recorder."""

    name: SourceName
    state: RecorderState = RecorderState.WAIT
    reason: str = ""  # why it waits
    segments: int = 0
    records: int = 0
    lost: int = 0  # made by the device and never delivered
    gaps: int = 0  # steps of the stamps beyond three periods
    refused: int = 0  # datagrams that are no message of the device
    rate: float = 0.0  # [Hz] by the device's stamps, over the last two seconds
    heard: float = 0.0  # time.monotonic() when the last records came
    channels: tuple[str, ...] = ()
    unit: str = "deg"  # of `latest`
    latest: NDArray[np.float64] | None = None  # (K,)
    status: NDArray[np.int64] | None = None  # (K,) of the last poll that brought any
    ever: NDArray[np.int64] | None = None  # (K,) or-ed over all polls
    events: tuple[str, ...] = ()  # what ended the segments
    warnings: tuple[str, ...] = ()  # what else went wrong


class Tally:
    """Counts the batches of one source into a Progress; others may read `progress` at any time."""

    def __init__(self, name: SourceName) -> None:
        self.progress = Progress(name)
        self.new_segment()

    def new_segment(self) -> None:
        """Neither gaps nor the rate reach over the end of a segment."""
        self._period = self._last_stamp = 0
        # Last stamp [ns] and number of records so far.
        self._recent: deque[tuple[int, int]] = deque(maxlen=_RATE_POLLS)

    def show(self, **changes: Any) -> None:
        """Replaces fields of the progress."""
        self.progress = replace(self.progress, **changes)

    def note(self, event: str) -> None:
        """Adds why a segment ended."""
        self.show(events=(*self.progress.events, event))

    def warn(self, warning: str) -> None:
        """Adds what went wrong without harm to the records."""
        self.show(warnings=(*self.progress.warnings, warning))

    def count(self, batch: Batch) -> None:
        """Adds a batch."""
        before, rate = self.progress, 0.0
        records = before.records + len(batch.records)
        if batch.t_ns.size:
            self._recent.append((int(batch.t_ns[-1]), records))
        if len(self._recent) > 1 and self._recent[-1][0] > self._recent[0][0]:
            (first, earlier), (last, latest) = self._recent[0], self._recent[-1]
            rate = (latest - earlier) / ((last - first) * 1e-9)
        ever = before.ever
        ever = batch.status if ever is None or not ever.size else batch.status | ever
        self.show(
            records=records,
            lost=before.lost + batch.lost,
            refused=before.refused + batch.refused,
            gaps=before.gaps + self._gaps(batch.t_ns),
            rate=rate,
            heard=time.monotonic() if batch.records else before.heard,
            latest=batch.values[-1] if len(batch.values) else before.latest,
            status=batch.status if batch.records else before.status,
            ever=ever,
        )

    def _gaps(self, stamps: NDArray[np.int64]) -> int:
        """Steps of stamps (N,) [ns] of more than three periods within the segment.

        The period is the median of the first batch that has steps.
        """
        if not stamps.size:
            return 0
        steps = np.diff(stamps, prepend=self._last_stamp) if self._last_stamp else np.diff(stamps)
        self._last_stamp = int(stamps[-1])
        if not self._period and steps.size:
            self._period = int(np.median(steps))
        return int((steps > GAP * self._period).sum()) if self._period else 0
