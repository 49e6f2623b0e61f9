"""TwinCAT Scope exports as a table: the wanted channels at the times they share (acquisition.formats.scope_export has the form)."""

from __future__ import annotations

import re
from dataclasses import dataclass
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
    Export,
    Group,
    read_export,
)
from acquisition.report import Finding, finding
from acquisition.table.header import Layout
from acquisition.table.table import Form, Table
from cell.errors import LogError

_UNIX = 116_444_736_000_000_000  # [100 ns] FILETIME of 1970
_LONGEST_MS = (
    2**51 // 10**6
)  # [ms] 26 days: up to there a float of milliseconds rounds to the right nanosecond
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


def read_scope(
    path: Path, file: str, time: str, layout: Layout, findings: list[Finding]
) -> tuple[Table, Form]:
    """The wanted channels of an export as one table: the rows at whose times all of them have a value.

    time : name that the time column gets, [ns] since 1970.
    Raises LogError if channels are missing, stand twice or are counters that were scaled, or the file is damaged.
    """
    text, export = read_export(path, file, findings)
    wanted = wanted_columns(layout, time, export.names, file)
    for name in wanted:
        if export.names.count(name) > 1:
            raise LogError(
                f"{file}: {export.names.count(name)} channels are called {name!r}. Rename them in the Scope."
            )
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
        raise LogError(
            f"{file}: the channels {', '.join(wanted)} have no common times. Record them with one sample time."
        )
    densest = max(channel.time_ns.size for channel in channels)
    if common.size < densest:
        sentence = (
            f"{densest - common.size} times at which not every channel has a value; left out."
        )
        findings.append(
            finding(
                "channels of different length",
                "repaired",
                file,
                sentence,
                count=densest - common.size,
            )
        )
    columns: dict[str, NDArray[Any]] = {time: common}
    for channel in channels:
        kind = np.int64 if wanted[channel.name] == "integer" else np.float64
        columns[channel.name] = channel.values[np.searchsorted(channel.time_ns, common)].astype(
            kind
        )
    form = Form(text.encoding, SEPARATORS[export.separator], export.decimal, len(export.rows))
    return one_file(columns, file, first.line[np.searchsorted(first.time_ns, common)]), form


def read_channels(path: Path, file: str, findings: list[Finding]) -> list[Channel]:
    """All channels of an export in the file's order, names not unique, each with its own times."""
    return _channels(read_export(path, file, findings)[1], findings)


def _channels(
    export: Export, findings: list[Finding], only: tuple[str, ...] | None = None
) -> list[Channel]:
    present, torn = _present(export)
    if torn.size > max(1.0, DAMAGED_LIMIT * len(export.rows)):
        row = export.rows[int(torn[0])]
        usual = (
            " Decimal commas with comma separators? Export again with tabs."
            if export.separator == ","
            else ""
        )
        raise LogError(
            f"{export.file}:{export.number[torn[0]]}: {torn.size} of {len(export.rows)} rows do not fit the groups of columns: "
            f"expected {export.groups[-1].stop} fields, got {len(row)}.{usual}"
        )
    if torn.size:
        sentence = "the fields do not fit the groups of columns; treated as torn line and dropped."
        findings.append(
            finding("torn line", "repaired", export.file, sentence, lines=export.number[torn])
        )
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
                values = _values(
                    export,
                    _cells(export, rows, position, comma=comma),
                    line,
                    name,
                    data_type,
                    _scaled(export, position),
                )
                channels.append(
                    Channel(name, data_type, _scaled(export, position), time_ns, values, line)
                )
    return channels


def _present(export: Export) -> tuple[list[NDArray[np.int64]], NDArray[np.int64]]:
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
    return [np.flatnonzero(there[:, j] & ~torn) for j in range(len(export.groups))], np.flatnonzero(
        torn
    )


def _cells(export: Export, rows: NDArray[np.int64], position: int, *, comma: bool) -> list[str]:
    cells = [export.rows[i][position].strip() for i in rows]
    return [cell.replace(",", ".") for cell in cells] if comma else cells


def _times(export: Export, cells: list[str], line: NDArray[np.int64]) -> NDArray[np.int64]:
    """[ns] since 1970; strictly increasing."""
    start_ns = (export.start - _UNIX) * 100
    if _all(INTEGER, cells) and all(len(cell) == 18 for cell in cells):
        time_ns = (np.array([int(cell) for cell in cells], dtype=np.int64) - _UNIX) * 100
    else:
        milliseconds = _floats(export, cells, line, "time")
        far = np.flatnonzero(np.abs(milliseconds) > _LONGEST_MS)
        if far.size:
            raise LogError(
                f"{export.file}:{line[far[0]]}: time {cells[far[0]]!r}: a recording has at most {_LONGEST_MS} ms."
            )
        time_ns = np.rint(milliseconds * 1e6).astype(np.int64) + start_ns
    back = np.flatnonzero(np.diff(time_ns) <= 0)
    if back.size:
        raise LogError(
            f"{export.file}:{line[back[0] + 1]}: time {cells[back[0] + 1]!r} does not lie behind {cells[back[0]]!r}."
        )
    return time_ns


def _check_grid(
    export: Export,
    group: Group,
    time_ns: NDArray[np.int64],
    line: NDArray[np.int64],
    findings: list[Finding],
) -> None:
    """Times off the declared sample time are appended to `findings`."""
    if SAMPLE_TIME not in export.meta:
        return
    cell = export.meta[SAMPLE_TIME][group.start + 1].replace(",", ".")
    step = round(float(cell) * 1e6) if FLOAT.fullmatch(cell) else 0
    if not 0 < step < 2**62:
        raise LogError(
            f"{export.file}: {SAMPLE_TIME} {cell!r} of {export.meta['Name'][group.start + 1]!r} is no time."
        )
    late = np.flatnonzero(np.diff(time_ns) != step) + 1
    if late.size:
        sentence = f"times do not follow at the sample time of {cell} ms: rows are missing, or a time is damaged."
        findings.append(
            finding("off the sample time", "warning", export.file, sentence, lines=line[late])
        )


def _check_end(export: Export, channels: list[Channel], findings: list[Finding]) -> None:
    """An export whose rows do not reach the end that its preamble states is appended to `findings`."""
    span = (export.end - export.start) * 100
    last = max(int(channel.time_ns[-1]) for channel in channels) - (export.start - _UNIX) * 100
    step = max(int(np.diff(channel.time_ns).max(initial=1)) for channel in channels)
    if abs(last - span) > step:
        sentence = f"the last row is at {last / 1e9:.9g} s, the preamble ends the export at {span / 1e9:.9g} s. Is the file cut?"
        findings.append(finding("end of export", "warning", export.file, sentence, count=1))


def _check_kind(file: str, channel: Channel, kind: str, findings: list[Finding]) -> None:
    if kind == "integer" and (
        channel.scaled or channel.data_type not in _INTEGERS or channel.values.dtype != np.int64
    ):
        why = (
            "scaled in the Scope (offset, scale factor or unit)"
            if channel.scaled
            else channel.data_type
        )
        raise LogError(
            f"{file}: channel {channel.name!r} is {why}; a counter must be a whole number as the PLC has it."
        )
    if kind == "float" and channel.scaled:
        sentence = f"{channel.name!r} has an offset or scale factor in the Scope; the values are read as they stand."
        findings.append(finding("scaled channel", "warning", file, sentence, count=1))


def _scaled(export: Export, position: int) -> bool:
    for key, neutral in _UNSCALED.items():
        cell = export.meta.get(key, [])
        text = cell[position].replace(",", ".") if cell else str(neutral)
        if not FLOAT.fullmatch(text) or float(text) != neutral:
            return True
    return False


def _values(
    export: Export,
    cells: list[str],
    line: NDArray[np.int64],
    name: str,
    data_type: str,
    scaled: bool,
) -> NDArray[Any]:
    if data_type not in _INTEGERS or (scaled and not _all(INTEGER, cells)):
        return _floats(export, cells, line, name)
    lower, upper = _INTEGERS[data_type] if not scaled else (-(2**63), 2**63 - 1)
    for cell, number in zip(cells, line, strict=True):
        if not (INTEGER.fullmatch(cell) and len(cell) <= 21 and lower <= int(cell) <= upper):
            raise LogError(
                f"{export.file}:{number}: channel {name!r}: {cell[:30]!r} is no {data_type}."
            )
    whole = [int(cell) for cell in cells]
    return np.array(whole, dtype=np.uint64 if max(whole) >= 2**63 else np.int64)


def _floats(
    export: Export, cells: list[str], line: NDArray[np.int64], name: str
) -> NDArray[np.float64]:
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        values[i] = float(cell) if FLOAT.fullmatch(cell) else np.nan
        if not np.isfinite(values[i]):
            raise LogError(
                f"{export.file}:{line[i]}: channel {name!r}: {cell[:30]!r} is not a number."
            )
    return values


def _all(pattern: re.Pattern[str], cells: list[str]) -> bool:
    return all(pattern.fullmatch(cell) for cell in cells)
