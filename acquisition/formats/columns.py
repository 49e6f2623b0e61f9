"""Steps that device files share which are no plain tables: their wanted columns, their table."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.report import Finding
from ballbar.acquisition.table.header import Kind, Layout
from ballbar.acquisition.table.table import Table
from ballbar.cell.errors import LogError

# Of the records; a file that has lost more was not damaged, it holds something else.
DAMAGED_LIMIT = 0.01


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
