"""Rows of a device table as plain lines: as many fields as the header, no quotes, decimal points; lost rows are counted.

A line torn by a failing recorder has too few fields, or too many where two ran together. Rows that all have another number
of fields are no torn lines: the worst case is decimal commas with comma separators, which naive readers load with no error.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import repeat
from operator import contains
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from acquisition.report import Finding, finding
from acquisition.table.header import SEPARATORS, Header, Layout, split_fields
from acquisition.table.text import LogText
from cell.errors import LogError

TORN_LIMIT = 0.01  # a recorder that loses more than one line in a hundred is not torn, it writes something else
_END = "EOF"  # last line of TwinCAT exports


@dataclass(frozen=True, eq=False)
class PlainRows:
    """The complete rows below the header."""

    file: str
    lines: list[str]  # as written
    plain: list[str]  # without quotes and decimal commas
    separator: str  # of the plain lines
    number: NDArray[np.int64]  # (N,) line number, counted from 1
    begins: NDArray[np.bool_]  # (N,) whether the header stands again before the row
    repaired: NDArray[np.bool_]  # (N,) whether something in this very line was mended
    decimal: str


def plain_rows(text: LogText, header: Header, layout: Layout, findings: list[Finding]) -> PlainRows:
    """The complete rows of a text below its header; repairs are appended to `findings`.

    Raises LogError if there are none, if more than TORN_LIMIT are torn, or if commas and points are mixed.
    """
    lines, number = text.lines[header.row :], text.number[header.row :]
    if header.glued:
        lines, number = (
            [header.glued, *lines],
            np.concatenate(([text.number[header.row - 1]], number)),
        )
    if lines and lines[-1].strip() == _END:
        lines, number = lines[:-1], number[:-1]
    begins = np.zeros(len(lines), dtype=bool)
    if header.line and header.line in lines:
        lines, number, begins = _without_headers(lines, number, header.line, text.file, findings)
    if not lines:
        raise LogError(f"{text.file}: a header but no complete row below it.")
    separator = header.separator
    if separator == " ":
        lines, separator = ["\t".join(line.split()) for line in lines], "\t"
    lines = _without_end(lines, separator, len(header.names), text.file, findings)
    full = _full_rows(lines, number, header, separator, text, findings)
    if not full.size:
        raise LogError(f"{text.file}: the only row below the header is torn.")
    if full.size < len(lines):
        begins = _carried(begins, full)
        lines, number = [lines[i] for i in full], number[full]
    commas = _decimal_commas(lines, header, separator, layout, text.file, findings)
    plain = _plain_lines(lines, separator, quoted=text.quoted, commas=bool(commas))
    repaired = np.zeros(len(lines), dtype=bool)
    repaired[0] = bool(header.glued)
    return PlainRows(
        text.file, lines, plain, separator, number, begins, repaired, "comma" if commas else "point"
    )


def _without_headers(
    lines: list[str], number: NDArray[np.int64], header: str, file: str, findings: list[Finding]
) -> tuple[list[str], NDArray[np.int64], NDArray[np.bool_]]:
    again = np.array([line == header for line in lines], dtype=bool)
    sentence = "the header stands here again: the logger was restarted; a new segment."
    findings.append(finding("header again", "repaired", file, sentence, lines=number[again]))
    rows = np.flatnonzero(~again)
    return (
        [lines[i] for i in rows],
        number[rows],
        _carried(np.concatenate(([False], again[:-1])) & ~again, rows, again),
    )


def _carried(
    begins: NDArray[np.bool_], kept: NDArray[np.intp], also: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_]:
    """(K,) for each kept row whether it, or a row left out before it, begins something."""
    total = np.cumsum(begins if also is None else also)
    return np.diff(total[kept], prepend=0) > 0


def _without_end(
    lines: list[str], separator: str, width: int, file: str, findings: list[Finding]
) -> list[str]:
    """The lines without a separator at their end, if they have one."""
    closed = [
        line.endswith(separator) and _width(line, separator) == width + 1 for line in lines[:20]
    ]
    if not all(closed):
        return lines
    findings.append(
        finding("separator at the line end", "repaired", file, "left out.", count=len(lines))
    )
    return [
        line[:-1] if line.endswith(separator) and _width(line, separator) == width + 1 else line
        for line in lines
    ]


def _full_rows(
    lines: list[str],
    number: NDArray[np.int64],
    header: Header,
    separator: str,
    text: LogText,
    findings: list[Finding],
) -> NDArray[np.int64]:
    """Indices of the rows that have as many fields as the header; the torn ones are reported."""
    expected = len(header.names)
    width, file = _widths(lines, separator, quoted=text.quoted), text.file
    torn = np.flatnonzero(width != expected)
    if torn.size > max(1.0, TORN_LIMIT * width.size):
        _refuse_widths(
            [lines[i] for i in torn],
            width[torn],
            number[torn],
            header,
            f"{file}:{number[torn[0]]}",
            total=width.size,
        )
    if torn.size:
        sentence = (
            f"expected {expected} fields, got {width[torn[0]]}; treated as torn line and dropped."
        )
        findings.append(finding("torn line", "repaired", file, sentence, lines=number[torn]))
    return np.flatnonzero(width == expected)


def _widths(lines: list[str], separator: str, *, quoted: bool) -> NDArray[np.int64]:
    if quoted:
        return np.array([_width(line, separator) for line in lines], dtype=np.int64)
    return (
        np.fromiter(map(str.count, lines, repeat(separator)), dtype=np.int64, count=len(lines)) + 1
    )


def _width(line: str, separator: str) -> int:
    return line.count(separator) + 1 if '"' not in line else len(split_fields(line, separator))


def _refuse_widths(
    lines: list[str],
    width: NDArray[np.int64],
    number: NDArray[np.int64],
    header: Header,
    place: str,
    *,
    total: int,
) -> NoReturn:
    expected, usual = len(header.names), int(np.median(width))
    if header.separator == "," and 1.5 * expected <= usual <= 2 * expected:
        raise LogError(
            f"{place}: rows have {usual} fields, the header {expected}: decimal comma with comma separator. "
            "Export again with decimal points, or with semicolons between the fields."
        )
    for other, name in SEPARATORS.items():
        if other not in (header.separator, " ") and _width(lines[0], other) == expected:
            raise LogError(
                f"{place}: the header is separated by {SEPARATORS[header.separator]}, the rows by {name}. Use one of them."
            )
    raise LogError(
        f"{place}: {number.size} of {total} rows do not have the header's number of fields: expected {expected} fields, "
        f"got {width[0]}. More than {TORN_LIMIT:.0%} cannot be torn lines: is this the file that the dialect describes?"
    )


def _decimal_commas(
    lines: list[str],
    header: Header,
    separator: str,
    layout: Layout,
    file: str,
    findings: list[Finding],
) -> list[str]:
    """The float columns written with decimal commas, which only another separator allows.

    Raises LogError if one column has both commas and points.
    """
    if separator == "," or layout.decimal == "point" or not any(map(contains, lines, repeat(","))):
        return []
    cells = [split_fields(line, separator) for line in lines]
    found = []
    for (name, kind), position in zip(header.columns.items(), header.positions, strict=True):
        comma = next((row[position] for row in cells if "," in row[position]), None)
        point = next((row[position] for row in cells if "." in row[position]), None)
        if comma and point:
            raise LogError(
                f"{file}: column {name} has decimal commas and decimal points: {comma!r} and {point!r}. Export it again."
            )
        if comma and kind != "integer":
            found.append(name)
        if point and kind != "integer" and layout.decimal == "comma":
            raise LogError(
                f"{file}: column {name} has decimal points ({point!r}), the dialect declares decimal commas."
            )
    if found and layout.decimal == "either":
        findings.append(
            finding(
                "decimal comma",
                "repaired",
                file,
                f"read as decimal point in {', '.join(found)}.",
                count=len(lines),
            )
        )
    return found


def _plain_lines(lines: list[str], separator: str, *, quoted: bool, commas: bool) -> list[str]:
    """Lines without quotes and decimal commas. A quoted separator becomes `?`, which no number contains."""
    if not commas and not quoted:
        return lines
    plain = [
        line
        if '"' not in line
        else separator.join(cell.replace(separator, "?") for cell in split_fields(line, separator))
        for line in lines
    ]
    return [line.replace(",", ".") for line in plain] if commas else plain
