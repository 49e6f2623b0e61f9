"""TwinCAT Scope exports (CSV or TXT) as a table: the wanted channels at the times they share.

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
from functools import reduce
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.formats.columns import DAMAGED_LIMIT, one_file, wanted_columns
from ballbar.acquisition.report import Finding, finding
from ballbar.acquisition.table.header import Kind, Layout, Remedies
from ballbar.acquisition.table.table import Form, Table, text_table
from ballbar.acquisition.table.text import LogText, read_text
from ballbar.acquisition.times import FILETIME_1970, Stamps, TimeCells, stamps_ns
from ballbar.cell.errors import LogError

_SEPARATORS = {"\t": "tab", ":": "colon", ";": "semicolon", ",": "comma"}
_SAMPLE_TIME = "SampleTime[ms]"
_FLOAT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_FILETIMES = range(10**17, 2 * 10**17)  # [100 ns since 1601] the years 1917 to 2234
_LONGEST = 2**51  # [ns] 26 days, longer than any recording
_FREE_TEXT = {"Name", "SymbolComment"}  # a channel may be called as the key is
# 0,2 ms with comma separator has a field too many, empty comments one too few.
_MAY_DIFFER = {_SAMPLE_TIME, "SymbolComment"}
_INTEGERS = {"BIT": (0, 1)} | {
    f"{sign}INT{bits}": ((0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1))
    for sign in ("", "U")
    for bits in (8, 16, 32, 64)
}
_UNSCALED = {"Offset": 0.0, "ScaleFactor": 1.0, "Unit ScaleFactor": 1.0, "Unit Offset": 0.0}
_AGAIN = Remedies(damaged="Export it again.")


@dataclass(frozen=True, eq=False)
class _Export:
    """An export, split into fields."""

    text: LogText
    separator: str
    start: int  # [ns] since 1970
    end: int  # [ns]
    meta: dict[str, list[str]]  # key to one field a column; only rows that have one for each
    groups: list[range]  # positions of a time column and of the channels behind it
    rows: list[list[str]]
    number: NDArray[np.int64]  # (N,) line number of each row

    @property
    def channels(self) -> list[tuple[str, int]]:
        """Name and position of each channel; the names are not unique."""
        return [(self.meta["Name"][k], k) for group in self.groups for k in group[1:]]


def read_scope(path: Path, file: str, time: str, layout: Layout) -> tuple[Table, Form]:
    """The wanted channels of an export as one table, at the times at which all have a value.

    time : name that the time column gets, [ns] since 1970.
    Raises LogError if channels are missing, stand twice or are counters that were scaled, or the
    file is damaged.
    """
    export = _read_export(read_text(path, file))
    names = [name for name, _ in export.channels]
    wanted = wanted_columns(layout, time, names, file)
    for name in wanted:
        if (count := names.count(name)) > 1:
            what = f"{count} channels are called {name!r}."
            raise LogError.at(file, what, "Rename them in the Scope.")
    positions = {name: k for name, k in export.channels if name in wanted}
    present, findings = _present(export)
    # Blank lines part preamble, metadata and data.
    findings = [entry for entry in export.text.findings if entry.kind != "blank line"] + findings
    parts, decimal = list[Table](), "point"
    for group, rows in zip(export.groups, present, strict=True):
        own = {name: k for name, k in positions.items() if k in group}
        if own:
            kinds: dict[str, Kind] = {time: "text", **{name: wanted[name] for name in own}}
            table, form = _group_table(export, kinds, [group.start, *own.values()], rows)
            findings += _grid_findings(export, group[1], table, time)
            parts.append(table)
            decimal = form.decimal
    findings += _end_findings(export, [part.columns[time] for part in parts])
    for name, position in positions.items():
        findings += _scaling_findings(export, position, wanted[name])
    common = reduce(np.intersect1d, [part.columns[time] for part in parts])
    if not common.size:
        what = f"the channels {', '.join(wanted)} have no common times."
        raise LogError.at(file, what, "Record them with one sample time.")
    if missing := max(map(len, parts)) - common.size:
        sentence = f"{missing} times at which not every channel has a value; left out."
        findings.append(finding("channels of different length", file, sentence, count=missing))
    parts = [part.take(np.searchsorted(part.columns[time], common)) for part in parts]
    signals = {name: values for part in parts for name, values in part.columns.items()}
    columns = {time: common, **{name: signals[name] for name in wanted}}
    form = Form(export.text.encoding, _SEPARATORS[export.separator], decimal, len(export.rows))
    return one_file(columns, file, parts[0].line, findings), form


def _group_table(
    export: _Export, kinds: dict[str, Kind], positions: list[int], rows: NDArray[np.intp]
) -> tuple[Table, Form]:
    """The columns of a time, named first in `kinds`, and of channels behind it in some rows."""
    text, (time, *names) = export.text, kinds
    if not rows.size:
        wrong = f"no value of {names[0]!r}."
        raise LogError.at(text.file, wrong, "Record it in the Scope, and export again.")
    lines = ["\t".join(export.rows[k][p].strip() for p in positions) for k in rows]
    number = np.concatenate(([0], export.number[rows]))
    plain = LogText(text.file, text.encoding, ["\t".join(kinds), *lines], number, quoted=False)
    table, form = text_table(plain, Layout(("\t",), kinds, remedies=_AGAIN))
    stamps = TimeCells(text.file, time, table.columns[time], table.line)
    table.columns[time] = _times(export, stamps)
    for name, position in zip(names, positions[1:], strict=True):
        data_type, values = export.meta["Data-Type"][position], table.columns[name]
        lower, upper = _INTEGERS.get(data_type, (-np.inf, np.inf))
        outside = np.flatnonzero((values < lower) | (values > upper))
        if kinds[name] == "integer" and outside.size:
            what = f"channel {name!r}: {values[outside[0]]} is no {data_type}."
            raise _wrong(text.file, table.line[outside[0]], what)
    return table, form


def _times(export: _Export, cells: TimeCells) -> Stamps:
    """(N,) [ns] since 1970, strictly increasing, of the cells of a time column."""
    values = np.asarray(cells.cells)
    if values.dtype == np.int64 and (values >= _FILETIMES.start).all():
        ns = (values - FILETIME_1970) * 100
    else:
        ns = stamps_ns(cells, "ms")[0]
        if (far := np.flatnonzero(np.abs(ns) > _LONGEST)).size:
            raise _wrong(cells.location(far[0]), None, "a recording has at most 26 days.")
        ns = ns + export.start
    back = np.flatnonzero(np.diff(ns) <= 0)
    if back.size:
        before = str(cells.cells[back[0]])
        raise LogError(
            f"{cells.location(back[0] + 1)} does not lie behind {before!r}. Two exports in one "
            "file? Split it."
        )
    return ns


def _filled(export: _Export, ends: set[int]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(N, G) whether each group of a row has all its values, and (N,) whether the row is torn.

    ends : the widths that a row may have.
    """
    present = np.zeros((len(export.rows), len(export.groups)), dtype=bool)
    torn = np.zeros(len(export.rows), dtype=bool)
    for i, row in enumerate(export.rows):
        width = len(row) - (len(row) - 1 in ends and not row[-1].strip())
        if width not in ends:
            torn[i] = True
            continue
        for j, group in enumerate(export.groups):
            filled = sum(bool(cell.strip()) for cell in row[group.start : group.stop])
            present[i, j] = filled == len(group)
            torn[i] |= 0 < filled < len(group)
    return present, torn


def _present(export: _Export) -> tuple[list[NDArray[np.intp]], list[Finding]]:
    """Rows in which each group has values, without torn ones, and a finding about these.

    In a torn row a group is half there, or back after it had ended.
    Raises LogError where more than DAMAGED_LIMIT of the rows are torn.
    """
    count, ends = len(export.rows), {group.stop for group in export.groups}
    present, torn = _filled(export, ends)
    for column in present.T:
        if (valued := np.flatnonzero(column)).size:
            torn[: valued[-1]] |= ~column[: valued[-1]]
    lines, findings = export.number[torn], list[Finding]()
    if lines.size > max(1.0, DAMAGED_LIMIT * count):
        commas = " Decimal commas with comma separators? Export again with tabs."
        fields = f"expected {max(ends)} fields, got {len(export.rows[int(torn.argmax())])}."
        what = f"{lines.size} of {count} rows do not fit the groups of columns: {fields}"
        what += commas if export.separator == "," else ""
        raise _wrong(export.text.file, lines[0], what)
    if lines.size:
        sentence = "the fields do not fit the groups of columns; treated as torn line and dropped."
        findings.append(finding("torn line", export.text.file, sentence, lines=lines))
    return [np.flatnonzero(column & ~torn) for column in present.T], findings


def _grid_findings(export: _Export, position: int, table: Table, time: str) -> list[Finding]:
    """A finding about times that are off the sample time declared for a channel."""
    if _SAMPLE_TIME not in export.meta:
        return []
    cell, file = export.meta[_SAMPLE_TIME][position].replace(",", "."), export.text.file
    step = round(float(cell) * 1e6) if _FLOAT.fullmatch(cell) else 0
    if not 0 < step < 2**62:
        name = export.meta["Name"][position]
        raise _wrong(file, None, f"{_SAMPLE_TIME} {cell!r} of {name!r} is no time.")
    late = np.flatnonzero(np.diff(table.columns[time]) != step) + 1
    if not late.size:
        return []
    sentence = f"times do not follow at {cell} ms: rows are missing, or a time is damaged."
    return [finding("off the sample time", file, sentence, lines=table.line[late])]


def _end_findings(export: _Export, times: list[Stamps]) -> list[Finding]:
    """A finding about an export whose rows do not reach the end that its preamble states."""
    last = max(int(stamps[-1]) for stamps in times)
    if abs(last - export.end) <= max(int(np.diff(stamps).max(initial=1)) for stamps in times):
        return []
    last, end = last - export.start, export.end - export.start
    sentence = f"the last row is at {last / 1e9:.9g} s, the end of the export at {end / 1e9:.9g} s."
    return [finding("end of export", export.text.file, sentence, count=1)]


def _scaling_findings(export: _Export, position: int, kind: str) -> list[Finding]:
    """Findings about a channel that was scaled, or may have been.

    Raises LogError for a counter that is no whole number as the PLC has it.
    """
    meta, file = export.meta, export.text.file
    name, data_type = meta["Name"][position], meta["Data-Type"][position]
    present = [key for key in _UNSCALED if key in meta]
    scaled = not all(_is_number(meta[key][position], _UNSCALED[key]) for key in present)
    if kind == "integer" and (scaled or data_type not in _INTEGERS):
        why = "scaled in the Scope (offset, scale factor or unit)" if scaled else data_type
        what = f"channel {name!r} is {why}; a counter must be a whole number as the PLC has it."
        raise LogError.at(file, what, "Record it so in the Scope.")
    if unknown := [key for key in _UNSCALED if key not in meta]:
        sentence = f"no line {', '.join(unknown)}: whether {name!r} was scaled is unknown."
        return [finding("scaling unknown", file, sentence, count=1)]
    if not scaled:
        return []
    sentence = f"{name!r} has an offset or scale factor in the Scope; read as it stands."
    return [finding("scaled channel", file, sentence, count=1)]


def _read_export(text: LogText) -> _Export:
    """The parts of a file. Raises LogError if it is no export, or its parts do not fit."""
    lines, file, number = text.lines, text.file, text.number
    separator = lines[0][4:5]
    if not lines[0].startswith("Name") or separator not in {*_SEPARATORS, " "}:
        raise LogError(
            f"{file}:{number[0]}: no TwinCAT Scope export, which begins with `Name` and a "
            "separator. Export it as CSV from the Scope, or name the dialect of this file."
        )
    if separator == " ":
        raise LogError(f"{file}: fields are separated by blanks. Export again with tabs.")
    firsts = [line.split(separator)[0] for line in lines]
    head = next((i for i in range(1, len(lines)) if firsts[i] == "Name"), None)
    if head is None:
        raise _wrong(file, None, "no line with the names of the channels below the preamble.")
    data = [cell.isspace() or _is_number(cell) for cell in firsts]
    if True in data[:head]:
        row = data.index(True)
        raise _wrong(file, number[row], "a row of data stands in the preamble.")
    body = data.index(True) if True in data else len(lines)
    meta, groups = _metadata(lines[head:body], separator, f"{file}:{number[head]}")
    start, end = (_filetime(lines[:head], key, separator, file) for key in ("Starttime", "Endtime"))
    if "EOF" in lines[body:-1]:
        row = body + lines[body:].index("EOF")
        what = "`EOF` stands here, and lines follow. Two exports in one file?"
        raise LogError.at(f"{file}:{number[row]}", what, "Split it.")
    rows = [line.split(separator) for line in lines[body:] if line != "EOF"]
    if not rows:
        raise _wrong(file, None, "metadata but no data below them.")
    number = number[body : body + len(rows)]
    marked = [[i for i, row in enumerate(rows) if mark in "".join(row)] for mark in ",."]
    if all(marked):
        row = max(marked[0][0], marked[1][0])
        raise _wrong(file, number[row], "decimal commas and decimal points in one file.")
    return _Export(
        text, separator, start=start, end=end, meta=meta, groups=groups, rows=rows, number=number
    )


def _filetime(preamble: list[str], key: str, separator: str, file: str) -> int:
    """[ns] since 1970 of a line of the preamble."""
    cells = next((line.split(separator) for line in preamble if line.startswith(key)), [key])
    stamp = cells[1] if len(cells) > 1 else ""
    if not (stamp.isdecimal() and stamp.isascii() and int(stamp) in _FILETIMES):
        what = f"{cells[0]}: {stamp[:30]!r} in the preamble is no FILETIME (18 digits)."
        raise _wrong(file, None, what)
    return (int(stamp) - FILETIME_1970) * 100


def _metadata(
    lines: list[str], separator: str, location: str
) -> tuple[dict[str, list[str]], list[range]]:
    """Metadata by key, and the groups of columns, on which all lines must agree."""
    names = lines[0].split(separator)
    width = len(names) - (names[-1] == "")
    meta: dict[str, list[str]] = {}
    for line in lines:
        cells = line.split(separator)
        what = f"the line {cells[0][:30]!r} of the metadata"
        if cells[0] in meta:
            raise _wrong(location, None, f"{what} stands twice.")
        if cells[width:] in ([], [""]) and len(cells) >= width:
            meta[cells[0]] = cells[:width]
        elif cells[0] not in _MAY_DIFFER:
            raise _wrong(location, None, f"{what} has {len(cells)} fields, `Name` has {width}.")
    if "Data-Type" not in meta:
        what = "the metadata have no line `Data-Type` with a field for each column of `Name`."
        raise _wrong(location, None, what)
    starts = [i for i, cell in enumerate(meta["Data-Type"]) if cell == "Data-Type"]
    for key, cells in meta.items():
        keys = [i for i, cell in enumerate(cells) if cell == key]
        if not set(starts) <= set(keys) or (keys != starts and key not in _FREE_TEXT):
            what = f"the lines `Data-Type` and {key!r} do not agree on which columns are times."
            raise _wrong(location, None, what)
    groups = [range(*ends) for ends in zip(starts, [*starts[1:], width], strict=True)]
    if any(len(group) < 2 for group in groups):
        raise _wrong(location, None, "a time column without a channel.")
    return meta, groups


def _is_number(cell: str, value: float | None = None) -> bool:
    """Whether a field is a number, or that value, with a decimal point or comma."""
    text = cell.replace(",", ".")
    return _FLOAT.fullmatch(text) is not None and value in (None, float(text))


def _wrong(place: str, line: int | None, what: str) -> LogError:
    """The error about a damaged export; place : the file, with what stands before `what`."""
    return LogError(f"{place}{'' if line is None else f':{line}'}: {what} Export it again.")
