"""Files that robots are made from, read with care: regular files of bounded size, UTF-8."""

from __future__ import annotations

from pathlib import Path

from cell.errors import InputError
from cell.strict_yaml import MAX_BYTES


def read_description(path: Path) -> str:
    """The text of a URDF or table.

    Raises InputError if it is no regular file, larger than MAX_BYTES, or not UTF-8.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file. Correct the name.")
    if not path.is_file():
        raise InputError(f"{path}: this is no regular file; name the file itself.")
    with path.open("rb") as file:
        raw = file.read(MAX_BYTES + 1)
    if len(raw) > MAX_BYTES:
        raise InputError(
            f"{path}: larger than {MAX_BYTES // 1_000_000} MB, so it describes no robot. Name the "
            "URDF itself, without its meshes."
        )
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}:{line}: byte 0x{raw[error.start]:02x} is not UTF-8. Save the file as UTF-8."
        ) from None
