"""Files of others, read with care: regular ones of bounded size, and none of them twice.

A pipe is never waited for, nor a device read without end.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable
from io import BufferedReader
from pathlib import Path

# Binary on every system; a pipe opens at once, and is then refused.
_FLAGS = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)


def open_regular(path: Path, most: int) -> BufferedReader:
    """A regular file of at most `most` bytes, open for reading.

    Raises OSError if there is none or it cannot be read, is no regular file, or is larger;
    ValueError for a NUL in the name.
    """
    descriptor = os.open(path, _FLAGS)
    status = os.fstat(descriptor)
    refused = None
    if not stat.S_ISREG(status.st_mode):
        refused = OSError(errno.EINVAL, "it is no regular file", str(path))
    elif status.st_size > most:
        refused = OSError(errno.EFBIG, f"it is larger than {most / 1e6:g} MB", str(path))
    if refused:
        os.close(descriptor)
        raise refused
    return os.fdopen(descriptor, "rb")


def read_regular(path: Path, most: int) -> bytes:
    """The content of a regular file of at most `most` bytes; raises as `open_regular`."""
    with open_regular(path, most) as file:
        return file.read()


def repeated(folder: Path, files: Iterable[str]) -> tuple[str, str] | None:
    """Two names of one file, links and other spellings included; None if there are none."""
    names: dict[object, str] = {}
    for name in files:
        try:
            status = os.stat(folder / name)  # noqa: PTH116  also where the name holds a NUL
            place = status.st_ino or os.path.realpath(folder / name)  # 0 on some disks of Windows
            key: object = (status.st_dev, place)
        except (OSError, ValueError):  # its reader says so
            key = name
        if key in names:
            return names[key], name
        names[key] = name
    return None
