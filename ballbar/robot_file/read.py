"""Files that robots are made from, read with care: regular files of bounded size, UTF-8."""

from __future__ import annotations

from pathlib import Path

from cell.errors import InputError
from cell.foreign_files import read_regular

MAX_BYTES = 10_000_000  # of a URDF with every link of a cell; its meshes are files of their own


def read_description(path: Path) -> str:
    """The text of a URDF or table.

    Raises InputError if it is no regular file, larger than MAX_BYTES, or not UTF-8.
    """
    try:
        raw = read_regular(path, MAX_BYTES)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file. Correct the name.") from None
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read: {error.strerror}. Name the URDF or table itself, without "
            "meshes."
        ) from None
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}:{line}: byte 0x{raw[error.start]:02x} is not UTF-8. Save the file as UTF-8."
        ) from None
