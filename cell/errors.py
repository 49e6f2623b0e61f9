"""The one exception that means: the user's input is at fault.

Its text says what was found, where, and how to mend it; the command line prints it and exits with code 2.
"""


class InputError(ValueError):
    """Bad input: a file, a column, a key or a value that cannot be used as it stands."""


class DescriptionError(InputError):
    """A YAML description (robot, ball-bar, scenario, recording, calibration) is wrong."""


class LogError(InputError):
    """A device log is wrong: torn, in another unit, running backwards, not what was declared."""
