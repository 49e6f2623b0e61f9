"""Any log as channels over its clock: a source of a recording folder, or a plain table.

A plain table has one column of time stamps, the first one whose name says time (`time`, `t_ms`,
`Zeit [s]`, `timestamp`), or else its first column. Every other column of numbers is a channel. The
stamps' form shows if they count from an epoch, their unit if the column's name ends in it (`_ms`,
`[us]`); otherwise it is declared, never guessed. Two columns of whole seconds and of nanoseconds
(`sec`, `nanosec`), where the rows fill them, are the device's own stamps and go before a column of
arrival.

Of a table that holds several signals, each in rows of its own, the rows are read that fill the
channels.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbar.acquisition import times
from ballbar.acquisition.faults.publishers import refuse_two_publishers
from ballbar.acquisition.recording import Recording, read_recording
from ballbar.acquisition.report import Finding
from ballbar.acquisition.stamps.arrival import of_one_source, with_source_times
from ballbar.acquisition.stamps.order import STAMP, in_order, in_sequence, seconds, without_strays
from ballbar.acquisition.table.header import Kind, Layout
from ballbar.acquisition.table.table import Table, read_table
from ballbar.acquisition.table.text import (
    SEPARATORS,
    LogText,
    column_names,
    is_number,
    likely_separator,
    read_text,
    split_fields,
)
from ballbar.cell.dialect import TimeForm
from ballbar.cell.errors import InputError, LogError
from ballbar.cell.logs import ChannelLog, SourceName

WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
POINT = ("x", "y", "z")  # [m]
WITH_EPOCH = ("filetime", "dc", "unix-s", "unix-ms", "unix-us", "unix-ns", "date")
_TIME_NAME = re.compile(r"(time|zeit|stamp|timestamp|date|t)([^a-z].*|stamp)?", re.IGNORECASE)
_UNIT = re.compile(r"[_\[(\s](s|ms|us|ns)[\])]?$", re.IGNORECASE)


def read_channels(
    path: Path,
    *,
    source: SourceName | None = None,
    time: str | None = None,
    channels: Sequence[str] = (),
) -> tuple[ChannelLog, tuple[Finding, ...]]:
    """The channels of one log, and what was found in its files.

    path : a recording folder, or a table. source : of a folder's logs; default the robot's.
    time : form of a table's stamps, if they do not show it. channels : the columns of a table that
    are read; default all of numbers.

    Raises LogError or DescriptionError if the log cannot be trusted, InputError if a declaration
    does not fit it.
    """
    if path.is_dir():
        if time is not None:
            raise InputError(f"{path}: recording.yaml declares the form of the stamps, not --time.")
        recording = read_recording(path)
        return _of_recording(path, recording, source or "robot"), recording.report.findings
    if source is not None:
        raise InputError(f"{path}: a table has no source {source}; only recording folders do.")
    form = None if time is None else times.checked_form(time, str(path))
    return _of_table(path, form, channels)


def _of_recording(folder: Path, recording: Recording, source: SourceName) -> ChannelLog:
    """The channels of one source of a recording."""
    robot, bar, force = recording.robot_log, recording.ballbar_log, recording.force_log
    name = f"{folder} ({source})"
    if source == "robot":
        joints = tuple(f"q{k + 1}" for k in range(robot.q.shape[1]))
        return ChannelLog(name, robot.t, robot.q, joints, robot.segment)
    if source == "ballbar" and bar is not None:
        return ChannelLog(name, bar.t, bar.angles, tuple(f"b{j}" for j in bar.joints), bar.segment)
    if source == "length" and (length := recording.length_log) is not None:
        return ChannelLog(name, length.t, length.length[:, None], ("length",), length.segment)
    if source == "force" and force is not None:
        return ChannelLog(name, force.t, force.wrench, WRENCH)
    if source == "tracker" and (tracker := recording.tracker_log) is not None:
        return ChannelLog(name, tracker.t, tracker.points, POINT, tracker.segment)
    raise InputError(f"{folder}: recording.yaml has no sources.{source}. Name one that it has.")


def _of_table(
    path: Path, time: TimeForm | None, channels: Sequence[str]
) -> tuple[ChannelLog, tuple[Finding, ...]]:
    text = read_text(path, path.name)
    names = column_names(text)
    unnamed = all(is_number(name) for name in names)
    if unnamed:
        names = [f"#{k + 1}" for k in range(len(names))]
    column = next((name for name in names if _TIME_NAME.fullmatch(name)), names[0])
    chosen = _columns(path, text, names, column, channels)
    both = _own_stamps(text, names, chosen)
    required: dict[str, Kind] = dict.fromkeys(both, "float") if both else {column: "text"}
    layout = Layout(
        separators=tuple(SEPARATORS),
        required=required | dict.fromkeys(chosen, "float"),
        headerless=unnamed,
        signal=tuple(chosen),
    )
    table, _ = read_table(path, path.name, layout)
    stamps = times.popped_stamps(table.columns, both or (column,), path.name, table.line)
    form = "ns" if both else _form(stamps, time)
    ns, findings = times.stamps_ns(stamps, form)
    table = replace(table, columns={STAMP: ns, **table.columns})
    table = in_sequence(replace(table, findings=(*table.findings, *findings)), None)
    raw, table = table, with_source_times(without_strays(table), chosen)
    if not of_one_source(table):
        refuse_two_publishers(raw, chosen, "")
    table = in_order(table)
    values = np.stack([table.columns[name] for name in chosen], axis=1)
    first = int(table.columns[STAMP][0])
    known = form in WITH_EPOCH or bool(both and first > times.SINCE_2001)
    log = ChannelLog(
        path.name, _increasing(table), values, tuple(chosen), first_ns=first if known else None
    )
    return log, tuple(f for f in table.findings if f.kind != "column not used")


def _own_stamps(text: LogText, names: list[str], channels: Sequence[str]) -> tuple[str, ...]:
    """Columns of seconds and nanoseconds that the first row of the channels fills, if any."""
    both, separator = times.two_columns(names) or (), likely_separator(text)
    wanted = [names.index(name) for name in channels]
    for line in text.lines if both else ():
        cells = split_fields(line, separator)
        if len(cells) == len(names) and all(is_number(cells[k]) for k in wanted):
            return both if all(is_number(cells[names.index(name)]) for name in both) else ()
    return ()


def _columns(
    path: Path, text: LogText, names: list[str], time: str, channels: Sequence[str]
) -> list[str]:
    """The channels that are read. Raises LogError if there are none, or one does not exist."""
    for name in channels:
        if name not in names:
            what = f"no column {name!r}; the header has {', '.join(names)}."
            raise LogError.at(path.name, what, "Name one of them.")
    if channels:
        return list(dict.fromkeys(channels))
    separator = likely_separator(text)
    shown = (text.lines[len(text.lines) // 2], *text.lines[-2:])
    rows = [split_fields(line, separator) for line in shown]
    stamps = (time, *(times.two_columns(names) or ()))
    numbers = [
        name
        for k, name in enumerate(names)
        if name and name not in stamps and all(k < len(row) and is_number(row[k]) for row in rows)
    ]
    if not numbers:
        raise _no_numbers(path.name, names, time, rows)
    return numbers


def _no_numbers(file: str, names: list[str], time: str, rows: Sequence[Sequence[str]]) -> LogError:
    """The error for a table whose rows have no column of numbers in common."""
    listed = ", ".join(names)
    if all(any(map(is_number, row)) for row in rows) and len(names) > 2:
        what = f"no column has values in every row: several signals. Columns: {listed}."
        remedy = "Name the channels of one signal, such as `--channel x=pv_x`."
        return LogError.at(file, what, remedy)
    what = f"no column of numbers beside the time stamps in {time!r}; the columns are {listed}."
    return LogError.at(file, what, "Export the table with its values.")


def _form(stamps: times.TimeCells, declared: TimeForm | None) -> TimeForm:
    """The form of the stamps: declared, the unit in their column's name, or shown by them."""
    if declared is not None:
        return declared
    if match := _UNIT.search(stamps.column):
        return times.checked_form(match[1].lower(), stamps.column)
    # A whole number near 1.7e9 may as well be an up-time in ms.
    whole = "." not in str(stamps.cells[len(stamps.cells) // 2])
    forms = [form for form in times.TIME_FORMS if not (whole and form == "unix-s")]
    return times.form_shown(stamps, forms, "with `--time-a s`, or in the column's name (`t_ms`)")


def _increasing(table: Table) -> np.ndarray:
    """(N,) [s] from the first row. Raises LogError where the clock was set back."""
    t = seconds(table)
    back = np.flatnonzero(np.diff(t) <= 0.0) + 1
    if back.size:
        raise LogError(
            f"{table.location(back[0])}: the stamp goes back by {t[back[0] - 1] - t[back[0]]:.3g} "
            "s. The recorder restarted: split the file before this line and align each part."
        )
    return t
