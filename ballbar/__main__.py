"""`python -m ballbar`, and the `ballbar` command.

The command line is imported only when it runs: the worker processes of a sweep import the main
module too, and need none of it.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from contextlib import suppress

from ballbar.cell.threads import ONE_THREAD


def main() -> None:
    """Runs the command line."""
    for name in ONE_THREAD:  # before the libraries load
        os.environ.setdefault(name, "1")
    before = signal.signal(signal.SIGINT, _exit_at_once)
    ends = {signal.SIGTERM, getattr(signal, "SIGBREAK", signal.SIGTERM)}  # the latter of Windows
    for number in ends:
        signal.signal(number, _exit_at_once)
    from ballbar.commands.cli import main as run  # noqa: PLC0415

    signal.signal(signal.SIGINT, before)
    # The end of a batch job or container counts as Ctrl-C: what is under way is put away first.
    for number in ends:
        signal.signal(number, signal.default_int_handler)
    try:
        run()
    except SystemExit as leaving:
        if isinstance(leaving.code, int):
            _leave(leaving.code)
        raise


def _leave(code: int) -> None:
    """Ends the process without taking down its libraries, which takes up to 0.4 s.

    Where what was said cannot be delivered it does nothing, and Python ends as always.
    """
    with suppress(OSError, ValueError):  # of a closed pipe, of closed streams
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _exit_at_once(*_: object) -> None:
    """Ctrl-C, SIGTERM while libraries load: nothing is open, and some make another error of it."""
    sys.stderr.write("interrupted before it began\n")
    sys.stderr.flush()
    os._exit(130)


if __name__ == "__main__":
    main()
