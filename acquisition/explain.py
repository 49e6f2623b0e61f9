"""How a recording would be read, with the reasons, from the head of each file: nothing is converted yet."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from acquisition.formats.dialect import Dialect
from acquisition.sources import (
    ballbar_layout,
    dialect_of,
    force_layout,
    inside,
    robot_layout,
    time_form,
)
from acquisition.table.header import SEPARATORS, Layout, read_header
from acquisition.table.rows import plain_rows
from acquisition.table.text import read_text
from acquisition.times import TimeCells, stamps_ns, words
from cell.recording import (
    EncoderFitting,
    RecordingFile,
    SourceFile,
    SourceName,
    load_recording_file,
)

_ANGLES = {
    "motors": "motor angles",
    "axes": "axis angles as the controller shows them",
    "joints": "joint angles of the DH model",
}


def explain_lines(folder: Path) -> list[str]:
    """What is read from where, and why, as lines of text.

    Raises DescriptionError or LogError as reading would.
    """
    description = load_recording_file(folder)
    lines = [
        f"recording of robot {description.robot}, ball-bar {description.ballbar}, plate {description.plate} (recording.yaml)"
    ]
    sources: list[tuple[SourceName, SourceFile | None]] = [
        ("robot", description.sources.robot),
        ("ballbar", description.sources.ballbar),
        ("force", description.sources.force),
    ]
    for name, source in sources:
        if source is None:
            continue
        dialect = dialect_of(folder, name, source)
        lines.append(
            f"{name}: dialect {source.dialect}, as recording.yaml declares; {len(source.files)} file(s)"
        )
        lines += [f"  {line}" for line in _meaning(dialect, description)]
        if source.quantised:
            lines.append(
                "  stamps step by more than can be neglected, the rows were taken evenly (recording.yaml): put between the steps"
            )
        layout = _layout(name, source, dialect, description)
        for file in source.files:
            if dialect.container == "text":
                lines += [
                    f"  {line}" for line in _file(folder, file, name, source, dialect, layout)
                ]
            else:
                lines.append(f"  {file}: {dialect.container}")
    return lines


def _layout(
    name: SourceName, source: SourceFile, dialect: Dialect, description: RecordingFile
) -> Layout:
    match name:
        case "robot":
            return robot_layout(source, dialect)
        case "ballbar":
            return ballbar_layout(source, dialect, dict(sorted(description.encoders.items())))
        case "force":
            return force_layout(source, dialect)


def _meaning(dialect: Dialect, description: RecordingFile) -> list[str]:
    if dialect.source == "robot":
        unit = "degrees" if dialect.angle_unit == "deg" else "rad"
        told = [
            f"{_ANGLES[dialect.side]}, in {unit}: the dialect says so; numbers that contradict it are refused"
        ]
        return told + ["torques in N m at the motor, where they are logged"] * bool(
            dialect.torque_columns
        )
    if dialect.source == "ballbar":
        return [
            _encoder(name, one, dialect.status.get(name))
            for name, one in sorted(description.encoders.items())
        ]
    return ["forces in N, torques in N m: what the flange feels, in its own frame"]


def _encoder(name: str, one: EncoderFitting, status: str | None) -> str:
    count = 2.0 * np.pi / (one.lines << one.bits) * 1e6
    sense = "as counted" if one.sign > 0 else "against the count"
    faults = f"; status word {status} where there is such a column" if status else ""
    return (
        f"encoder {name}: counter in column {one.column}, {one.lines} lines at {one.bits} bits (recording.yaml): "
        f"{count:.3g} urad a count, {sense}{faults}"
    )


def _file(
    folder: Path, file: str, name: SourceName, source: SourceFile, dialect: Dialect, layout: Layout
) -> list[str]:
    text = read_text(inside(folder, file), file, [])
    header = read_header(text, layout, [])
    where = (
        "no header, columns as declared"
        if header.without_header()
        else f"header in line {text.number[header.row - 1]}"
    )
    lines = [
        f"{file}: {text.encoding}, {SEPARATORS[header.separator]} between the fields (most wanted names are found with it), {where}, "
        f"{len(header.names)} columns"
    ]
    pairs = [
        (position + 1, header.names[position], selector)
        for selector, position in zip(header.columns, header.positions, strict=True)
    ]
    shown = [
        f"{k} {name}" if name == selector else f"{k} {name} (found by {selector})"
        for k, name, selector in pairs
    ]
    lines.append(f"  columns: {', '.join(shown)}")
    absent = [selector for selector in layout.optional if selector not in header.columns]
    if absent:
        lines.append(f"  not there, and not needed: {', '.join(absent)}")
    rows = plain_rows(text, header, layout, [])
    if dialect.time.column in header.columns:
        position = dict(zip(header.columns, header.positions, strict=True))[dialect.time.column]
        cells = [
            rows.plain[k].split(rows.separator)[position].strip()
            for k in (0, len(rows.plain) // 2, -1)
        ]
        stamps = TimeCells(
            file, dialect.time.column, cells, rows.number[[0, len(rows.plain) // 2, -1]]
        )
        lines.append(f"  time: {_time(name, source, dialect, stamps)}")
    return lines


def _time(name: SourceName, source: SourceFile, dialect: Dialect, stamps: TimeCells) -> str:
    form = time_form(name, source, dialect, stamps)
    why = (
        "recording.yaml declares it"
        if source.time
        else "the dialect declares it"
        if not dialect.time.forms
        else "the stamps show it"
    )
    ns = stamps_ns(stamps, form, [])
    first = (
        f"; first row at {np.datetime64(int(ns[0]) // 1_000_000, 'ms')} UTC or local"
        if form == "date" or form.startswith(("unix", "dc", "file"))
        else ""
    )
    return f"{words(form)}, since {why}{first}"
