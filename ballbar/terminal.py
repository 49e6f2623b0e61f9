"""Terminal of all commands: two consoles, the options --quiet and --verbose, a bar of progress.

Results go to standard output, everything else to standard error. Colours are for a terminal; in a
pipe there are none unless FORCE_COLOR is set, and NO_COLOR switches them off (both as rich reads
them). Bars and changing tables are for a terminal alone. The consoles show control characters of a
text as escapes, so that no name in a file clears the screen or changes the window's title.
"""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import Annotated

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.segment import Segment

from ballbar.cell.foreign_text import printable

FAULT = 3  # exit code after a fault of the program, or with too little memory
INTERRUPTED = 130  # exit code after Ctrl-C or SIGTERM, as shells have it of the former


class PlainConsole(Console):
    """A console whose texts cannot steer the terminal."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Segments of what is printed, control characters in them as escapes."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=printable(segment.text))


out = PlainConsole(highlight=False, soft_wrap=True, emoji=False)  # file.csv:100: is line 100
err = PlainConsole(stderr=True, highlight=False, soft_wrap=True, emoji=False)


@dataclass
class _Detail:
    """How much the running command prints."""

    quiet: bool = False
    verbose: bool = False


_detail = _Detail()


def say_interrupted() -> None:
    """Prints that Ctrl-C or SIGTERM ended a command."""
    err.print("interrupted; no incomplete file was left behind")


def reset_terminal() -> None:
    """Resets --quiet and --verbose, before a command runs.

    A character that the terminal's alphabet lacks is printed as an escape.
    """
    _detail.quiet = _detail.verbose = out.quiet = False
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def silence() -> None:
    """Stops all text on standard output, for a command that prints JSON there."""
    out.quiet = True


def animated(console: Console) -> bool:
    """Whether a bar may be drawn: on a real terminal, with neither --quiet nor --verbose."""
    return console.file.isatty() and not _detail.quiet and not _detail.verbose


def wide_console(console: Console, width: int) -> Console:
    """The console itself on a terminal; for a pipe or file one of `width` characters."""
    if console.is_terminal:
        return console
    return PlainConsole(file=console.file, width=width, quiet=console.quiet)


class Stages:
    """Shows the stage of a command, and the seconds so far, when it is called with its name."""

    def __init__(self, bar: Progress) -> None:
        self._bar, self._since = bar, time.monotonic()
        self._task = bar.add_task("starting", total=None)  # how long a stage takes is not known

    def __call__(self, stage: str) -> None:
        if _detail.verbose:
            err.print(f"{time.monotonic() - self._since:7.1f} s  {stage}")
        self._bar.update(self._task, description=stage)

    @contextmanager
    def removed(self) -> Iterator[None]:
        """Takes the bar off the terminal while results are printed."""
        if not self._bar.live.is_started:
            yield
            return
        self._bar.stop()
        yield
        self._bar.start()


@contextmanager
def progress_bar() -> Iterator[Stages]:
    """Shows the stage of a command that the callback is given, and the seconds so far.

    On a terminal as a bar; with --verbose as a line for each stage; otherwise not at all.
    """
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=err, transient=True)
    with bar if animated(err) else nullcontext():
        yield Stages(bar)


def _take_quiet(value: bool) -> None:
    _detail.quiet |= value
    out.quiet |= value


def _take_verbose(value: bool) -> None:
    _detail.verbose |= value


Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        help="Print only errors, and the output of --json.",
        callback=_take_quiet,
        expose_value=False,
    ),
]
Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose",
        "-v",
        help="Print each stage with the seconds since the start, also in a pipe.",
        callback=_take_verbose,
        expose_value=False,
    ),
]
