"""What every command shares with the terminal: two consoles, --quiet and --verbose, the stage that is under way.

Results go to standard output, everything else to standard error. Colours are for a terminal; in a pipe there are none unless
FORCE_COLOR is set, and NO_COLOR switches them off (both as rich reads them). What moves is for a terminal alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from typer.core import TyperGroup

INTERRUPTED = 130  # exit code after Ctrl-C, as shells have it

out = Console(highlight=False, soft_wrap=True, emoji=False)  # file.csv:100: is line 100
err = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)


@dataclass
class _Detail:
    """How much the running command tells."""

    quiet: bool = False
    verbose: bool = False


_detail = _Detail()


class CommandGroup(TyperGroup):
    """Commands that all take --quiet and --verbose, as the group does: before the command's name or behind it."""

    def __init__(self, *given: Any, **options: Any) -> None:
        super().__init__(*given, **options)
        shared = [option for option in self.params if option.name in ("quiet", "verbose")]
        for command in self.commands.values():
            command.params += shared

    def invoke(self, ctx: Any) -> Any:
        """Runs a command; after Ctrl-C says that files are whole, and exits with INTERRUPTED."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            err.print("interrupted; nothing half-written was left")
            raise typer.Exit(INTERRUPTED) from None


def fresh_terminal() -> None:
    """Neither quiet nor verbose, as every command begins."""
    _detail.quiet = _detail.verbose = out.quiet = False


def silence() -> None:
    """No words on standard output from here on: what follows there is JSON."""
    out.quiet = True


def moves(console: Console) -> bool:
    """Whether something that moves may be drawn: on a real terminal, not asked to be quiet or to tell every stage."""
    return console.file.isatty() and not _detail.quiet and not _detail.verbose


@contextmanager
def progress_bar() -> Iterator[Callable[[str], None]]:
    """A bar with the stage and the seconds so far, on a terminal; with --verbose a line each stage; else nothing."""
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=err,
        transient=True,
    )
    task = bar.add_task("starting", total=None)  # how long a stage takes is not known before
    since = time.monotonic()

    def show(stage: str) -> None:
        if _detail.verbose:
            err.print(f"{time.monotonic() - since:7.1f} s  {stage}")
        bar.update(task, description=stage)

    with bar if moves(err) else nullcontext():
        yield show


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
        help="Print nothing but errors, and what --json asks for.",
        callback=_take_quiet,
        expose_value=False,
    ),
]
Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose",
        "-v",
        help="Tell each stage with the seconds it began at, also in a pipe.",
        callback=_take_verbose,
        expose_value=False,
    ),
]
