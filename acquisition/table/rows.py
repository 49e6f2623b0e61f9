"""Rows of a device table as plain lines: as many fields as the header, no quotes, decimal points.

A line torn by a failing recorder has too few fields, or too many where two ran together. Rows that
all have another number of fields are no torn lines: the worst case is decimal commas with comma
separators, which naive readers load with no error.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from itertools import repeat
from operator import contains
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.report import Finding, finding
from ballbar.acquisition.table.header import Header, Layout, Remedies
from ballbar.acquisition.table.text import SEPARATORS, LogText, split_fields
from ballbar.cell.errors import LogError, UnfinishedLogError

# Share of the lines: a recorder that loses more is not torn, it writes something else.
TORN_LIMIT = 0.01
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:(?:\.\d{3})+,|(?:,\d{3})+\.)\d+")
_END = "EOF"  # last line of TwinCAT exports


@dataclass(frozen=True, eq=False)
class PlainRows:
    """The rows below the header, complete once they are plain."""

    file: str
    lines: list[str]  # as written
    number: NDArray[np.int64]  # (N,) line number, counted from 1
    begins: NDArray[np.bool_]  # (N,) whether the header stands again before the row
    separator: str  # of the plain lines
    width: int  # fields of the header
    quoted: bool
    plain: list[str] = field(default_factory=list)  # without quotes and decimal commas
    decimal: str = "point"
    findings: tuple[Finding, ...] = ()

    def take(self, rows: NDArray[np.intp]) -> PlainRows:
        """The chosen rows; one behind one that is left out begins what that one began."""
        begins = np.diff(np.cumsum(self.begins)[rows], prepend=0) > 0
        lines, plain = [self.lines[i] for i in rows], [self.plain[i] for i in rows if self.plain]
        return replace(self, lines=lines, number=self.number[rows], begins=begins, plain=plain)

    def remarked(
        self,
        kind: str,
        sentence: str,
        *,
        lines: NDArray[np.int64] | tuple[int, ...] = (),
        count: int | None = None,
    ) -> PlainRows:
        """The same rows with one finding more."""
        entry = finding(kind, self.file, sentence, lines=lines, count=count)
        return replace(self, findings=(*self.findings, entry))


def plain_rows(text: LogText, header: Header, layout: Layout) -> PlainRows:
    """The complete rows of a text below its header; the findings say what was repaired.

    Raises LogError if there are none, if more than TORN_LIMIT are torn, or if commas and points are
    mixed.
    """
    rows = _below_header(text, header)
    if header.line and header.line in rows.lines:
        again = np.array([line == header.line for line in rows.lines], dtype=bool)
        sentence = "the header stands here again: the logger was restarted; a new segment."
        number = rows.number[again]
        rows = replace(rows, begins=again).take(np.flatnonzero(~again))
        rows = rows.remarked("header again", sentence, lines=number)
    if not rows.lines:
        what = "a header but no complete row below it. Is the file cut off?"
        raise UnfinishedLogError.at(text.file, what, "Copy it again.")
    if rows.separator == " ":
        tabbed = ["\t".join(line.split()) for line in rows.lines]
        rows = replace(rows, lines=tabbed, separator="\t")
    rows = _full_rows(_without_end(rows), header, layout.remedies)
    rows, commas = _with_decimal_commas(rows, header, layout)
    plain = [_unquoted(line, rows.separator) for line in rows.lines] if rows.quoted else rows.lines
    plain = [line.replace(",", ".") for line in plain] if commas else plain
    return replace(rows, plain=plain, decimal="comma" if commas else "point")


def _below_header(text: LogText, header: Header) -> PlainRows:
    lines, number = text.lines[header.row :], text.number[header.row :]
    if header.glued:
        lines = [header.glued, *lines]
        number = np.concatenate(([text.number[header.row - 1]], number))
    if lines and lines[-1].strip() == _END:
        lines, number = lines[:-1], number[:-1]
    return PlainRows(
        file=text.file,
        lines=lines,
        number=number,
        begins=np.zeros(len(lines), dtype=bool),
        separator=header.separator,
        width=len(header.names),
        quoted=text.quoted,
    )


def _without_end(rows: PlainRows) -> PlainRows:
    """The lines without a separator at their end, if they have one."""

    def closed(line: str) -> bool:
        return line.endswith(rows.separator) and _width(line, rows.separator) == rows.width + 1

    if not all(map(closed, rows.lines[:20])):
        return rows
    lines = [line[:-1] if closed(line) else line for line in rows.lines]
    rows = replace(rows, lines=lines)
    return rows.remarked("separator at the line end", "left out.", count=len(lines))


def _full_rows(rows: PlainRows, header: Header, remedies: Remedies) -> PlainRows:
    """The rows that have as many fields as the header."""
    if rows.quoted:
        counts = (_width(line, rows.separator) for line in rows.lines)
    else:
        counts = (line.count(rows.separator) + 1 for line in rows.lines)
    width = np.fromiter(counts, dtype=np.int64, count=len(rows.lines))
    torn = np.flatnonzero(width != rows.width)
    if torn.size > max(1.0, TORN_LIMIT * width.size):
        _refuse_widths(rows.take(torn), width[torn], header, remedies, total=width.size)
    if torn.size == width.size:
        what = "the only row below the header is torn. Is the file cut off?"
        raise UnfinishedLogError.at(rows.file, what, "Copy it again.")
    if not torn.size:
        return rows
    got = f"expected {rows.width} fields, got {width[torn[0]]}"
    full = rows.take(np.flatnonzero(width == rows.width))
    sentence = f"{got}; treated as torn line and dropped."
    return full.remarked("torn line", sentence, lines=rows.number[torn])


def _width(line: str, separator: str) -> int:
    return line.count(separator) + 1 if '"' not in line else len(split_fields(line, separator))


def _refuse_widths(
    torn: PlainRows, width: NDArray[np.int64], header: Header, remedies: Remedies, *, total: int
) -> NoReturn:
    """Raises LogError for rows with another number of fields (K,) than the header."""
    location = f"{torn.file}:{torn.number[0]}"
    expected, usual = torn.width, int(np.median(width))
    if header.separator == "," and 1.5 * expected <= usual <= 2 * expected:
        what = f"{usual} fields, the header has {expected}: decimal comma with comma separator."
        remedy = "Export again with decimal points, or with semicolons between the fields."
        raise LogError.at(location, what, remedy)
    for other, name in SEPARATORS.items():
        if other not in (header.separator, " ") and _width(torn.lines[0], other) == expected:
            what = f"the header is separated by {SEPARATORS[header.separator]}, the rows by {name}."
            raise LogError.at(location, what, "Use one of them.")
    raise LogError(
        f"{location}: {width.size} of {total} rows do not have the header's number of fields: "
        f"expected {expected} fields, got {width[0]}. More than {TORN_LIMIT:.0%} cannot be torn "
        f"lines: {remedies.other_table}"
    )


def _with_decimal_commas(rows: PlainRows, header: Header, layout: Layout) -> tuple[PlainRows, bool]:
    """The rows, and whether they have decimal commas, which only another separator allows.

    Raises LogError if one column has both commas and points.
    """
    plain = rows.separator == "," or layout.decimal == "point"
    if plain or not any(map(contains, rows.lines, repeat(","))):
        return rows, False
    cells = [split_fields(line, rows.separator) for line in rows.lines]
    commas = []
    for (name, kind), position in zip(header.columns.items(), header.positions, strict=True):
        comma = next((row[position] for row in cells if "," in row[position]), None)
        if kind == "text" and comma and ":" in comma:  # a date's points are no decimal points
            commas.append(name)
            continue
        point = next((row[position] for row in cells if "." in row[position]), None)
        if comma and point:
            both = (k for k, row in enumerate(cells) if _THOUSANDS.fullmatch(row[position]))
            if (k := next(both, None)) is not None:
                what = f"column {name}: {cells[k][position]!r} has a separator of thousands."
                remedy = "Export without it (German Excel: Tausendertrennzeichen)."
                raise LogError.at(f"{rows.file}:{rows.number[k]}", what, remedy)
            what = f"column {name} has decimal commas and decimal points: {comma!r} and {point!r}."
            raise LogError.at(rows.file, what, "Export it again.")
        if comma and kind != "integer":
            commas.append(name)
        if point and kind != "integer" and layout.decimal == "comma":
            raise LogError(
                f"{rows.file}: column {name} has decimal points ({point!r}), the dialect declares "
                "decimal commas. Name the dialect of this file."
            )
    if commas and layout.decimal == "either":
        sentence = f"read as decimal point in {', '.join(commas)}."
        rows = rows.remarked("decimal comma", sentence, count=len(rows.lines))
    return rows, bool(commas)


def _unquoted(line: str, separator: str) -> str:
    """The line without quotes; a quoted separator becomes `?`, which no number contains."""
    if '"' not in line:
        return line
    return separator.join(cell.replace(separator, "?") for cell in split_fields(line, separator))
