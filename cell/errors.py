"""Exceptions that reach the user as a message.

Wrong input ends a command with exit code 2, work that fails with 1. The text names the value, its
place, and the remedy.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Self


class InputError(ValueError):
    """Bad input: a file, a column, a key or a value that cannot be used as it stands."""

    @classmethod
    def at(cls, place: object, what: str, remedy: str) -> Self:
        """The error about a place, such as `robot.csv:7`: what is wrong, and the remedy."""
        return cls(f"{place}: {what} {remedy}")


class DescriptionError(InputError):
    """A YAML description (robot, ball-bar, scenario, recording, calibration) is wrong."""


class LogError(InputError):
    """A device log is wrong: torn, in another unit, with stamps that go back, not as declared."""


class UnfinishedLogError(LogError):
    """A device log holds too few rows, as one that has just begun."""


class FailureError(RuntimeError):
    """The input is valid, but the work came to no result."""


@contextmanager
def imports_for(what: str, requirement: str) -> Iterator[None]:
    """Context for imports that not every installation has.

    what : needs them. requirement : with which pip installs them.

    Raises InputError with both instead of ImportError.
    """
    try:
        yield
    except ImportError as error:
        missing = f"{what} needs {error.name}, which is not installed: pip install '{requirement}'."
        raise InputError(missing) from None
