"""Preview of a log before a dialect is known: its container, columns and first values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ballbar.acquisition.formats.registry import container_of
from ballbar.acquisition.table.text import (
    HEAD,
    LogText,
    column_names,
    likely_separator,
    read_filled,
    split_fields,
    text_of,
)
from ballbar.cell.arrays import Array
from ballbar.cell.dialect import Container
from ballbar.cell.selectors import find

SHOWN = 2000  # rows, from the first, that are looked at


@dataclass(frozen=True)
class LogPreview:
    """Container, columns and first values of a log."""

    name: str
    container: Container
    text: LogText | None  # None for a binary file

    @classmethod
    def of(cls, log: Path) -> LogPreview:
        """The preview of a file. Raises LogError if it cannot be opened."""
        content = read_filled(log, log.name)
        container = container_of(content.raw)
        text = text_of(content, log.name) if container in ("text", "twincat-scope") else None
        return cls(log.name, container, text)

    @cached_property
    def separator(self) -> str:
        return "" if self.text is None else likely_separator(self.text)

    @cached_property
    def columns(self) -> list[str]:
        """Names of its columns, as far as they can be seen.

        In a TwinCAT Scope export they are the channels, in the last of the first lines that begins
        with Name.
        """
        if self.text is None or self.container != "twincat-scope":
            return [] if self.text is None else column_names(self.text)
        named = [line for line in self.text.lines[:HEAD] if line.startswith("Name")]
        fields = split_fields(named[-1], self.separator) if named else []
        return [name for name in fields if name != "Name"]

    @cached_property
    def rows(self) -> list[list[str]]:
        """The cells of the first rows below the header that have its number of fields."""
        lines = [] if self.text is None else self.text.lines[:SHOWN]
        rows = [split_fields(line, self.separator) for line in lines]
        below = rows[rows.index(self.columns) + 1 :] if self.columns in rows else []
        return [row for row in below if len(row) == len(self.columns)]

    def cells(self, name: str) -> list[str]:
        return [row[self.columns.index(name)] for row in self.rows]

    def filled(self, name: str, signal: str | None = None) -> list[str]:
        """The cells of a column that are not empty, in the rows that fill the column `signal`."""
        rows = zip(self.cells(name), self.cells(signal or name), strict=True)
        return [cell for cell, beside in rows if cell and beside]

    def throughout(self, names: Sequence[str]) -> Array:
        """(N, C) numbers of columns, in the rows of the whole file that fill them."""
        at = [position for name in names for position in find(name, self.columns)]
        lines = self.text.lines if self.text is not None and len(at) == len(names) else []
        rows = [row for line in lines if len(row := split_fields(line, self.separator)) > max(at)]
        numbers = [[number(row[k]) for k in at] for row in rows]
        values = np.array([row for row in numbers if None not in row], dtype=np.float64)
        values = values.reshape(-1, len(names))
        return values[np.isfinite(values).all(axis=1)]

    def values(self, name: str | None) -> Array:
        """(N,) numbers of a column; none of it where a cell is no number."""
        numbers = [] if name is None else [number(cell) for cell in self.cells(name)]
        return np.array([] if None in numbers else numbers, dtype=np.float64)


def number(cell: str) -> float | None:
    """The number in a cell, with decimal point or comma; None if it holds none."""
    try:
        return float(cell.replace(",", "."))
    except ValueError:
        return None
