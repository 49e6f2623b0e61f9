"""Output files that appear whole or not at all, and output folders."""

from __future__ import annotations

import os
from pathlib import Path

import yaml

from cell.errors import InputError
from cell.foreign_text import printable


def write_whole(path: Path, content: bytes) -> None:
    """Write a file beside its place, then rename it. Folders are made as needed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}.part")
    try:
        with aside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


def write_new(path: Path, content: bytes) -> None:
    """Writes a file that does not exist yet. Raises InputError rather than replace a file."""
    if path.exists():
        raise InputError(
            f"{path}: exists already; nothing was written. Name another file with --out."
        )
    write_whole(path, content)


def write_yaml(path: Path, data: dict[str, object]) -> None:
    """Write plain data as YAML, keys in their order, control characters of text as escapes."""
    text = yaml.safe_dump(_printable(data), sort_keys=False, allow_unicode=True, width=120)
    write_whole(path, text.encode())


def _printable(data: object) -> object:
    """Plain data with all text printable, as the reader of YAML files wants it."""
    if isinstance(data, dict):
        return {_printable(key): _printable(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_printable(value) for value in data]
    return printable(data) if isinstance(data, str) else data


def claim_folder(path: Path, known: set[str], what: str) -> None:
    """Check that output may go to a folder: absent, empty, or with an earlier output only.

    known : names of an earlier output. what : the kind of output, for the message.

    Raises InputError when the folder holds anything else.
    """
    if path.is_file():
        raise InputError(f"{path}: is a file; {what} needs a folder. Choose another with --out.")
    foreign = sorted({entry.name for entry in path.iterdir()} - known) if path.is_dir() else []
    if foreign:
        raise InputError(
            f"{path}: exists and holds something else ({', '.join(foreign[:3])}); nothing was "
            "written. Choose another folder with --out."
        )
