"""TwinCAT Scope exports (CSV or TXT): channels with a time column for each or for groups of them.

    Name<TAB>project                                       preamble; the separator is the character behind the first word
    Starttime of export<TAB>132959733843760000<TAB>...     FILETIME: 100 ns since 1601, UTC; what follows is local and localised
    Endtime of export<TAB>...

    Name<TAB>b1<TAB>b2<TAB>Name<TAB>fast                   one key a group, in the place of the group's time column
    Data-Type<TAB>UINT32<TAB>UINT32<TAB>Data-Type<TAB>REAL32
    ...
                                                           data: a time [ms from the start, or FILETIME] and the values of each group
A group that ends early is padded with blanks, or the rows get shorter. Whether offset and scale factor have been applied to
the values is an option of the export that the file does not show: a counter that has any is refused. Metadata follow the
decimal mark of Windows, data the one of the export.
Source: exports of TwinCAT 3 Scope 3.4.3145.3 among the test data of pytcs.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.layout import Layout
from acquisition.report import Finding, finding
from acquisition.stored import DAMAGED_LIMIT, one_file, wanted_columns
from acquisition.table import Form, Table
from acquisition.text import LogText, read_text
from cell.errors import LogError

_SEPARATORS = {"\t": "tab", ":": "colon", ";": "semicolon", ",": "comma"}
_UNIX = 116_444_736_000_000_000  # [100 ns] FILETIME of 1970
_FILETIMES = range(10**17, 2 * 10**17)  # the years 1917 to 2234; milliseconds from the start are never as many
_LONGEST_MS = 2**51 // 10**6  # [ms] 26 days: up to there a float of milliseconds rounds to the right nanosecond
_INTEGERS = {"BIT": (0, 1)} | {
    f"{sign}INT{bits}": ((0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1))
    for sign in ("", "U")
    for bits in (8, 16, 32, 64)
}
_FREE_TEXT = {"Name", "SymbolComment"}  # a channel may be called as the key is
_SAMPLE_TIME = "SampleTime[ms]"
_MAY_DIFFER = {_SAMPLE_TIME, "SymbolComment"}  # 0,2 ms with comma separator has a field too many, empty comments one too few
_UNSCALED = {"Offset": 0.0, "ScaleFactor": 1.0, "Unit ScaleFactor": 1.0, "Unit Offset": 0.0}
_INTEGER = re.compile(r"[+-]?[0-9]+")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel of an export."""

    name: str
    data_type: str
    scaled: bool  # has an offset or a scale factor, applied to the values or not
    time_ns: NDArray[np.int64]  # (N,) [ns] since 1970, UTC
    values: NDArray[Any]  # (N,) whole numbers exact: int64, or uint64 where needed; else float64
    line: NDArray[np.int64]  # (N,) line number, counted from 1


@dataclass(frozen=True)
class _Group:
    """A time column and the channels that follow it."""

    start: int  # position of the time column
    stop: int  # behind the last channel


@dataclass(frozen=True, eq=False)
class _Export:
    """An export, split into fields."""

    file: str
    separator: str
    start: int  # FILETIME
    end: int
    meta: dict[str, list[str]]  # key to one field a column; only rows that have one for each
    groups: list[_Group]
    decimal: str  # comma or point
    rows: list[list[str]]
    number: NDArray[np.int64]  # line number of each row

    @property
    def names(self) -> list[str]:
        return [name for group in self.groups for name in self.meta["Name"][group.start + 1 : group.stop]]


def read_scope(path: Path, file: str, time: str, layout: Layout, findings: list[Finding]) -> tuple[Table, Form]:
    """The wanted channels of an export as one table: the rows at whose times all of them have a value.

    time : name that the time column gets, [ns] since 1970.
    Raises LogError if channels are missing, stand twice or are counters that were scaled, or the file is damaged.
    """
    text, export = _export(path, file, findings)
    wanted = wanted_columns(layout, time, export.names, file)
    for name in wanted:
        if export.names.count(name) > 1:
            raise LogError(f"{file}: {export.names.count(name)} channels are called {name!r}. Rename them in the Scope.")
    channels = _channels(export, findings, only=tuple(wanted))
    _check_end(export, channels, findings)
    unknown = [key for key in _UNSCALED if key not in export.meta]
    if unknown:
        sentence = f"no line {', '.join(unknown)} in the metadata: whether a channel was scaled is unknown."
        findings.append(finding("scaling unknown", "warning", file, sentence, count=1))
    for channel in channels:
        _check_kind(file, channel, wanted[channel.name], findings)
    first, common = channels[0], channels[0].time_ns
    for channel in channels[1:]:
        common = np.intersect1d(common, channel.time_ns)
    if not common.size:
        raise LogError(f"{file}: the channels {', '.join(wanted)} have no common times. Record them with one sample time.")
    densest = max(channel.time_ns.size for channel in channels)
    if common.size < densest:
        sentence = f"{densest - common.size} times at which not every channel has a value; left out."
        findings.append(finding("channels of different length", "repaired", file, sentence, count=densest - common.size))
    columns: dict[str, NDArray[Any]] = {time: common}
    for channel in channels:
        kind = np.int64 if wanted[channel.name] == "integer" else np.float64
        columns[channel.name] = channel.values[np.searchsorted(channel.time_ns, common)].astype(kind)
    form = Form(text.encoding, _SEPARATORS[export.separator], export.decimal, len(export.rows))
    return one_file(columns, file, first.line[np.searchsorted(first.time_ns, common)]), form


def read_channels(path: Path, file: str, findings: list[Finding]) -> list[Channel]:
    """All channels of an export in the file's order, names not unique, each with its own times."""
    return _channels(_export(path, file, findings)[1], findings)


def _export(path: Path, file: str, findings: list[Finding]) -> tuple[LogText, _Export]:
    told: list[Finding] = []
    text = read_text(path, file, told)
    findings += [one for one in told if one.kind != "blank line"]  # blank lines part preamble, metadata and data
    lines = text.lines
    separator = lines[0][4:5]
    if not lines[0].startswith("Name") or separator not in {*_SEPARATORS, " "}:
        raise LogError(f"{file}:{text.number[0]}: no TwinCAT Scope export: the first line does not begin with `Name` and a separator.")
    if separator == " ":
        raise LogError(f"{file}: fields are separated by blanks, as are the words in them. Export again with tabs.")
    head = next((i for i in range(1, len(lines)) if lines[i].startswith("Name" + separator)), None)
    if head is None:
        raise LogError(f"{file}: no line with the names of the channels (`Name`, name, ...) below the preamble.")
    body = next((i for i in range(head, len(lines)) if _is_data(lines[i].split(separator)[0])), len(lines))
    meta, groups = _metadata(lines[head:body], separator, f"{file}:{text.number[head]}")
    start, end = (_filetime(lines[:head], key, separator, file) for key in ("Starttime", "Endtime"))
    rows, number = _rows(lines[body:], text.number[body:], separator, file)
    return text, _Export(file, separator, start, end, meta, groups, _decimal(rows, number, file), rows, number)


def _is_data(cell: str) -> bool:
    return cell.isspace() or _FLOAT.fullmatch(cell.replace(",", ".")) is not None


def _filetime(preamble: list[str], key: str, separator: str, file: str) -> int:
    for line in preamble:
        cells = line.split(separator)
        if cells[0].startswith(key) and len(cells) > 1:
            if _INTEGER.fullmatch(cells[1]) and len(cells[1]) == len(str(_FILETIMES.start)) and int(cells[1]) in _FILETIMES:
                return int(cells[1])
            raise LogError(f"{file}: {cells[0]}: {cells[1][:30]!r} is no FILETIME (18 digits).")
    raise LogError(f"{file}: the preamble has no line `{key} of export`.")


def _metadata(lines: list[str], separator: str, place: str) -> tuple[dict[str, list[str]], list[_Group]]:
    """Metadata by key, and the groups of columns, on which all lines must agree."""
    names = lines[0].split(separator)
    width = len(names) - (names[-1] == "")
    meta: dict[str, list[str]] = {}
    for line in lines:
        cells = line.split(separator)
        if cells[0] in meta:
            raise LogError(f"{place}: the line {cells[0]!r} of the metadata stands twice.")
        if cells[width:] in ([], [""]) and len(cells) >= width:
            meta[cells[0]] = cells[:width]
        elif cells[0] not in _MAY_DIFFER:
            raise LogError(f"{place}: the line {cells[0][:30]!r} of the metadata has {len(cells)} fields, `Name` has {width}.")
    if "Data-Type" not in meta:
        raise LogError(f"{place}: the metadata have no line `Data-Type` with a field for each column of `Name`.")
    starts = [i for i, cell in enumerate(meta["Data-Type"]) if cell == "Data-Type"]
    for key, cells in meta.items():
        here = [i for i, cell in enumerate(cells) if cell == key]
        if not set(starts) <= set(here) or (here != starts and key not in _FREE_TEXT):
            raise LogError(f"{place}: the lines `Data-Type` and {key!r} do not agree on which columns are times. The file is damaged.")
    groups = [_Group(start, stop) for start, stop in zip(starts, [*starts[1:], width], strict=True)]
    if any(group.stop - group.start < 2 for group in groups):
        raise LogError(f"{place}: a time column without a channel.")
    return meta, groups


def _rows(lines: list[str], number: NDArray[np.int64], separator: str, file: str) -> tuple[list[list[str]], NDArray[np.int64]]:
    if "EOF" in lines[:-1]:
        raise LogError(f"{file}:{number[lines.index('EOF')]}: `EOF` stands here, and lines follow. Two exports in one file? Split it.")
    rows = [line.split(separator) for line in lines if line != "EOF"]
    if not rows:
        raise LogError(f"{file}: metadata but no data below them.")
    return rows, number[: len(rows)]


def _channels(export: _Export, findings: list[Finding], only: tuple[str, ...] | None = None) -> list[Channel]:
    present, torn = _present(export)
    if torn.size > max(1.0, DAMAGED_LIMIT * len(export.rows)):
        row = export.rows[int(torn[0])]
        usual = " Decimal commas with comma separators? Export again with tabs." if export.separator == "," else ""
        raise LogError(
            f"{export.file}:{export.number[torn[0]]}: {torn.size} of {len(export.rows)} rows do not fit the groups of columns: "
            f"expected {export.groups[-1].stop} fields, got {len(row)}.{usual}"
        )
    if torn.size:
        sentence = "the fields do not fit the groups of columns; treated as torn line and dropped."
        findings.append(finding("torn line", "repaired", export.file, sentence, lines=export.number[torn]))
    comma = export.decimal == "comma"
    channels = []
    for group, rows in zip(export.groups, present, strict=True):
        names = export.meta["Name"][group.start + 1 : group.stop]
        if only is not None and not set(names) & set(only):
            continue
        if not rows.size:
            raise LogError(f"{export.file}: no value of {names[0]!r}.")
        line = export.number[rows]
        time_ns = _times(export, _cells(export, rows, group.start, comma=comma), line)
        _check_grid(export, group, time_ns, line, findings)
        for position, name in enumerate(names, group.start + 1):
            if only is None or name in only:
                data_type = export.meta["Data-Type"][position]
                values = _values(export, _cells(export, rows, position, comma=comma), line, name, data_type, _scaled(export, position))
                channels.append(Channel(name, data_type, _scaled(export, position), time_ns, values, line))
    return channels


def _present(export: _Export) -> tuple[list[NDArray[np.int64]], NDArray[np.int64]]:
    """Rows in which each group has values, and the rows that are torn: a group half there, or back after it had ended."""
    count = len(export.rows)
    there = np.zeros((count, len(export.groups)), dtype=bool)
    torn = np.zeros(count, dtype=bool)
    ends = {group.stop for group in export.groups}
    for i, row in enumerate(export.rows):
        width = len(row) - (len(row) - 1 in ends and not row[-1].strip())
        if width not in ends:
            torn[i] = True
            continue
        for j, group in enumerate(export.groups):
            filled = sum(bool(cell.strip()) for cell in row[group.start : group.stop])
            there[i, j] = filled == group.stop - group.start
            torn[i] |= 0 < filled < group.stop - group.start
    for j in range(len(export.groups)):
        last = np.flatnonzero(there[:, j])
        if last.size:
            torn[: last[-1]] |= ~there[: last[-1], j]
    return [np.flatnonzero(there[:, j] & ~torn) for j in range(len(export.groups))], np.flatnonzero(torn)


def _cells(export: _Export, rows: NDArray[np.int64], position: int, *, comma: bool) -> list[str]:
    cells = [export.rows[i][position].strip() for i in rows]
    return [cell.replace(",", ".") for cell in cells] if comma else cells


def _decimal(rows: list[list[str]], number: NDArray[np.int64], file: str) -> str:
    """`comma` or `point`, the same in all data.

    Raises LogError if both stand there.
    """
    commas, points = (next((i for i, row in enumerate(rows) if any(mark in cell for cell in row)), None) for mark in ",.")
    if commas is not None and points is not None:
        raise LogError(f"{file}:{number[max(commas, points)]}: decimal commas and decimal points in one file. Export it again.")
    return "comma" if commas is not None else "point"


def _times(export: _Export, cells: list[str], line: NDArray[np.int64]) -> NDArray[np.int64]:
    """[ns] since 1970; strictly increasing."""
    start_ns = (export.start - _UNIX) * 100
    if _all(_INTEGER, cells) and all(len(cell) == 18 for cell in cells):
        time_ns = (np.array([int(cell) for cell in cells], dtype=np.int64) - _UNIX) * 100
    else:
        milliseconds = _floats(export, cells, line, "time")
        far = np.flatnonzero(np.abs(milliseconds) > _LONGEST_MS)
        if far.size:
            raise LogError(f"{export.file}:{line[far[0]]}: time {cells[far[0]]!r}: a recording has at most {_LONGEST_MS} ms.")
        time_ns = np.rint(milliseconds * 1e6).astype(np.int64) + start_ns
    back = np.flatnonzero(np.diff(time_ns) <= 0)
    if back.size:
        raise LogError(f"{export.file}:{line[back[0] + 1]}: time {cells[back[0] + 1]!r} does not lie behind {cells[back[0]]!r}.")
    return time_ns


def _check_grid(export: _Export, group: _Group, time_ns: NDArray[np.int64], line: NDArray[np.int64], findings: list[Finding]) -> None:
    """Times off the declared sample time are appended to `findings`."""
    if _SAMPLE_TIME not in export.meta:
        return
    cell = export.meta[_SAMPLE_TIME][group.start + 1].replace(",", ".")
    step = round(float(cell) * 1e6) if _FLOAT.fullmatch(cell) else 0
    if not 0 < step < 2**62:
        raise LogError(f"{export.file}: {_SAMPLE_TIME} {cell!r} of {export.meta['Name'][group.start + 1]!r} is no time.")
    late = np.flatnonzero(np.diff(time_ns) != step) + 1
    if late.size:
        sentence = f"times do not follow at the sample time of {cell} ms: rows are missing, or a time is damaged."
        findings.append(finding("off the sample time", "warning", export.file, sentence, lines=line[late]))


def _check_end(export: _Export, channels: list[Channel], findings: list[Finding]) -> None:
    """An export whose rows do not reach the end that its preamble states is appended to `findings`."""
    span = (export.end - export.start) * 100
    last = max(int(channel.time_ns[-1]) for channel in channels) - (export.start - _UNIX) * 100
    step = max(int(np.diff(channel.time_ns).max(initial=1)) for channel in channels)
    if abs(last - span) > step:
        sentence = f"the last row is at {last / 1e9:.9g} s, the preamble ends the export at {span / 1e9:.9g} s. Is the file cut?"
        findings.append(finding("end of export", "warning", export.file, sentence, count=1))


def _check_kind(file: str, channel: Channel, kind: str, findings: list[Finding]) -> None:
    if kind == "integer" and (channel.scaled or channel.data_type not in _INTEGERS or channel.values.dtype != np.int64):
        why = "scaled in the Scope (offset, scale factor or unit)" if channel.scaled else channel.data_type
        raise LogError(f"{file}: channel {channel.name!r} is {why}; a counter must be a whole number as the PLC has it.")
    if kind == "float" and channel.scaled:
        sentence = f"{channel.name!r} has an offset or scale factor in the Scope; the values are read as they stand."
        findings.append(finding("scaled channel", "warning", file, sentence, count=1))


def _scaled(export: _Export, position: int) -> bool:
    for key, neutral in _UNSCALED.items():
        cell = export.meta.get(key, [])
        text = cell[position].replace(",", ".") if cell else str(neutral)
        if not _FLOAT.fullmatch(text) or float(text) != neutral:
            return True
    return False


def _values(export: _Export, cells: list[str], line: NDArray[np.int64], name: str, data_type: str, scaled: bool) -> NDArray[Any]:
    if data_type not in _INTEGERS or (scaled and not _all(_INTEGER, cells)):
        return _floats(export, cells, line, name)
    lower, upper = _INTEGERS[data_type] if not scaled else (-(2**63), 2**63 - 1)
    for cell, number in zip(cells, line, strict=True):
        if not (_INTEGER.fullmatch(cell) and len(cell) <= 21 and lower <= int(cell) <= upper):
            raise LogError(f"{export.file}:{number}: channel {name!r}: {cell[:30]!r} is no {data_type}.")
    whole = [int(cell) for cell in cells]
    return np.array(whole, dtype=np.uint64 if max(whole) >= 2**63 else np.int64)


def _floats(export: _Export, cells: list[str], line: NDArray[np.int64], name: str) -> NDArray[np.float64]:
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        values[i] = float(cell) if _FLOAT.fullmatch(cell) else np.nan
        if not np.isfinite(values[i]):
            raise LogError(f"{export.file}:{line[i]}: channel {name!r}: {cell[:30]!r} is not a number.")
    return values


def _all(pattern: re.Pattern[str], cells: list[str]) -> bool:
    return all(pattern.fullmatch(cell) for cell in cells)
