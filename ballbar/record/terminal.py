"""Output of `ballbar record`: a table of the sources while it runs, then what was recorded."""

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

from ballbar.acquisition.faults.encoders import FAULTS, SYNC_ERROR
from ballbar.acquisition.live.recorder import LiveRecording, notes
from ballbar.acquisition.live.source import Progress, RecorderState
from ballbar.watch.beside import WatchBeside
from ballbar.watch.show import line, panel

_REFRESH = 0.25  # [s] between two updates of the table
_SILENT = 1.0  # [s] without a record, after which a device counts as silent
_WORDS = {**{bit: kind for bit, (_, kind, _) in FAULTS.items()}, SYNC_ERROR: "sync error"}


def status_words(word: int) -> str:
    """Faults in an EL5021 status word, separated by commas; `ok` without any."""
    return ", ".join(kind for bit, kind in _WORDS.items() if word & bit) or "ok"


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Discards what native libraries write to standard error; what Python writes still goes there.

    The ADS library reports there each failed attempt to connect and each end of a connection, which
    would break a table, and be no word of the command's in a pipe.
    """
    ours = sys.stderr
    ours.flush()
    original = os.dup(2)
    with os.fdopen(original, "w", 1, ours.encoding, ours.errors) as stderr:
        try:
            with Path(os.devnull).open("wb") as null:
                os.dup2(null.fileno(), 2)
            if ours is sys.__stderr__:
                sys.stderr = stderr
            yield
        finally:
            sys.stderr = ours
            stderr.flush()
            os.dup2(original, 2)


def show_until_stopped(
    console: Console,
    recording: LiveRecording,
    beside: WatchBeside | None = None,
    *,
    duration: float | None,
) -> None:
    """Shows the recording until it stops, or until `duration` [s] after the first records.

    On a terminal a table is shown, elsewhere a line for each event. beside : identifies meanwhile.
    """
    begun, lines = None, _Lines(console)
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
                parts = [status_table(progress, elapsed)]
                if beside is not None and beside.failure:
                    parts.append(Text(f"identification ended: {beside.failure}", style="red"))
                elif beside is not None and beside.latest is not None:
                    parts += [Text(), panel(beside.latest)]
                live.update(Group(*parts), refresh=True)
            else:
                lines.print_changes(progress)
                if beside is not None:
                    lines.print_update(beside)
            if duration is not None and elapsed >= duration:
                return


def say_recording(console: Console, progress: list[Progress]) -> None:
    """Prints what was recorded of each source, its faults and remarks."""
    for source in progress:
        files = f"{source.segments} file{'' if source.segments == 1 else 's'}"
        gaps = f"{source.gaps} gap{'' if source.gaps == 1 else 's'}"
        console.print(
            f"{source.name}: {source.records} records in {files}, {source.lost} lost, {gaps}"
        )
        for name, word in _named(source, ever=True):
            if word & sum(_WORDS):
                console.print(f"  [yellow]encoder {name}:[/] {status_words(word)}")
        for sentence in notes(source):
            console.print(f"  [yellow]{escape(sentence)}[/]")


def status_table(progress: list[Progress], elapsed: float) -> RenderableType:
    """Table of the sources, with the latest angles and status words below it."""
    title = f"{elapsed:.0f} s  (Ctrl-C ends the recording)"
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
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
        for detail in _details(source):
            details.add_row(detail)
    return Group(table, details)


def _state(source: Progress) -> tuple[Text, bool]:
    """State of a source as text, and whether it delivers records."""
    if source.state not in (RecorderState.RECORD, RecorderState.FLUSH):
        return Text(source.state.value, style="yellow"), False
    silent = time.monotonic() - source.heard
    if silent > _SILENT:
        return Text(f"silent for {silent:.0f} s", style="red"), False
    return Text("recording", style="green"), True


def _details(source: Progress) -> list[Text]:
    """Latest angles of a source and the faults of its encoders, or why it waits."""
    if source.state is RecorderState.WAIT and source.reason:
        return [Text(f"{source.name}: {source.reason}", style="yellow")]
    if source.latest is None:
        return []
    angles = dict(zip(source.channels, source.latest, strict=False))
    words, ever = dict(_named(source, ever=False)), dict(_named(source, ever=True))
    if not words:
        shown = "  ".join(f"{name} {value:+.3f}" for name, value in angles.items())
        return [Text(f"{source.unit}: {shown}")]
    lines = []
    for name, angle in angles.items():
        latest, earlier = status_words(words[name]), status_words(ever[name])
        line = Text(f"{name} {angle:+9.3f} deg  ")
        line.append(latest, style="green" if latest == "ok" else "red")
        if earlier != latest:
            line.append(f"  (was: {earlier})", style="yellow")
        lines.append(line)
    return lines


def _named(source: Progress, *, ever: bool) -> list[tuple[str, int]]:
    """(channel, status word) of a source: the latest words, or the faults since the start."""
    words = source.ever if ever else source.status
    if words is None:
        return []
    return [(name, int(word)) for name, word in zip(source.channels, words, strict=False)]


class _Lines:
    """A line for each change of a source, for a pipe or a log file."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._printed: dict[str, str] = {}
        self._updates, self._failure = 0, ""

    def print_changes(self, progress: list[Progress]) -> None:
        """Prints the sources whose state, file or reason has changed."""
        for source in progress:
            waits = source.state is RecorderState.WAIT
            text = source.reason or "waiting" if waits else f"recording to file {source.segments}"
            if source.events and waits:
                text = f"{source.events[-1]}; {text}"
            if self._printed.get(source.name) != text:
                self._printed[source.name] = text
                self._console.print(f"{source.name}: {escape(text)}")

    def print_update(self, beside: WatchBeside) -> None:
        """Prints what was identified since the last call."""
        if beside.latest is not None and beside.updates != self._updates:
            self._updates = beside.updates
            self._console.print(escape(line(beside.latest)))
        if beside.failure != self._failure:
            self._failure = beside.failure
            self._console.print(f"[red]identification ended: {escape(self._failure)}[/]")
