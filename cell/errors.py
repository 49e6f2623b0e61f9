"""The exceptions that reach the user as a message: the input is at fault (exit code 2), or the work cannot be done (1).

Their text says what was found, where, and how to mend it.
"""


class InputError(ValueError):
    """Bad input: a file, a column, a key or a value that cannot be used as it stands."""


class DescriptionError(InputError):
    """A YAML description (robot, ball-bar, scenario, recording, calibration) is wrong."""


class LogError(InputError):
    """A device log is wrong: torn, in another unit, running backwards, not what was declared."""


class FailureError(RuntimeError):
    """Begun with input in good order, the work came to no result."""
