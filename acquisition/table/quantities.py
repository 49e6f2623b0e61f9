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

from acquisition.formats.table_file import FileKind, first_separator
from acquisition.report import Finding
from acquisition.table.fields import SEPARATORS, is_number, split_fields
from acquisition.table.header import PREAMBLE, Kind, Layout, Remedies
from acquisition.table.table import Form, text_table
from acquisition.table.text import LogText
from cell.arrays import Array
from cell.errors import DescriptionError, LogError
from cell.selectors import by_position, checked, find

_BRACKETS = re.compile(r"(.*?)\s*[\[(]\s*([^\[\]()]{1,8}?)\s*[\])]\s*")
_BEHIND = re.compile(r"(.+?)(?:\s*/\s*|\s+in\s+)(\S{1,8})\s*")  # `A1 / °`, `A1 in °`
_UNITS = {  # as headers write them; the sign of degrees, and two that look like it
    "m": "m", "cm": "cm", "mm": "mm", "um": "um", "µm": "um", "μm": "um",
    "in": "inch", "inch": "inch", "rad": "rad", "deg": "deg", "°": "deg", "º": "deg", "˚": "deg",
    "degree": "deg", "degrees": "deg",
    "Grad": "deg",  # German; `grad` may be a hundredth of a right angle
}  # fmt: skip
_TERMS = re.compile(r"(.+?) ([+-]) (.+)")
_MISSING = {"", "nan", "-nan", "n/a", "na", "#n/a", "null", "none", "-", "--"}
_THOUSANDS = re.compile(r"[+-]?\d{1,3}([.,' ]\d{3})*[.,]\d+")
# A quoted comma among fields that commas separate (acquisition.table.rows).
_QUOTED_COMMA = re.compile(r"[+-]?\d+(\?\d+)+")
REMEDIES = Remedies(
    description="poses.yaml",
    missing="Correct the name in poses.yaml, or give the number of the column, from 1.",
    headerless="For a file without header, give columns by number in poses.yaml: "
    "`columns: [1, 2, 3]`.",
    other_table="is this the file that poses.yaml describes? Export it again.",
)


@dataclass(frozen=True)
class Term:
    """A column with the sign with which it enters a number."""

    sign: float
    selector: str


@dataclass(frozen=True)
class Quantity:
    """One number of each pose: a column, or the difference or sum of two."""

    written: str  # as poses.yaml has it
    terms: tuple[Term, ...]


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

    def location(self, row: int) -> str:
        return f"{self.file}:{self.line[row]}"

    def take(self, chosen: NDArray[np.bool_]) -> PoseRows:
        """The chosen rows (N,)."""
        cells = {name: values[chosen] for name, values in self.cells.items()}
        return replace(self, line=self.line[chosen], cells=cells)

    def numbers(self, quantity: Quantity) -> Array:
        """(N,) the quantity in the unit of its columns; NaN where a field is empty.

        Raises LogError for what is no number, and for infinities.
        """
        terms = [term.sign * self._column(term.selector) for term in quantity.terms]
        return np.asarray(np.sum(terms, axis=0))

    def text(self, selector: str) -> list[str]:
        return [str(cell).strip() for cell in self.cells[selector]]

    def _column(self, selector: str) -> Array:
        cells = self.cells[selector]
        if cells.dtype.kind in "if":
            return cells.astype(np.float64)
        values = np.empty(self.size)
        for row, cell in enumerate(cells):
            values[row] = self._number(row, selector, cell)
        return values

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
    """What columns of poses.yaml mean in a file with these names.

    Raises DescriptionError for a selector that cannot be one.
    """
    return tuple(_quantity(column, names) for column in columns)


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
    alike = [name for name in names if name != (bare := split_unit(name)[0]) and bare == column]
    return alike[0] if len(alike) == 1 else column


def split_unit(name: str) -> tuple[str, str | None]:
    """A column's name without its unit, and the unit; None where it states none that is known.

    The unit stands in brackets, or behind a slash or `in`: `A1 [°]`, `X (mm)`, `A1 / °`, `X in mm`.
    """
    if named := _BRACKETS.fullmatch(name):
        return named[1], _known(named[2])
    if (named := _BEHIND.fullmatch(name)) and (unit := _known(named[2])):
        return named[1], unit
    return name, None


def _known(unit: str) -> str | None:
    return _UNITS.get(unit) or _UNITS.get(unit.lower())


def unit_stated(quantity: Quantity) -> str | None:
    """The unit that the header states behind the names; None if it states none."""
    names = [term.selector for term in quantity.terms]
    each = zip(names, map(split_unit, names), strict=True)
    units = {unit for name, (bare, unit) in each if bare != name}
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
    _refuse_unnamed(text, layout, counted=counted)
    table, form = text_table(_with_counted_header(text, numbers) if counted else text, layout)
    skipped = ("column not used", "preamble")  # as usual in a table of poses
    return PoseRows(
        file=text.file,
        kind=kind,
        line=table.line,
        cells=table.columns,
        form=form,
        findings=tuple(entry for entry in table.findings if entry.kind not in skipped),
    )


def _refuse_unnamed(text: LogText, layout: Layout, *, counted: bool) -> None:
    """Raises LogError for columns by name in a file that begins with a row of numbers."""
    if counted:
        return
    first = text.lines[0]
    names = header_names(text)
    if any(find(name, list(names)) for name in layout.required):
        return
    rows = [split_fields(first, s) for s in SEPARATORS]
    if any(len(cells) > 1 and all(map(is_number, cells)) for cells in rows):
        raise LogError(
            f"{text.file}:{text.number[0]}: the first line holds numbers, not column names, but "
            f"poses.yaml names {', '.join(layout.required)}. {REMEDIES.headerless}"
        )


def _with_counted_header(text: LogText, numbers: Sequence[str]) -> LogText:
    """A text without header, below names that count its columns.

    Its first row may have names or empty fields among the numbers, as a header has.
    """
    positions = [int(selector[1:]) - 1 for selector in numbers]
    separator = first_separator(text.lines[0], positions)
    if separator is None or all(map(is_number, split_fields(text.lines[0], separator))):
        return text
    count = len(split_fields(text.lines[0], separator))
    header = separator.join(f"column-{k + 1}" for k in range(count))
    number = np.concatenate(([0], text.number))
    return replace(text, lines=[header, *text.lines], number=number)


def _quantity(column: int | str, names: Collection[str]) -> Quantity:
    written = str(column)
    whole = selector(column, names)
    terms = _TERMS.fullmatch(written)
    if terms is None or whole in names:
        return Quantity(written, (Term(1.0, whole),))
    second = 1.0 if terms[2] == "+" else -1.0
    first, other = (selector(name.strip(), names) for name in (terms[1], terms[3]))
    return Quantity(written, (Term(1.0, first), Term(second, other)))
