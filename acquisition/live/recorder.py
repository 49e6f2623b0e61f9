"""The recorder of one source: the state machine of thesis sec. 4.6, without its 5 ms of waiting for a file.

    WAIT    until the device delivers                        -> OPEN
    OPEN    a new device file, a segment of the recording    -> FLUSH
    RECORD  one poll of the device                           -> FLUSH, or CLOSE when it falls silent
    FLUSH   the records to disk, then a pause until the next poll -> RECORD, or CLOSE when asked to stop
    CLOSE   the file                                         -> WAIT for the device to come back, or the end

The thesis's program sampled in RECORD and lost a cycle when the file was slow (its overruns). Here the PLC samples into a ring;
a slow disk delays the next poll, and nothing is lost before the ring has gone round.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from acquisition.dialect import SourceName
from acquisition.live.folder import RecordingFolder
from acquisition.live.segment_file import SegmentFile
from acquisition.live.source import Batch, DeviceSilentError, Source
from acquisition.stamps import GAP

POLL = 0.1  # [s] between polls: what a crash loses, and half of what may be lost
RETRY = 0.5  # [s] between attempts to reach a silent device
_RATE_POLLS = 20  # polls over which the rate is shown


class State(Enum):
    """Where a recorder stands; the value is what the terminal shows."""

    WAIT = "waiting"
    OPEN = "opening"
    RECORD = "recording"
    FLUSH = "writing"
    CLOSE = "closing"
    END = "ended"


@dataclass(frozen=True, eq=False)
class Progress:
    """What a recorder has done so far."""

    name: SourceName
    state: State = State.WAIT
    reason: str = ""  # why it waits
    segments: int = 0
    records: int = 0
    lost: int = 0  # made by the device and never delivered
    gaps: int = 0  # steps of the stamps beyond three periods
    refused: int = 0  # datagrams that are no message of the device
    rate: float = 0.0  # [Hz] by the device's stamps, over the last two seconds
    channels: tuple[str, ...] = ()
    latest: NDArray[np.float64] | None = None  # (K,) [deg]
    status: NDArray[np.int64] | None = None  # (K,) of the last poll that brought any
    ever: NDArray[np.int64] | None = None  # (K,) or-ed over all polls
    events: tuple[str, ...] = ()  # what ended the segments


class RecorderError(RuntimeError):
    """The recording could not be continued; what was written before is whole."""


class Recorder:
    """Records one source until `stop` is set. `watch` sees each batch once it is on disk."""

    def __init__(
        self, source: Source, folder: RecordingFolder, stop: threading.Event, *, watch: Callable[[Source, Batch], None] | None = None
    ) -> None:
        self.progress = Progress(source.name)
        self.failure: Exception | None = None
        self._source, self._folder, self._stop, self._watch = source, folder, stop, watch
        self._batch: Batch | None = None
        self._file: SegmentFile | None = None
        self._declared = False
        self._period = self._last_stamp = 0
        self._recent: deque[tuple[int, int]] = deque(maxlen=_RATE_POLLS)  # last stamp [ns], records so far

    def run(self) -> None:
        """The state machine, until the end. An error is kept in `failure`, and stops the other recorders too."""
        step = {
            State.WAIT: self._wait,
            State.OPEN: self._open,
            State.RECORD: self._record,
            State.FLUSH: self._flush,
            State.CLOSE: self._close,
        }
        state = State.WAIT
        try:
            while state is not State.END:
                self._show(state=state)
                state = step[state]()
        except OSError as error:
            self.failure = self._broken(error)
        except Exception as error:  # whatever it is: the files are closed, and the main thread raises it
            self.failure = error
        finally:
            self._give_up()
            self._show(state=State.END)

    def _wait(self) -> State:
        """Until there are records, or the stop."""
        while not self._stop.is_set():
            try:
                self._source.connect()
                while not self._stop.is_set():
                    self._batch = self._source.poll()
                    if self._batch.records:
                        self._show(reason="")
                        return State.OPEN
                    self._count(self._batch)
                    self._show(reason=self._source.quiet)
                    self._stop.wait(POLL)
            except DeviceSilentError as error:
                self._source.disconnect()
                self._show(reason=str(error))
                self._stop.wait(RETRY)
        self._source.disconnect()
        return State.END

    def _open(self) -> State:
        path = self._folder.next_file(self._source.name, self._source.file_suffix)
        self._file, self._declared = SegmentFile(path, self._source.file_start()), False
        self._period = self._last_stamp = 0
        self._recent.clear()
        self._show(segments=self.progress.segments + 1, channels=self._source.channels)
        return State.FLUSH

    def _record(self) -> State:
        try:
            self._batch = self._source.poll()
        except DeviceSilentError as error:
            self._note(str(error))
            return State.CLOSE
        return State.FLUSH

    def _flush(self) -> State:
        batch, file = self._batch, self._file
        assert batch is not None, "FLUSH follows a poll"
        assert file is not None, "FLUSH follows OPEN"
        stopping, polled = self._stop.is_set(), time.monotonic()
        if batch.records:
            file.append(batch.records)
            self._declare(file)
        self._count(batch)
        if self._watch is not None and batch.records:
            self._watch(self._source, batch)
        if batch.ends:
            self._note(batch.ends)
            return State.CLOSE
        if stopping:
            return State.CLOSE
        self._stop.wait(max(0.0, polled + POLL - time.monotonic()))
        return State.RECORD  # also when asked to stop: one last poll

    def _close(self) -> State:
        self._close_file()
        if self._stop.is_set():
            self._source.disconnect()
            return State.END
        return State.WAIT

    def _declare(self, file: SegmentFile) -> None:
        if not self._declared:
            self._folder.declare(self._source, file.path)
            self._declared = True

    def _count(self, batch: Batch) -> None:
        before = self.progress
        gaps = self._gaps(batch.t_ns)
        records = before.records + len(batch.records)
        if batch.t_ns.size:
            self._recent.append((int(batch.t_ns[-1]), records))
        ever = batch.status if before.ever is None or not before.ever.size else before.ever | batch.status
        self._show(
            records=records,
            lost=before.lost + batch.lost,
            refused=before.refused + batch.refused,
            gaps=before.gaps + gaps,
            rate=self._rate(),
            latest=batch.values[-1] if len(batch.values) else before.latest,
            status=batch.status if batch.records else before.status,
            ever=ever,
        )

    def _gaps(self, stamps: NDArray[np.int64]) -> int:
        """Steps of more than three periods within the segment; the period is the median of the first batch that has one."""
        if not stamps.size:
            return 0
        steps = np.diff(stamps, prepend=self._last_stamp) if self._last_stamp else np.diff(stamps)
        self._last_stamp = int(stamps[-1])
        if not self._period and steps.size:
            self._period = int(np.median(steps))
        return int((steps > GAP * self._period).sum()) if self._period else 0

    def _rate(self) -> float:
        if len(self._recent) < 2 or self._recent[-1][0] <= self._recent[0][0]:
            return 0.0
        (first, before), (last, now) = self._recent[0], self._recent[-1]
        return (now - before) / ((last - first) * 1e-9)

    def _note(self, event: str) -> None:
        self._show(events=(*self.progress.events, event))

    def _show(self, **changes: object) -> None:
        self.progress = replace(self.progress, **changes)  # type: ignore[arg-type]

    def _close_file(self) -> None:
        if self._file is not None:
            file, self._file = self._file, None
            file.close()

    def _give_up(self) -> None:
        """Closes what is open; on the regular way nothing is."""
        try:
            self._close_file()
        except OSError as error:
            self.failure = self.failure or self._broken(error)
        if self.failure is not None:
            self._stop.set()
            self._source.disconnect()

    def _broken(self, error: OSError) -> RecorderError:
        where = self._file.path if self._file is not None else self._folder.path
        kept = f"{self._file.records} whole records are in it and can be read. " if self._file is not None else ""
        return RecorderError(f"{where}: cannot be written: {error.strerror or error}. {kept}Make room or record to another disk.")
