"""The parts of a TwinCAT Scope export (CSV or TXT): preamble, metadata by channel, rows of fields.

    Name<TAB>project                                     preamble
    Starttime of export<TAB>132959733843760000<TAB>...
    Endtime of export<TAB>...

    Name<TAB>b1<TAB>b2<TAB>Name<TAB>fast                 metadata
    Data-Type<TAB>UINT32<TAB>UINT32<TAB>Data-Type<TAB>REAL32
    ...
                                                         data

The separator is the character behind the first word. Start and end are FILETIME (100 ns since 1601,
UTC); what follows them is local and localised. The metadata have one key a group, in the place of
the group's time column. The data have a time [ms from the start, or FILETIME] and the values of
each group.

A group that ends early is padded with blanks, or the rows get shorter. Whether offset and scale
factor have been applied to the values is an option of the export that the file does not show: a
counter that has any is refused. Metadata follow the decimal mark of Windows, data the one of the
export.
Source: exports of TwinCAT 3 Scope 3.4.3145.3 among the test data of pytcs.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquisition.report import Finding
from acquisition.table.text import read_text
from cell.errors import LogError

SEPARATORS = {"\t": "tab", ":": "colon", ";": "semicolon", ",": "comma"}
SAMPLE_TIME = "SampleTime[ms]"
INTEGER = re.compile(r"[+-]?[0-9]+")
FLOAT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")

_FILETIMES = range(10**17, 2 * 10**17)  # [100 ns since 1601] the years 1917 to 2234
_FREE_TEXT = {"Name", "SymbolComment"}  # a channel may be called as the key is
# 0,2 ms with comma separator has a field too many, empty comments one too few.
_MAY_DIFFER = {SAMPLE_TIME, "SymbolComment"}


@dataclass(frozen=True)
class ChannelGroup:
    """A time column and the channels that follow it."""

    start: int  # position of the time column
    stop: int  # behind the last channel


@dataclass(frozen=True, eq=False)
class Export:
    """An export, split into fields."""

    file: str
    encoding: str
    separator: str
    start: int  # FILETIME
    end: int
    meta: dict[str, list[str]]  # key to one field a column; only rows that have one for each
    groups: list[ChannelGroup]
    decimal: str  # comma or point
    rows: list[list[str]]
    number: NDArray[np.int64]  # (N,) line number of each row
    findings: tuple[Finding, ...] = ()

    def wrong(self, row: int, what: str) -> LogError:
        """The error about one of `rows`."""
        return LogError(f"{self.file}:{self.number[row]}: {what} Export it again.")

    @property
    def names(self) -> list[str]:
        """Names of the channels; not unique."""
        names = self.meta["Name"]
        return [name for group in self.groups for name in names[group.start + 1 : group.stop]]


def read_export(path: Path, file: str) -> Export:
    """The parts of a file.

    Raises LogError if it is no export, or its parts do not fit each other.
    """
    text = read_text(path, file)
    lines = text.lines
    separator = lines[0][4:5]
    if not lines[0].startswith("Name") or separator not in {*SEPARATORS, " "}:
        raise LogError(
            f"{file}:{text.number[0]}: no TwinCAT Scope export: the first line does not begin with "
            "`Name` and a separator. Export it as CSV from the Scope, or name the dialect of this "
            "file."
        )
    if separator == " ":
        raise LogError(
            f"{file}: fields are separated by blanks, as are the words in them. Export again with "
            "tabs."
        )
    named = (i for i in range(1, len(lines)) if lines[i].startswith("Name" + separator))
    if (head := next(named, None)) is None:
        raise LogError(
            f"{file}: no line with the names of the channels (`Name`, name, ...) below the "
            "preamble. Export it again with them."
        )
    for line, number in zip(lines[:head], text.number, strict=False):
        if _is_data(line.split(separator)[0]):
            raise LogError(
                f"{file}:{number}: a row of data stands in the preamble. The file is damaged. "
                "Export it again."
            )
    firsts = [line.split(separator)[0] for line in lines[head:]]
    body = head + next((i for i, cell in enumerate(firsts) if _is_data(cell)), len(firsts))
    meta, groups = _metadata(lines[head:body], separator, f"{file}:{text.number[head]}")
    start, end = (_filetime(lines[:head], key, separator, file) for key in ("Starttime", "Endtime"))
    number, data = text.number[body:], lines[body:]
    if "EOF" in data[:-1]:
        raise LogError(
            f"{file}:{number[data.index('EOF')]}: `EOF` stands here, and lines follow. Two exports "
            "in one file? Split it."
        )
    rows = [line.split(separator) for line in data if line != "EOF"]
    if not rows:
        raise LogError(f"{file}: metadata but no data below them. Export it again with the data.")
    number = number[: len(rows)]
    return Export(
        file=file,
        encoding=text.encoding,
        separator=separator,
        start=start,
        end=end,
        meta=meta,
        groups=groups,
        decimal=_decimal(rows, number, file),
        rows=rows,
        number=number,
        # Blank lines part preamble, metadata and data.
        findings=tuple(entry for entry in text.findings if entry.kind != "blank line"),
    )


def _is_data(cell: str) -> bool:
    return cell.isspace() or FLOAT.fullmatch(cell.replace(",", ".")) is not None


def _filetime(preamble: list[str], key: str, separator: str, file: str) -> int:
    for line in preamble:
        cells = line.split(separator)
        if cells[0].startswith(key) and len(cells) > 1:
            stamp = cells[1]
            digits = INTEGER.fullmatch(stamp) and len(stamp) == len(str(_FILETIMES.start))
            if digits and int(stamp) in _FILETIMES:
                return int(stamp)
            raise LogError(
                f"{file}: {cells[0]}: {stamp[:30]!r} is no FILETIME (18 digits). Export it again."
            )
    raise LogError(
        f"{file}: the preamble has no line `{key} of export`. Export it again with its preamble."
    )


def _metadata(
    lines: list[str], separator: str, location: str
) -> tuple[dict[str, list[str]], list[ChannelGroup]]:
    """Metadata by key, and the groups of columns, on which all lines must agree."""
    names = lines[0].split(separator)
    width = len(names) - (names[-1] == "")
    meta: dict[str, list[str]] = {}
    for line in lines:
        cells = line.split(separator)
        if cells[0] in meta:
            raise LogError(
                f"{location}: the line {cells[0]!r} of the metadata stands twice. Export it again."
            )
        if cells[width:] in ([], [""]) and len(cells) >= width:
            meta[cells[0]] = cells[:width]
        elif cells[0] not in _MAY_DIFFER:
            raise LogError(
                f"{location}: the line {cells[0][:30]!r} of the metadata has {len(cells)} fields, "
                f"`Name` has {width}. Export it again."
            )
    if "Data-Type" not in meta:
        raise LogError(
            f"{location}: the metadata have no line `Data-Type` with a field for each column of "
            "`Name`. Export it again with it."
        )
    starts = [i for i, cell in enumerate(meta["Data-Type"]) if cell == "Data-Type"]
    for key, cells in meta.items():
        keys = [i for i, cell in enumerate(cells) if cell == key]
        if not set(starts) <= set(keys) or (keys != starts and key not in _FREE_TEXT):
            raise LogError(
                f"{location}: the lines `Data-Type` and {key!r} do not agree on which columns are "
                "times. The file is damaged. Export it again."
            )
    groups = [
        ChannelGroup(start, stop) for start, stop in zip(starts, [*starts[1:], width], strict=True)
    ]
    if any(group.stop - group.start < 2 for group in groups):
        raise LogError(f"{location}: a time column without a channel. Export it again.")
    return meta, groups


def _decimal(rows: list[list[str]], number: NDArray[np.int64], file: str) -> str:
    """`comma` or `point`, the same in all data; number (N,) is the line of each row.

    Raises LogError if both stand there.
    """
    commas, points = (
        next((i for i, row in enumerate(rows) if any(mark in cell for cell in row)), None)
        for mark in ",."
    )
    if commas is not None and points is not None:
        raise LogError(
            f"{file}:{number[max(commas, points)]}: decimal commas and decimal points in one file. "
            "Export it again."
        )
    return "comma" if commas is not None else "point"
