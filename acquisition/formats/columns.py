"""What all device files that are no plain tables share: their bytes, and the columns wanted from them."""

from __future__ import annotations

import difflib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.report import Finding
from acquisition.table.header import Kind, Layout
from acquisition.table.table import Table
from acquisition.table.text import MOST_BYTES, read_bytes
from cell.errors import LogError

DAMAGED_LIMIT = (
    0.01  # of the records; a file that has lost more was not damaged, it holds something else
)


def stored_bytes(path: Path, file: str, findings: list[Finding]) -> bytes:
    """The content of a device file, unpacked if its name ends in .gz, .bz2 or .xz.

    file : the name that errors and findings give it.
    Raises LogError if it is missing, unreadable, empty or too large.
    """
    check_stored(path, file, largest=MOST_BYTES)
    raw = read_bytes(path, file, findings)
    if not raw:
        raise LogError(f"{file}: the file is empty.")
    return raw


def check_stored(path: Path, file: str, *, largest: int) -> None:
    """Raises LogError if there is no such file, or it is empty or too large."""
    if not path.is_file():
        raise LogError(f"{file}: no such file (looked for {path}).")
    size = path.stat().st_size
    if not size:
        raise LogError(f"{file}: the file is empty.")
    if size > largest:
        raise LogError(
            f"{file}: {size} bytes; a log has at most {largest}. Cut it, or name the right file."
        )


def wanted_columns(
    layout: Layout, time: str, names: Collection[str], place: str
) -> dict[str, Kind]:
    """Name and kind of the wanted columns that are present, the time column apart.

    names : what the file has.
    Raises LogError if a required one is missing, or a set that stands all or none is incomplete.
    """
    wanted = {name: kind for name, kind in layout.required.items() if name != time}
    missing = [name for name in wanted if name not in names]
    some = [name for name in layout.together if name in names]
    if some and not missing:
        missing = [name for name in layout.together if name not in names]
    if missing:
        shown = ", ".join(repr(name) for name in list(names)[:12])
        near = difflib.get_close_matches(missing[0], names, n=1, cutoff=0.7)
        hint = f" Is {near[0]!r} meant?" if near else ""
        raise LogError(f"{place}: {', '.join(missing)} missing; the file has {shown}.{hint}")
    return wanted | {name: kind for name, kind in layout.optional.items() if name in names}


def one_file(columns: dict[str, NDArray[Any]], file: str, line: NDArray[np.int64]) -> Table:
    """The table of one file."""
    return Table(columns, (file,), np.zeros(line.size, dtype=np.int64), line)
