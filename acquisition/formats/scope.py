"""TwinCAT Scope exports as a table: the wanted channels at the times they share.

The form of the files: acquisition.formats.scope_export.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.formats.columns import DAMAGED_LIMIT, one_file, wanted_columns
from acquisition.formats.scope_export import (
    FLOAT,
    INTEGER,
    SAMPLE_TIME,
    SEPARATORS,
    ChannelGroup,
    Export,
    read_export,
)
from acquisition.report import Finding, finding
from acquisition.table.header import Layout
from acquisition.table.table import Form, Table
from cell.arrays import Array
from cell.errors import LogError

_UNIX = 116_444_736_000_000_000  # [100 ns] FILETIME of 1970
# [ms] 26 days: up to there a float of milliseconds rounds to the right nanosecond.
_LONGEST_MS = 2**51 // 10**6
_INTEGERS = {"BIT": (0, 1)} | {
    f"{sign}INT{bits}": ((0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1))
    for sign in ("", "U")
    for bits in (8, 16, 32, 64)
}
_UNSCALED = {"Offset": 0.0, "ScaleFactor": 1.0, "Unit ScaleFactor": 1.0, "Unit Offset": 0.0}


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel of an export."""

    name: str
    data_type: str
    scaled: bool  # has an offset or a scale factor, applied to the values or not
    time_ns: NDArray[np.int64]  # (N,) [ns] since 1970, UTC
    values: NDArray[Any]  # (N,) whole numbers exact: int64, or uint64 where needed; else float64
    line: NDArray[np.int64]  # (N,) line number, counted from 1


def read_scope(path: Path, file: str, time: str, layout: Layout) -> tuple[Table, Form]:
    """The wanted channels of an export as one table, at the times at which all have a value.

    time : name that the time column gets, [ns] since 1970.
    Raises LogError if channels are missing, stand twice or are counters that were scaled, or the
    file is damaged.
    """
    export = read_export(path, file)
    wanted = wanted_columns(layout, time, export.names, file)
    for name in wanted:
        if (count := export.names.count(name)) > 1:
            raise LogError(
                f"{file}: {count} channels are called {name!r}. Rename them in the Scope."
            )
    channels, findings = _channels(export, only=tuple(wanted))
    findings = [*export.findings, *findings, *_end_findings(export, channels)]
    unknown = [key for key in _UNSCALED if key not in export.meta]
    if unknown:
        sentence = (
            f"no line {', '.join(unknown)} in the metadata: whether a channel was scaled is "
            "unknown."
        )
        findings.append(finding("scaling unknown", file, sentence, count=1))
    for channel in channels:
        findings += _kind_findings(file, channel, wanted[channel.name])
    common = reduce(np.intersect1d, [channel.time_ns for channel in channels])
    if not common.size:
        raise LogError(
            f"{file}: the channels {', '.join(wanted)} have no common times. Record them with one "
            "sample time."
        )
    missing = max(channel.time_ns.size for channel in channels) - common.size
    if missing:
        kind = "channels of different length"
        sentence = f"{missing} times at which not every channel has a value; left out."
        findings.append(finding(kind, file, sentence, count=missing))
    columns: dict[str, NDArray[Any]] = {time: common}
    for channel in channels:
        dtype = np.int64 if wanted[channel.name] == "integer" else np.float64
        rows = np.searchsorted(channel.time_ns, common)
        columns[channel.name] = channel.values[rows].astype(dtype)
    line = channels[0].line[np.searchsorted(channels[0].time_ns, common)]
    form = Form(export.encoding, SEPARATORS[export.separator], export.decimal, len(export.rows))
    return one_file(columns, file, line, findings), form


def read_channels(path: Path, file: str) -> tuple[list[Channel], list[Finding]]:
    """All channels of an export in the file's order, each with its own times, and the findings.

    The names are not unique.
    """
    export = read_export(path, file)
    channels, findings = _channels(export)
    return channels, [*export.findings, *findings]


def _channels(
    export: Export, only: tuple[str, ...] | None = None
) -> tuple[list[Channel], list[Finding]]:
    present, torn = _present(export)
    if torn.size > max(1.0, DAMAGED_LIMIT * len(export.rows)):
        commas = " Decimal commas with comma separators? Export again with tabs."
        raise export.wrong(
            int(torn[0]),
            f"{torn.size} of {len(export.rows)} rows do not fit the groups of columns: expected "
            f"{export.groups[-1].stop} fields, got {len(export.rows[int(torn[0])])}."
            f"{commas if export.separator == ',' else ''}",
        )
    findings, channels = list[Finding](), list[Channel]()
    if torn.size:
        sentence = "the fields do not fit the groups of columns; treated as torn line and dropped."
        lines = export.number[torn]
        findings.append(finding("torn line", export.file, sentence, lines=lines))
    for group, rows in zip(export.groups, present, strict=True):
        names = export.meta["Name"][group.start + 1 : group.stop]
        if only is not None and not set(names) & set(only):
            continue
        if not rows.size:
            raise LogError(
                f"{export.file}: no value of {names[0]!r}. Was it recorded? "
                "Record it in the Scope, and export again."
            )
        time_ns = _times(export, _cells(export, rows, group.start), rows)
        findings += _grid_findings(export, group, time_ns, export.number[rows])
        for position, name in enumerate(names, group.start + 1):
            if only is None or name in only:
                channels.append(_channel(export, name, position, rows, time_ns))
    return channels, findings


def _channel(
    export: Export, name: str, position: int, rows: NDArray[np.int64], time_ns: NDArray[np.int64]
) -> Channel:
    """The channel in one column; rows (N,) with a value, time_ns (N,) [ns] their times."""
    data_type, cells = export.meta["Data-Type"][position], _cells(export, rows, position)
    settings = (export.meta[key][position] for key in _UNSCALED if key in export.meta)
    neutral = (value for key, value in _UNSCALED.items() if key in export.meta)
    scaled = not all(map(_is_number, settings, neutral))
    values: NDArray[Any]
    if data_type not in _INTEGERS or (scaled and not all(map(INTEGER.fullmatch, cells))):
        values = _floats(export, cells, rows, f"channel {name!r}")
    else:
        lower, upper = _INTEGERS[data_type] if not scaled else (-(2**63), 2**63 - 1)
        for cell, row in zip(cells, rows.tolist(), strict=True):
            if not (INTEGER.fullmatch(cell) and len(cell) <= 21 and lower <= int(cell) <= upper):
                raise export.wrong(row, f"channel {name!r}: {cell[:30]!r} is no {data_type}.")
        whole = [int(cell) for cell in cells]
        values = np.array(whole, dtype=np.uint64 if max(whole) >= 2**63 else np.int64)
    return Channel(name, data_type, scaled, time_ns, values, export.number[rows])


def _present(export: Export) -> tuple[list[NDArray[np.int64]], NDArray[np.int64]]:
    """Rows in which each group has values, and the rows that are torn.

    In a torn row a group is half there, or back after it had ended.
    """
    count = len(export.rows)
    present = np.zeros((count, len(export.groups)), dtype=bool)
    torn = np.zeros(count, dtype=bool)
    ends = {group.stop for group in export.groups}
    for i, row in enumerate(export.rows):
        width = len(row) - (len(row) - 1 in ends and not row[-1].strip())
        if width not in ends:
            torn[i] = True
            continue
        for j, group in enumerate(export.groups):
            filled = sum(bool(cell.strip()) for cell in row[group.start : group.stop])
            present[i, j] = filled == group.stop - group.start
            torn[i] |= 0 < filled < group.stop - group.start
    for column in present.T:
        valued = np.flatnonzero(column)
        if valued.size:
            torn[: valued[-1]] |= ~column[: valued[-1]]
    return [np.flatnonzero(column & ~torn) for column in present.T], np.flatnonzero(torn)


def _cells(export: Export, rows: NDArray[np.int64], position: int) -> list[str]:
    """The fields of one column at rows (N,), with decimal points."""
    cells = [export.rows[i][position].strip() for i in rows]
    return [cell.replace(",", ".") for cell in cells] if export.decimal == "comma" else cells


def _times(export: Export, cells: list[str], rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) [ns] since 1970, strictly increasing, of the time fields in rows (N,)."""
    start_ns = (export.start - _UNIX) * 100
    if all(map(INTEGER.fullmatch, cells)) and all(len(cell) == 18 for cell in cells):
        time_ns = (np.array([int(cell) for cell in cells], dtype=np.int64) - _UNIX) * 100
    else:
        milliseconds = _floats(export, cells, rows, "channel 'time'")
        far = np.flatnonzero(np.abs(milliseconds) > _LONGEST_MS)
        if far.size:
            what = f"time {cells[far[0]]!r}: a recording has at most {_LONGEST_MS} ms."
            raise export.wrong(rows[far[0]], what)
        time_ns = np.rint(milliseconds * 1e6).astype(np.int64) + start_ns
    back = np.flatnonzero(np.diff(time_ns) <= 0)
    if back.size:
        before, after, row = cells[back[0]], cells[back[0] + 1], rows[back[0] + 1]
        raise LogError(
            f"{export.file}:{export.number[row]}: time {after!r} does not lie behind {before!r}. "
            "Two exports in one file? Split it."
        )
    return time_ns


def _grid_findings(
    export: Export, group: ChannelGroup, time_ns: NDArray[np.int64], line: NDArray[np.int64]
) -> list[Finding]:
    """A finding about times (N,) [ns] at lines (N,) that are off the declared sample time."""
    if SAMPLE_TIME not in export.meta:
        return []
    cell = export.meta[SAMPLE_TIME][group.start + 1].replace(",", ".")
    step = round(float(cell) * 1e6) if FLOAT.fullmatch(cell) else 0
    if not 0 < step < 2**62:
        name = export.meta["Name"][group.start + 1]
        raise LogError(
            f"{export.file}: {SAMPLE_TIME} {cell!r} of {name!r} is no time. Export it again."
        )
    late = np.flatnonzero(np.diff(time_ns) != step) + 1
    if not late.size:
        return []
    sentence = (
        f"times do not follow at the sample time of {cell} ms: rows are missing, or a time is "
        "damaged."
    )
    kind = "off the sample time"
    return [finding(kind, export.file, sentence, lines=line[late])]


def _end_findings(export: Export, channels: list[Channel]) -> list[Finding]:
    """A finding about an export whose rows do not reach the end that its preamble states."""
    span = (export.end - export.start) * 100
    last = max(int(channel.time_ns[-1]) for channel in channels) - (export.start - _UNIX) * 100
    step = max(int(np.diff(channel.time_ns).max(initial=1)) for channel in channels)
    if abs(last - span) <= step:
        return []
    sentence = (
        f"the last row is at {last / 1e9:.9g} s, the preamble ends the export at {span / 1e9:.9g} "
        "s. Is the file cut?"
    )
    return [finding("end of export", export.file, sentence, count=1)]


def _kind_findings(file: str, channel: Channel, kind: str) -> list[Finding]:
    """A finding about a scaled channel; counters must be whole numbers.

    Raises LogError for a counter that is none.
    """
    whole = channel.data_type in _INTEGERS and channel.values.dtype == np.int64
    if kind == "integer" and (channel.scaled or not whole):
        scaled = "scaled in the Scope (offset, scale factor or unit)"
        raise LogError(
            f"{file}: channel {channel.name!r} is "
            f"{scaled if channel.scaled else channel.data_type}; a counter must be a whole number "
            "as the PLC has it. Record it so in the Scope."
        )
    if kind != "float" or not channel.scaled:
        return []
    sentence = (
        f"{channel.name!r} has an offset or scale factor in the Scope; the values are read as they "
        "stand."
    )
    return [finding("scaled channel", file, sentence, count=1)]


def _is_number(cell: str, value: float) -> bool:
    """Whether a field is the number `value`, with a decimal point or comma."""
    text = cell.replace(",", ".")
    return FLOAT.fullmatch(text) is not None and float(text) == value


def _floats(export: Export, cells: list[str], rows: NDArray[np.int64], name: str) -> Array:
    """(N,) numbers of the fields of a column in rows (N,)."""
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        values[i] = float(cell) if FLOAT.fullmatch(cell) else np.nan
        if not np.isfinite(values[i]):
            raise export.wrong(int(rows[i]), f"{name}: {cell[:30]!r} is not a number.")
    return values
