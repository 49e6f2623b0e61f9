"""One live recording: a thread for each source, begun and ended together, and what they came to."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from acquisition.live.folder import RecordingFolder
from acquisition.live.progress import Progress
from acquisition.live.recorder import POLL, Recorder
from acquisition.live.source import Batch, Source

CLOSING = 5.0  # [s] for a source to end; a device that hangs loses nothing that was polled


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
        """What the recording still needs before it can be read, as phrases."""
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
    """What a reader of the recording should know of a source, as sentences."""
    sentences = [
        f"{progress.name}: segment {i} ended: {event}."
        for i, event in enumerate(progress.events, start=1)
    ]
    if progress.lost:
        sentences.append(
            f"{progress.name}: {progress.lost} records were lost before the recorder got them."
        )
    if progress.refused:
        sentences.append(
            f"{progress.name}: {progress.refused} datagrams were not of this robot and were left "
            "out."
        )
    return [*sentences, *(f"{progress.name}: {warning}." for warning in progress.warnings)]
