"""`python -m ballbar`, and the `ballbar` command.

The command line is imported only when it runs: the worker processes of a sweep import the main
module too, and need none of it.
"""

from __future__ import annotations

import os

from cell.threads import ONE_THREAD


def main() -> None:
    """Runs the command line."""
    for name in ONE_THREAD:  # before the libraries load
        os.environ.setdefault(name, "1")
    from ballbar.commands.cli import main as run  # noqa: PLC0415

    run()


if __name__ == "__main__":
    main()
