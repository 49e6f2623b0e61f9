"""The command line.

Exit codes: 0 done, 1 the result is not acceptable, 2 bad input, 130 interrupted by Ctrl-C.
"""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.markup import escape

from ballbar.commands.listing import ListedCommands
from ballbar.terminal import Quiet, Verbose, err, reset_terminal
from cell.errors import FailureError, InputError

app = typer.Typer(
    cls=ListedCommands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)


def _print_version(requested: bool) -> None:
    if requested:
        from ballbar.sweep.version import code_version

        typer.echo(f"ballbar {code_version()}")
        raise typer.Exit


Version = Annotated[
    bool,
    typer.Option(
        "--version",
        help="Print the release and a digest of the code, and exit.",
        callback=_print_version,
        is_eager=True,
    ),
]


@app.callback()
def shared(quiet: Quiet = False, verbose: Verbose = False, version: Version = False) -> None:
    """Robot calibration with a ball-bar, draw-wire, laser tracker or sockets.

    Simulate the cell, read its logs, identify the robot and look at the result.
    """


def main() -> None:
    """Entry point: runs a command and turns errors into a message and an exit code."""
    reset_terminal()
    try:
        app()
    except InputError as error:
        err.print(f"[red]error:[/] {escape(str(error))}")
        sys.exit(2)
    except FailureError as error:
        err.print(f"[red]failed:[/] {escape(str(error))}")
        sys.exit(1)
    except OSError as error:
        file, reason = str(error.filename or ""), error.strerror or str(error)
        err.print(f"[red]error:[/] {escape(file)}: {escape(reason)}")
        sys.exit(2)
