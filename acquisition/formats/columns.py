"""What device files that are no plain tables share: their bytes, and the wanted columns."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.report import Finding
from acquisition.table.header import Kind, Layout
from acquisition.table.table import Table
from acquisition.table.text import MOST_BYTES, Content, read_bytes
from cell.errors import LogError

# Of the records; a file that has lost more was not damaged, it holds something else.
DAMAGED_LIMIT = 0.01


def stored_bytes(path: Path, file: str) -> Content:
    """The content of a device file, unpacked if its name ends in .gz, .bz2 or .xz.

    file : the name that errors and findings give it.
    Raises LogError if it is missing, unreadable, empty or too large.
    """
    check_stored(path, file, largest=MOST_BYTES)
    content = read_bytes(path, file)
    if not content.raw:
        raise LogError(f"{file}: the file is empty. Copy it again from the logger.")
    return content


def check_stored(path: Path, file: str, *, largest: int) -> None:
    """Raises LogError if there is no such file, or it is empty or has more than `largest` bytes."""
    if not path.is_file():
        raise LogError(
            f"{file}: no such file (looked for {path}). "
            "Correct the name in recording.yaml, or copy the file there."
        )
    size = path.stat().st_size
    if not size:
        raise LogError(f"{file}: the file is empty. Copy it again from the logger.")
    if size > largest:
        remedy = "Cut it, or name the right file."
        raise LogError(f"{file}: {size} bytes; a log has at most {largest}. {remedy}")


def wanted_columns(
    layout: Layout, time: str, names: Collection[str], location: str
) -> dict[str, Kind]:
    """Name and kind of the wanted columns that are present, without the time column.

    names : what the file has.
    Raises LogError if a required one is missing, or a set that stands all or none is incomplete.
    """
    wanted = {name: kind for name, kind in layout.required.items() if name != time}
    missing = [name for name in wanted if name not in names]
    if not missing and any(name in names for name in layout.together):
        missing = [name for name in layout.together if name not in names]
    if missing:
        shown = ", ".join(repr(name) for name in list(names)[:12])
        close = difflib.get_close_matches(missing[0], names, n=1, cutoff=0.7)
        hint = f" Is {close[0]!r} meant?" if close else ""
        raise LogError(
            f"{location}: {', '.join(missing)} missing; the file has {shown}.{hint} "
            "Log them too, or name the dialect of this file."
        )
    return wanted | {name: kind for name, kind in layout.optional.items() if name in names}


def one_file(
    columns: dict[str, NDArray[Any]],
    file: str,
    line: NDArray[np.int64],
    findings: Iterable[Finding] = (),
) -> Table:
    """The table of one file: columns (N,), line or message number (N,) of each row, findings."""
    index = np.zeros(line.size, dtype=np.int64)
    return Table(columns, (file,), index, line, findings=tuple(findings))
