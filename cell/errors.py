"""Exceptions that reach the user as a message.

Wrong input ends a command with exit code 2, work that fails with 1. The text names the value, its
place, and the remedy.
"""


class InputError(ValueError):
    """Bad input: a file, a column, a key or a value that cannot be used as it stands."""


class DescriptionError(InputError):
    """A YAML description (robot, ball-bar, scenario, recording, calibration) is wrong."""


class LogError(InputError):
    """A device log is wrong: torn, in another unit, with stamps that go back, not as declared."""


class UnfinishedLogError(LogError):
    """A device log holds too few rows, as one that has just begun."""


class FailureError(RuntimeError):
    """The input is valid, but the work came to no result."""
