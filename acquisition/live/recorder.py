"""Recorders of sources: the state machine of thesis sec. 4.6, without its 5 ms of waiting.

    WAIT    until the device delivers                      -> OPEN
    OPEN    a new device file, a segment of the recording  -> FLUSH
    RECORD  one poll of the device                         -> FLUSH, or CLOSE when it falls silent
    FLUSH   the records to disk, and a pause until the     -> RECORD, or CLOSE when stopped
            next poll
    CLOSE   the file                                       -> WAIT for the device, or the end

The thesis's program sampled in RECORD, waited for a file, and lost a cycle when the file was slow
(its overruns). Now the PLC samples into a ring; a slow disk delays the next poll, and nothing is
lost before the ring has gone round.

A live recording has a recorder in a thread for each source; they begin and end together.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

from ballbar.acquisition.live.folder import RecordingFolder, SegmentFile
from ballbar.acquisition.live.source import (
    Batch,
    DeviceSilentError,
    Progress,
    RecorderState,
    Source,
    Tally,
)
from ballbar.cell.errors import FailureError

POLL = 0.1  # [s] between polls: what a crash loses, and half of what may be lost
RETRY = 0.5  # [s] between attempts to reach a silent device
CLOSING = 5.0  # [s] for a source to end; a device that hangs loses nothing that was polled


class RecorderError(FailureError):
    """The recording could not be continued; what was written before is whole."""


class Recorder:
    """Records one source until `stop` is set.

    on_batch : called with each batch once it is on disk.
    """

    def __init__(
        self,
        source: Source,
        folder: RecordingFolder,
        stop: threading.Event,
        *,
        on_batch: Callable[[Source, Batch], None] | None = None,
    ) -> None:
        self.failure: Exception | None = None
        self._source, self._folder, self._stop, self._on_batch = source, folder, stop, on_batch
        self._batch: Batch | None = None
        self._file: SegmentFile | None = None
        self._declared = False
        self._tally = Tally(source.name)

    @property
    def progress(self) -> Progress:
        """The progress so far; may be read from any thread."""
        return self._tally.progress

    def run(self) -> None:
        """The state machine, until the end.

        An error is stored in `failure`, and stops the other recorders too.
        """
        step = {
            RecorderState.WAIT: self._wait,
            RecorderState.OPEN: self._open,
            RecorderState.RECORD: self._record,
            RecorderState.FLUSH: self._flush,
            RecorderState.CLOSE: self._close,
        }
        state = RecorderState.WAIT
        try:
            while state is not RecorderState.END:
                self._tally.show(state=state)
                state = step[state]()
        except OSError as error:
            self.failure = self._broken(error)
        # Whatever it is: the files are closed, and the main thread raises it.
        except Exception as error:
            self.failure = error
        finally:
            try:
                self._close_file()  # on the regular way it is closed
            except OSError as error:
                self.failure = self.failure or self._broken(error)
            if self.failure is not None:
                self._stop.set()
                self._source.disconnect()
            self._tally.show(state=RecorderState.END)

    def _wait(self) -> RecorderState:
        """Waits until there are records, or the recorder is stopped."""
        while not self._stop.is_set():
            try:
                self._source.connect()
                while not self._stop.is_set():
                    self._batch = self._source.poll()
                    if self._batch.records:
                        self._tally.show(reason="")
                        return RecorderState.OPEN
                    self._tally.count(self._batch)
                    self._tally.show(reason=self._source.quiet)
                    self._stop.wait(POLL)
            except DeviceSilentError as error:
                self._source.disconnect()
                self._tally.show(reason=str(error))
                self._stop.wait(RETRY)
        self._source.disconnect()
        return RecorderState.END

    def _open(self) -> RecorderState:
        path = self._folder.next_file(self._source.name, self._source.file_suffix)
        self._file, self._declared = SegmentFile(path, self._source.file_start()), False
        self._tally.new_segment()
        named = {"channels": self._source.channels, "unit": self._source.unit}
        self._tally.show(segments=self.progress.segments + 1, **named)
        return RecorderState.FLUSH

    def _record(self) -> RecorderState:
        try:
            self._batch = self._source.poll()
        except DeviceSilentError as error:
            self._tally.note(str(error))
            return RecorderState.CLOSE
        return RecorderState.FLUSH

    def _show(self, batch: Batch) -> None:
        """Hands a batch to the live view, which must not end the recording."""
        if self._on_batch is None or not batch.records:
            return
        try:
            self._on_batch(self._source, batch)
        except Exception as error:
            self._on_batch = None
            self._tally.warn(f"the live view ended: {error}")

    def _flush(self) -> RecorderState:
        batch, file = self._batch, self._file
        if batch is None or file is None:
            raise RuntimeError("FLUSH follows OPEN and a poll")
        stopping, polled = self._stop.is_set(), time.monotonic()
        if batch.records:
            if self._folder.is_new:
                self._declare(file)
            file.append(batch.records)
            self._declare(file)
        self._tally.count(batch)
        self._show(batch)
        if batch.ends:
            self._tally.note(batch.ends)
        if batch.ends or stopping:
            return RecorderState.CLOSE
        self._stop.wait(max(0.0, polled + POLL - time.monotonic()))
        return RecorderState.RECORD  # also when stopped meanwhile: one last poll

    def _close(self) -> RecorderState:
        self._close_file()
        if self._stop.is_set():
            self._source.disconnect()
            return RecorderState.END
        return RecorderState.WAIT

    def _declare(self, file: SegmentFile) -> None:
        if not self._declared:
            self._folder.declare(self._source, file.path)
            self._declared = True

    def _close_file(self) -> None:
        if self._file is not None:
            file, self._file = self._file, None
            file.close()
            if not file.records:
                self._folder.withdraw(self._source, file.path)

    def _broken(self, error: OSError) -> RecorderError:
        where = self._file.path if self._file is not None else self._folder.path
        readable = ""
        if self._file is not None:
            readable = f"{self._file.records} whole records are in it and can be read. "
        reason = error.strerror or error
        remedy = "Make room or record to another disk."
        return RecorderError(f"{where}: cannot be written: {reason}. {readable}{remedy}")


class LiveRecording:
    """Recorders of several sources into one folder."""

    def __init__(
        self,
        folder: RecordingFolder,
        sources: Sequence[Source],
        *,
        on_batch: Callable[[Source, Batch], None] | None = None,
    ) -> None:
        self._folder = folder
        self._stop = threading.Event()
        self._recorders = [
            Recorder(source, folder, self._stop, on_batch=on_batch) for source in sources
        ]
        # Daemons: a PLC that hangs in a call must not keep the program from ending.
        self._threads = [
            threading.Thread(target=recorder.run, name=recorder.progress.name, daemon=True)
            for recorder in self._recorders
        ]

    def start(self) -> None:
        """Starts the recorders and returns at once."""
        for thread in self._threads:
            thread.start()

    @property
    def progress(self) -> list[Progress]:
        """The progress of each source, in their order."""
        return [recorder.progress for recorder in self._recorders]

    @property
    def missing(self) -> tuple[str, ...]:
        """Phrases for everything that the recording still needs before it can be read."""
        return self._folder.missing

    def wait(self, seconds: float = POLL) -> bool:
        """Whether it was stopped, or a source failed, within `seconds`."""
        return self._stop.wait(seconds)

    def stop(self) -> None:
        """Requests the end; may be called from a signal handler."""
        self._stop.set()

    def finish(self) -> None:
        """Stops, waits until the files are closed, and enters into recording.yaml what happened.

        Raises RecorderError, or what else ended a recorder; OSError if recording.yaml cannot be
        written.
        """
        self._stop.set()
        for thread in self._threads:
            thread.join(CLOSING)
        for recorder in self._recorders:
            if recorder.failure is not None:
                raise recorder.failure
        self._folder.finish(
            " ".join(sentence for progress in self.progress for sentence in notes(progress))
        )


def notes(progress: Progress) -> list[str]:
    """Sentences about a source that a reader of the recording should know."""
    sentences = [
        f"{progress.name}: segment {i} ended: {event}."
        for i, event in enumerate(progress.events, start=1)
    ]
    if progress.lost:
        sentences.append(f"{progress.name}: {progress.lost} records were lost before they came.")
    if progress.refused:
        sentences.append(
            f"{progress.name}: {progress.refused} datagrams were not of this robot and were left "
            "out."
        )
    return [*sentences, *(f"{progress.name}: {warning}." for warning in progress.warnings)]
