"""Columns of a table of poses: numbers with the unit that the header states, empty fields marked.

A column is named as in the header, with or without the unit there (`X` finds `X [mm]`), or counted
from 1. An empty field or a NaN of a measurement is NaN here; anything else that is no number is
refused with its line.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.formats.table_file import FileKind
from ballbar.acquisition.report import Finding, finding
from ballbar.acquisition.table.header import PREAMBLE, Kind, Layout, Remedies
from ballbar.acquisition.table.table import Form, text_table
from ballbar.acquisition.table.text import SEPARATORS, LogText, is_number, split_fields
from ballbar.cell.arrays import Array
from ballbar.cell.errors import DescriptionError, LogError
from ballbar.cell.file_units import METRES, RADIANS
from ballbar.cell.selectors import by_position, checked, find

_BRACKETS = re.compile(r"(.*?)\s*[\[(]\s*([^\[\]()]{1,8}?)\s*[\])]\s*")
_BEHIND = re.compile(r"(.+?)(?:\s*/\s*|\s+in\s+)(\S{1,8})\s*")  # `A1 / °`, `A1 in °`
_SPELLINGS = {  # of units beside their own names: the sign of degrees, and two that look like it
    **{"µm": "um", "μm": "um", "in": "inch", "°": "deg", "º": "deg", "˚": "deg"},
    **{"degree": "deg", "degrees": "deg"},
    "Grad": "deg",  # German; `grad` may be a hundredth of a right angle
}
_TERMS = re.compile(r"(.+?) ([+-]) (.+)")
_MISSING = {"", "nan", "-nan", "n/a", "na", "#n/a", "null", "none", "-", "--"}
_THOUSANDS = re.compile(r"[+-]?\d{1,3}([.,' ]\d{3})*[.,]\d+")
# A quoted comma among fields that commas separate (ballbar.acquisition.table.rows).
_QUOTED_COMMA = re.compile(r"[+-]?\d+(\?\d+)+")
REMEDIES = Remedies(
    description="poses.yaml",
    missing="Correct the name in poses.yaml, or give the number of the column, from 1.",
    headerless="For a file without header, give columns by number in poses.yaml: "
    "`columns: [1, 2, 3]`.",
    other_table="is this the file that poses.yaml describes? Export it again.",
)


@dataclass(frozen=True)
class Quantity:
    """One number of each pose: a column, or the difference or sum of two."""

    written: str  # as poses.yaml has it
    terms: tuple[tuple[float, str], ...]  # sign and selector of each column


@dataclass(frozen=True, eq=False)
class PoseRows:
    """The wanted columns of one file."""

    file: str
    kind: FileKind
    line: NDArray[np.int64]  # (N,)
    cells: Mapping[str, NDArray[Any]]  # (N,) text or whole numbers, by selector
    form: Form
    findings: tuple[Finding, ...]

    @property
    def size(self) -> int:
        return int(self.line.size)

    def location(self, row: int | np.integer) -> str:
        return f"{self.file}:{self.line[row]}"

    def remark(
        self, kind: str, sentence: str, chosen: NDArray[np.bool_] | None = None
    ) -> tuple[Finding, ...]:
        """A finding about the chosen rows (N,), none if there are none; else about the file."""
        if chosen is None:
            return (finding(kind, self.file, sentence, count=1),)
        lines = self.line[chosen]
        return (finding(kind, self.file, sentence, lines=lines),) if lines.size else ()

    def take(self, chosen: NDArray[np.bool_]) -> PoseRows:
        """The chosen rows (N,)."""
        cells = {name: values[chosen] for name, values in self.cells.items()}
        return replace(self, line=self.line[chosen], cells=cells)

    def numbers(self, quantities: Sequence[Quantity]) -> Array:
        """(N, C) quantities in the units of their columns; NaN where a field is empty.

        Raises LogError for what is no number, and for infinities.
        """
        values = np.zeros((self.size, len(quantities)))
        for k, quantity in enumerate(quantities):
            terms = [sign * self._column(selector) for sign, selector in quantity.terms]
            values[:, k] = np.sum(terms, axis=0)
        return values

    def text(self, selector: str) -> list[str]:
        return [str(cell).strip() for cell in self.cells[selector]]

    def _column(self, selector: str) -> Array:
        cells = self.cells[selector]
        if cells.dtype.kind in "if":
            return cells.astype(np.float64)
        numbers = (self._number(row, selector, cell) for row, cell in enumerate(cells))
        return np.fromiter(numbers, dtype=np.float64, count=self.size)

    def _number(self, row: int, selector: str, cell: str) -> float:
        if cell.lower() in _MISSING:
            return np.nan
        try:
            value = float(cell) if "_" not in cell else np.inf
        except ValueError:
            hint = ""
            if _QUOTED_COMMA.fullmatch(cell):
                cell = cell.replace("?", ",")
                hint = " A decimal comma, or thousands? Export with semicolons between the fields."
            elif _THOUSANDS.fullmatch(cell):
                hint = " Thousands separators? Export without them."
            raise LogError(
                f"{self.location(row)}: column {selector}: {cell!r} is not a number.{hint} "
                "Correct the cell, or export the file again."
            ) from None
        if not np.isfinite(value):
            raise LogError(
                f"{self.location(row)}: column {selector}: {cell!r} is not a finite number. "
                "Correct the cell, or leave it empty: the row is then left out."
            )
        return value


def header_names(text: LogText) -> set[str]:
    """Every field, however separated, of the lines among which the header is.

    Blanks separate only where nothing else does: names have blanks too.
    """
    names = set[str]()
    for line in text.lines[: PREAMBLE + 1]:
        others = [s for s in SEPARATORS if s != " " and s in line]
        for separator in others or [" "]:
            names.update(split_fields(line, separator))
    return names


def quantities(columns: Iterable[int | str], names: Collection[str]) -> tuple[Quantity, ...]:
    """The quantities that columns of poses.yaml mean in a file with these names.

    Raises DescriptionError for a selector that cannot be one.
    """
    meanings = list[Quantity]()
    for column in columns:
        written, whole = str(column), selector(column, names)
        parts = _TERMS.fullmatch(written)
        if parts is None or whole in names:
            meanings.append(Quantity(written, ((1.0, whole),)))
            continue
        first, second = (selector(name.strip(), names) for name in (parts[1], parts[3]))
        sign = 1.0 if parts[2] == "+" else -1.0
        meanings.append(Quantity(written, ((1.0, first), (sign, second))))
    return tuple(meanings)


def selector(column: int | str, names: Collection[str]) -> str:
    """The name or number that selects a column; a name without its unit becomes the whole one.

    Raises DescriptionError if it cannot be one.
    """
    if isinstance(column, int):
        return f"#{column}"
    try:
        checked(column)
    except ValueError as error:
        raise DescriptionError(f"poses.yaml: column {column!r}: {error}.") from None
    if column in names:
        return column
    matching = [name for name in names if name != column == split_unit(name)[0]]
    return matching[0] if len(matching) == 1 else column


def split_unit(name: str) -> tuple[str, str | None]:
    """A column's name without its unit, and the unit; None where it states none that is known.

    The unit stands in brackets, or behind a slash or `in`: `A1 [°]`, `X (mm)`, `A1 / °`, `X in mm`.
    """
    for pattern in (_BRACKETS, _BEHIND):
        if named := pattern.fullmatch(name):
            spelt = {**_SPELLINGS, **{unit: unit for unit in (*METRES, *RADIANS)}}
            unit = spelt.get(named[2]) or spelt.get(named[2].lower())
            if unit or pattern is _BRACKETS:
                return named[1], unit
    return name, None


def unit_stated(quantity: Quantity) -> str | None:
    """The unit that the header states behind the names; None if it states none."""
    names = [name for _, name in quantity.terms]
    units = {unit for name in names for bare, unit in [split_unit(name)] if bare != name}
    return units.pop() if len(units) == 1 else None


def read_rows(
    text: LogText, kind: FileKind, selectors: Sequence[str], numbers: Sequence[str]
) -> PoseRows:
    """The selected columns of a file; numbers : those of the selectors that hold numbers.

    Raises LogError naming the file, and what the header has instead of a missing column.
    """
    counted = by_position(selectors)
    layout = Layout(
        separators=tuple(SEPARATORS),
        required=dict[str, Kind](dict.fromkeys(selectors, "text")),
        headerless=counted,
        remedies=REMEDIES,
    )
    if counted:
        text = _with_counted_header(text, [int(selector[1:]) - 1 for selector in numbers])
    elif not any(find(name, list(header_names(text))) for name in selectors):
        rows = [split_fields(text.lines[0], separator) for separator in SEPARATORS]
        if any(len(cells) > 1 and all(map(is_number, cells)) for cells in rows):
            raise LogError(
                f"{text.file}:{text.number[0]}: the first line holds numbers, not column names, "
                f"but poses.yaml names {', '.join(layout.required)}. {REMEDIES.headerless}"
            )
    table, form = text_table(text, layout)
    skipped = ("column not used", "preamble")  # as usual in a table of poses
    findings = tuple(entry for entry in table.findings if entry.kind not in skipped)
    return PoseRows(text.file, kind, table.line, table.columns, form, findings)


def _with_counted_header(text: LogText, positions: Sequence[int]) -> LogText:
    """A text without header, below names that count its columns.

    positions : from 0, of the fields that hold numbers in the first row, unless they are empty; the
    others may be names, as in a header.
    """
    most, count, best = 0, 0, ""
    for separator in SEPARATORS:
        cells = split_fields(text.lines[0], separator)
        if len(cells) <= max(positions):
            continue
        filled = [cells[i] for i in positions if cells[i]]
        if len(filled) > most and all(map(is_number, filled)):
            most, count, best = len(filled), len(cells), separator
    if not most or all(map(is_number, split_fields(text.lines[0], best))):
        return text
    header = best.join(f"column-{k + 1}" for k in range(count))
    return replace(text, lines=[header, *text.lines], number=np.concatenate(([0], text.number)))
