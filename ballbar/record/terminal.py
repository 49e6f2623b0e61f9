"""What `ballbar record` shows: a table of the sources while it runs, then what the recording came to."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from acquisition.faults.encoders import FAULTS, SYNC_ERROR
from acquisition.live.progress import Progress, State
from acquisition.live.session import LiveRecording, notes

_REFRESH = 0.25  # [s]
_SILENT = 1.0  # [s] without a record from a device that is recorded
_WORDS = {**{bit: kind for bit, (_, kind, _) in FAULTS.items()}, SYNC_ERROR: "sync error"}


def status_words(word: int) -> str:
    """What an EL5021 status word complains of; `ok` if of nothing."""
    return ", ".join(kind for bit, kind in _WORDS.items() if word & bit) or "ok"


@contextmanager
def quiet_libraries(console: Console) -> Iterator[None]:
    """Keeps what native libraries write to standard error from running through a table on a terminal.

    The ADS library reports each attempt to connect there, whatever its caller does about it.
    """
    if not console.is_terminal:
        yield
        return
    sys.stderr.flush()
    spoken = os.dup(2)
    try:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(spoken, 2)
        os.close(spoken)


def show_until_stopped(
    console: Console, recording: LiveRecording, *, duration: float | None
) -> None:
    """Shows the recording until it stops, or `duration` [s] after the first records.

    A table on a terminal; elsewhere a line for each thing that happens.
    """
    begun, shown = None, _Lines(console)
    with (
        Live(console=console, auto_refresh=False, transient=True)
        if console.is_terminal
        else nullcontext() as live
    ):
        while not recording.wait(_REFRESH):
            progress = recording.progress
            if begun is None and any(source.records for source in progress):
                begun = time.monotonic()
            elapsed = 0.0 if begun is None else time.monotonic() - begun
            if live is not None:
                live.update(status_table(progress, elapsed), refresh=True)
            else:
                shown.news(progress)
            if duration is not None and elapsed >= duration:
                return


def say_recording(console: Console, progress: list[Progress]) -> None:
    """What was recorded, and what a reader should know of it."""
    for source in progress:
        files = f"{source.segments} file{'' if source.segments == 1 else 's'}"
        console.print(
            f"{source.name}: {source.records} records in {files}, {source.lost} lost, {source.gaps} gap{'' if source.gaps == 1 else 's'}"
        )
        for name, word in _named(source, ever=True):
            if word & sum(_WORDS):
                console.print(f"  [yellow]encoder {name}:[/] {status_words(word)}")
        for sentence in notes(source):
            console.print(f"  [yellow]{escape(sentence)}[/]")


def status_table(progress: list[Progress], elapsed: float) -> RenderableType:
    """The sources, and the angles and status of what they read."""
    table = Table(
        title=f"{elapsed:.0f} s  (Ctrl-C ends the recording)",
        title_justify="left",
        box=None,
        pad_edge=False,
    )
    for name in ("source", "state", "file", "records", "rate", "lost", "gaps"):
        table.add_column(name, justify="left" if name in ("source", "state", "file") else "right")
    for source in progress:
        state, delivers = _state(source)
        table.add_row(
            source.name,
            state,
            str(source.segments or ""),
            str(source.records),
            f"{source.rate:.1f} Hz" if delivers else "",
            Text(str(source.lost), style="red" if source.lost else ""),
            str(source.gaps),
        )
    details = Table.grid()
    for source in progress:
        for line in _details(source):
            details.add_row(line)
    return Group(table, details)


def _state(source: Progress) -> tuple[Text, bool]:
    """What a source does, and whether its records come."""
    if source.state not in (State.RECORD, State.FLUSH):
        return Text(source.state.value, style="yellow"), False
    silent = time.monotonic() - source.heard
    if silent > _SILENT:
        return Text(f"silent for {silent:.0f} s", style="red"), False
    return Text("recording", style="green"), True


def _details(source: Progress) -> list[Text]:
    if source.state is State.WAIT and source.reason:
        return [Text(f"{source.name}: {source.reason}", style="yellow")]
    if source.latest is None:
        return []
    angles = dict(zip(source.channels, source.latest, strict=False))
    words, ever = dict(_named(source, ever=False)), dict(_named(source, ever=True))
    if not words:
        return [Text("deg: " + "  ".join(f"{name} {angle:+.3f}" for name, angle in angles.items()))]
    lines = []
    for name, angle in angles.items():
        now, before = status_words(words[name]), status_words(ever[name])
        line = Text(f"{name} {angle:+9.3f} deg  ").append(
            now, style="green" if now == "ok" else "red"
        )
        lines.append(line if before == now else line.append(f"  (was: {before})", style="yellow"))
    return lines


def _named(source: Progress, *, ever: bool) -> list[tuple[str, int]]:
    words = source.ever if ever else source.status
    return (
        []
        if words is None
        else [(name, int(word)) for name, word in zip(source.channels, words, strict=False)]
    )


class _Lines:
    """What changed since the last time, for a pipe or a log file."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._said: dict[str, str] = {}

    def news(self, progress: list[Progress]) -> None:
        """Prints the sources whose state, file or reason is another."""
        for source in progress:
            waits = source.state is State.WAIT
            text = source.reason or "waiting" if waits else f"recording to file {source.segments}"
            if source.events and waits:
                text = f"{source.events[-1]}; {text}"
            if self._said.get(source.name) != text:
                self._said[source.name] = text
                self._console.print(f"{source.name}: {escape(text)}")
