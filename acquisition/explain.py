"""How a recording would be read and why, from the head of each file: nothing is converted yet."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import numpy as np

from ballbar.acquisition.sources import Fitted, LogSource, inside, log_source, time_form
from ballbar.acquisition.table.header import Header, read_header
from ballbar.acquisition.table.rows import PlainRows
from ballbar.acquisition.table.table import signal_rows
from ballbar.acquisition.table.text import SEPARATORS, read_text
from ballbar.acquisition.times import popped_stamps, stamps_ns, words
from ballbar.cell.logs import SourceName
from ballbar.cell.recording import (
    EncoderFitting,
    LengthFile,
    SourceFile,
    TrackerFile,
    load_recording_file,
)

ANGLES = {
    "motors": "motor angles",
    "axes": "axis angles as the controller shows them",
    "joints": "joint angles of the DH model",
}


def explain_lines(folder: Path) -> list[str]:
    """Lines of text that say which file is read as what, and why.

    Raises DescriptionError or LogError as reading would.
    """
    description = load_recording_file(folder)
    encoders = dict(sorted(description.encoders.items()))
    kind = "instrument" if description.ballbar is None else "ball-bar"
    lines = [
        f"recording of robot {description.robot}, {kind} {description.measured_by}, plate "
        f"{description.plate} (recording.yaml)"
    ]
    for name in get_args(SourceName):
        declared: SourceFile | None = getattr(description.sources, name)
        if declared is not None:
            lines += _source(log_source(folder, name, declared, encoders=encoders), encoders)
    return lines


def _source(source: LogSource, encoders: Fitted) -> Iterator[str]:
    """One log: its dialect, the meaning of its numbers, and each of its files."""
    declared = source.declared
    dialect, count = declared.dialect, len(declared.files)
    yield f"{source.name}: dialect {dialect}, as recording.yaml has it; {count} file(s)"
    yield from (f"  {line}" for line in _meaning(source, encoders))
    if declared.quantised:
        yield (
            "  stamps step by more than can be neglected, the rows were taken evenly "
            "(recording.yaml): put between the steps"
        )
    for file in declared.files:
        if source.dialect.container == "text":
            yield from (f"  {line}" for line in _file(source, file))
        else:
            yield f"  {file}: {source.dialect.container}"


def _meaning(source: LogSource, encoders: Fitted) -> list[str]:
    """The meaning of the numbers of a log, in sentences."""
    dialect, declared = source.dialect, source.declared
    if dialect.source == "robot":
        unit = "degrees" if dialect.angle_unit == "deg" else "rad"
        why = "the dialect says so; numbers that contradict it are refused"
        angles = [f"{ANGLES[dialect.angle_kind]}, in {unit}: {why}"]
        place = {"motors": "at the motor", "axes": "behind the gears, along the axis angles"}
        torques = [f"torques in N m {place[dialect.torques_at]}, where they are logged"]
        return angles + (torques if dialect.torque_columns else [])
    if dialect.source == "ballbar":
        named = sorted(encoders.items())
        return [_encoder(name, encoder, dialect.status.get(name)) for name, encoder in named]
    if isinstance(declared, LengthFile):
        zero = f" from {declared.zero_m:g} m on" if declared.zero_m else ""
        return [f"length in {declared.unit}{zero}, column {declared.column} (recording.yaml)"]
    if isinstance(declared, TrackerFile):
        stated = declared.accuracy_m
        accuracy = "of the instrument" if stated is None else f"{stated * 1e6:g} um"
        what = f"points of a target in {declared.unit} (recording.yaml), accuracy {accuracy}"
        return [f"{what}; empty: hidden"]
    return ["forces in N, torques in N m: what the flange feels, in its own frame"]


def _encoder(name: str, encoder: EncoderFitting, status: str | None) -> str:
    count = 2.0 * np.pi / (encoder.lines << encoder.bits) * 1e6
    direction = "as counted" if encoder.sign > 0 else "against the count"
    faults = f"; status word {status} where there is such a column" if status else ""
    return (
        f"encoder {name}: counter in column {encoder.column}, {encoder.lines} lines at "
        f"{encoder.bits} bits (recording.yaml): {count:.3g} urad a count, {direction}{faults}"
    )


def _wanted(header: Header) -> list[str]:
    """Number and name of each wanted column, with its selector where that is another."""
    return [
        f"{position + 1} {header.names[position]}"
        + (f" (found by {selector})" if header.names[position] != selector else "")
        for selector, position in zip(header.columns, header.positions, strict=True)
    ]


def _file(source: LogSource, file: str) -> list[str]:
    """How one table would be read."""
    text = read_text(inside(source.folder, file), file)
    header = read_header(text, source.layout)
    where = f"header in line {text.number[header.row - 1]}"
    if header.without_header():
        where = "no header, columns as declared"
    lines = [
        f"{file}: {text.encoding}, {SEPARATORS[header.separator]} between the fields (most wanted "
        f"names are found with it), {where}, {len(header.names)} columns",
        f"  columns: {', '.join(_wanted(header))}",
    ]
    absent = [selector for selector in source.layout.optional if selector not in header.columns]
    if absent:
        lines.append(f"  not there, and not needed: {', '.join(absent)}")
    rows = signal_rows(text, header, source.layout)
    if source.dialect.time.column in header.columns:
        lines.append(f"  time: {_time(source, rows, header)}")
    return lines


def _time(source: LogSource, rows: PlainRows, header: Header) -> str:
    """Form of the time stamps, by the first, the middle and the last row."""
    dialect, shown = source.dialect, [0, len(rows.plain) // 2, -1]
    position = dict(zip(header.columns, header.positions, strict=True))
    split = [rows.plain[k].split(rows.separator) for k in shown]
    columns = {c: [cells[position[c]].strip() for cells in split] for c in dialect.time.columns}
    stamps = popped_stamps(columns, dialect.time.columns, rows.file, rows.number[shown])
    form = time_form(source, stamps)
    why = "the stamps show it" if dialect.time.forms else "the dialect declares it"
    if source.declared.time:
        why = "recording.yaml declares it"
    first = ""
    if form == "date" or form.startswith(("unix", "dc", "file")):
        ns = int(stamps_ns(stamps, form)[0][0])
        first = f"; first row at {np.datetime64(ns // 1_000_000, 'ms')} UTC or local"
    return f"{words(form)}, since {why}{first}"
