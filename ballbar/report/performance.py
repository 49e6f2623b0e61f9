"""Page and lines of the terminal on characteristics of ISO 9283 and ISO 230-4."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape

from ballbar.cell.files import write_whole
from ballbar.cell.foreign_text import printable
from ballbar.ident.performance.characteristics import (
    CIRCULAR,
    ROBOTS,
    Characteristic,
    Performance,
    Statement,
)
from ballbar.report.numbers import MISSING, fixed, significant
from ballbar.report.section import Section, machine_row, section, template
from ballbar.result.calibration import Calibration
from ballbar.result.performance import performance
from ballbar.result.run_data import RunData
from ballbar.result.write_calibration import calibration_of
from ballbar.units import MM

DIGITS = 3
Cell = tuple[str, str, str, int]  # origin, value, interval, and number of its remark from 1 or 0
Row = tuple[Characteristic, str, list[Cell]]  # with the unit that is shown


def shown(rows: Sequence[Characteristic]) -> tuple[list[Row], list[str]]:
    """Rows as they are shown, and the remarks that they point to."""
    remarks = list(dict.fromkeys(s.reason for row in rows for s in row.statements if s.reason))
    units = {"m": "mm", "rad": "mrad"}
    return [
        (row, units[row.unit], [_cell(s, remarks) for s in row.statements]) for row in rows
    ], remarks


def _cell(statement: Statement, remarks: list[str]) -> Cell:
    """Values in mm or mrad, which have one factor."""
    note = 1 + remarks.index(statement.reason) if statement.reason else 0
    ends = [statement.low, statement.high]
    value, *interval = (
        MISSING if v is None else significant(v * MM, DIGITS) for v in (statement.value, *ends)
    )
    return statement.origin, value, "" if None in ends else " to ".join(interval), note


def performance_section(run: RunData) -> list[Section]:
    """Positions that an acceptable result predicts."""
    robot = run.identification.robot.identified
    if robot.stated is None or not run.identification.verdict.acceptable:
        return []
    stated = performance(Calibration(calibration_of(run), run=run))
    known = [row for row in stated.rows if row.unit == "m" and row.statements[0].value is not None]
    rows, remarks = shown(known)
    return [
        section(
            "performance_section.html",
            {"performance": "Performance"},
            machine_row(run),
            groups=_groups(rows),
            remarks=remarks,
            side=stated.side,
            notes=stated.notes,
        )
    ]


def _groups(rows: Sequence[Row]) -> list[list[Row]]:
    """Rows of one characteristic together."""
    return [list(own) for _, own in groupby(rows, key=lambda row: row[0].symbol)]


def write_performance(path: Path, stated: Performance, *, title: str, command: str) -> None:
    """Write the page, whole or not at all; command : as the user typed it."""
    plots = []
    for place, test in stated.circles:
        from ballbar.report.polar_plot import polar_plot  # noqa: PLC0415  imports matplotlib

        plots.append((place, polar_plot(test), test))
    rows, remarks = shown(stated.rows)
    cube = np.empty((0, 3))
    if stated.poses is not None and stated.axes is not None:
        cube = np.hstack((stated.poses[:, :3, 3] * MM, np.rad2deg(stated.axes)))
    page = template("performance.html").render(
        title=title,
        command=command,
        pose_groups=[own for own in _groups(rows) if own[0][0].symbol not in CIRCULAR],
        circle_groups=[own for own in _groups(rows) if own[0][0].symbol in CIRCULAR],
        remarks=remarks,
        circles=plots,
        stated=stated,
        positions=[[fixed(float(v), 1 + 2 * (k > 2)) for k, v in enumerate(row)] for row in cube],
    )
    write_whole(path, printable(page, allowed="\n\t").encode())


def say_performance(out: Console, stated: Performance) -> None:
    """Print the rows in columns, then the remarks and the notes."""
    rows, remarks = shown(stated.rows)
    lines = [["", "at", "cycles", *ROBOTS]]
    for row, unit, cells in rows:
        head = [row.symbol, row.place, str(row.cycles or MISSING)]
        lines.append([*head, *(_cell_text(cell, unit) for cell in cells)])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        out.print(escape("  ".join(map(str.ljust, line, widths)).rstrip()))
    out.print("m measured, p predicted, in brackets the 95 % interval")
    for number, text in enumerate(remarks, start=1):
        out.print(escape(f"({number}) {text}"))
    if stated.side is not None:
        out.print(f"test cube of {stated.side * MM:g} mm (ISO 9283:1998, 6.8)")
    for note in stated.notes:
        out.print(escape(note))


def _cell_text(cell: Cell, unit: str) -> str:
    """A statement as the terminal shows it."""
    origin, value, interval, note = cell
    mark = f" ({note})" if note else ""
    if value == MISSING:
        return MISSING + mark
    return f"{value}{f' [{interval}]' if interval else ''} {unit} {origin[0]}{mark}"
