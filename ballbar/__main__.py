"""`python -m ballbar`, and the `ballbar` command.

The command line is imported only when it runs: the worker processes of a sweep import the main module too, and need none of it.
"""

from __future__ import annotations


def main() -> None:
    """Runs the command line."""
    from ballbar.cli import main as run  # noqa: PLC0415

    run()


if __name__ == "__main__":
    main()
