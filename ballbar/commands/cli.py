"""The command line.

Exit codes: 0 done, 1 the result is not acceptable, 2 bad input, 3 a fault of the program or too
little memory, 130 interrupted by Ctrl-C or SIGTERM.
"""

from __future__ import annotations

import errno
import re
import sys
from typing import Annotated

import typer
from rich.markup import escape

from ballbar.cell.errors import FailureError, InputError
from ballbar.commands.listing import ListedCommands
from ballbar.terminal import (
    FAULT,
    INTERRUPTED,
    Quiet,
    Verbose,
    err,
    reset_terminal,
    say_interrupted,
)

app = typer.Typer(
    cls=ListedCommands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)


def _print_version(requested: bool) -> None:
    if requested:
        from ballbar.code_version import code_version

        typer.echo(f"ballbar {code_version()}")
        raise typer.Exit


_REMEDIES = {  # what to do about an error of the machine
    errno.EACCES: "Change its permissions, or name another file or folder.",
    errno.EPERM: "Change its permissions, or name another file or folder.",
    errno.EROFS: "Name a file or folder elsewhere.",
    errno.ENOSPC: "Make room, or name a file or folder on another disk.",
    errno.EDQUOT: "Make room, or name a file or folder on another disk.",
}

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
    """Robot calibration with a ball-bar, draw-wire, laser tracker, camera or sockets.

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
        place = f"{file}: " if file else ""
        remedy = f". {_REMEDIES[error.errno]}" if error.errno in _REMEDIES else ""
        err.print(f"[red]error:[/] {escape(place + reason + remedy)}")
        sys.exit(2)
    except MemoryError as error:
        err.print(
            f"[red]error:[/] there is not enough memory: {escape(str(error)) or 'no details'}. "
            "Split long recordings, or run it on a machine with more memory."
        )
        sys.exit(FAULT)
    except Exception as error:
        if _was_interrupted(error):
            say_interrupted()
            sys.exit(INTERRUPTED)
        if isinstance(error, ModuleNotFoundError) and (requirement := _requirement_of(error)):
            what = f"this command needs {error.name}, which is not installed: pip install"
            err.print(f"[red]error:[/] {escape(what)} '{escape(requirement)}'.")
            sys.exit(2)
        _say_fault(error)
        sys.exit(FAULT)


def _was_interrupted(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an error, as where a library was just being imported."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _requirement_of(error: ModuleNotFoundError) -> str | None:
    """Our requirement, as pip takes it, that installs a missing module; None for other modules."""
    from importlib.metadata import requires

    module = (error.name or "").partition(".")[0]
    names = {"mujoco": "mujoco-core", "rerun": "rerun-sdk", "fpdf": "fpdf2"}
    names |= {"cv2": "opencv-python-headless"}
    name = names.get(module, module)
    lines = (line.partition(";")[0].strip() for line in requires("ballbar-bench") or ())
    return next((line for line in lines if re.split(r"[^\w-]", line)[0] == name), None)


def _place_of(details: str) -> str:
    """Where the details of a fault are: in a new file, or printed here."""
    from tempfile import NamedTemporaryFile

    try:
        with NamedTemporaryFile("wb", prefix="ballbar-", suffix=".txt", delete=False) as file:
            file.write(details.encode("utf-8", "backslashreplace"))
    except OSError:
        err.print(escape(details))
        return "The details are above."
    return f"The details are in {file.name}."


def _say_fault(error: Exception) -> None:
    """Says what the program failed at, and writes the details to a file of their own."""
    import platform
    import traceback
    from importlib.metadata import version

    from ballbar.commands.options import command_line

    head = f"ballbar {version('ballbar-bench')}, Python {sys.version}, {platform.platform()}"
    details = "".join([f"{head}\n{command_line()}\n\n", *traceback.format_exception(error)])
    place = _place_of(details)
    what = escape(f"{type(error).__name__}: {error}")
    err.print(
        f"[red]fault of the program:[/] {what}\n{escape(place)} Please report it to the "
        "maintainers of ballbar-bench with these details and, if you may, the input."
    )
