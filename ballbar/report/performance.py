"""Page and lines of the terminal on characteristics of ISO 9283 and ISO 230-4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
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
from ballbar.report.polar_plot import polar_plot
from ballbar.report.section import template
from ballbar.units import MM, MRAD

MARKS = {"measured": "m", "predicted": "p", "not stated": ""}
DIGITS = 3


@dataclass(frozen=True)
class Cell:
    """A statement as it is shown, in mm or mrad."""

    value: str
    interval: str  # empty where there is none
    origin: str
    note: int  # number of the remark, from 1; 0: none


@dataclass(frozen=True)
class Row:
    """A characteristic as it is shown."""

    characteristic: Characteristic
    unit: str
    cells: tuple[Cell, ...]

    @property
    def symbol(self) -> str:
        """The symbol without its index."""
        return self.characteristic.symbol.partition("_")[0]

    @property
    def index(self) -> str:
        """The index of the symbol; empty without one."""
        return self.characteristic.symbol.partition("_")[2]


@dataclass
class _Remarks:
    """Remarks, each once, by number."""

    texts: list[str] = field(default_factory=list)

    def number(self, text: str) -> int:
        """The remark's number, from 1; 0 without one."""
        if not text:
            return 0
        if text not in self.texts:
            self.texts.append(text)
        return 1 + self.texts.index(text)


def shown(rows: Sequence[Characteristic]) -> tuple[list[Row], list[str]]:
    """Rows as they are shown, and the remarks that they point to."""
    remarks, out = _Remarks(), []
    for row in rows:
        unit = "mm" if row.unit == "m" else "mrad"
        cells = tuple(_cell(row.statements[robot], remarks) for robot in ROBOTS)
        out.append(Row(row, unit, cells))
    return out, remarks.texts


def _cell(statement: Statement, remarks: _Remarks) -> Cell:
    """Values are shown in mm and mrad, which have one factor."""
    note = remarks.number(statement.reason)
    if statement.value is None:
        return Cell(MISSING, "", statement.origin, note)
    interval = ""
    if statement.low is not None and statement.high is not None:
        ends = (significant(end * MM, DIGITS) for end in (statement.low, statement.high))
        interval = " to ".join(ends)
    assert MM == MRAD  # so that one factor shows both
    return Cell(significant(statement.value * MM, DIGITS), interval, statement.origin, note)


def write_performance(path: Path, stated: Performance, *, title: str, command: str) -> None:
    """Write the page, whole or not at all; command : as the user typed it."""
    rows, remarks = shown(stated.rows)
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.characteristic.symbol, []).append(row)
    page = template("performance.html").render(
        title=title,
        command=command,
        pose_groups=[rows for symbol, rows in groups.items() if symbol not in CIRCULAR],
        circle_groups=[rows for symbol, rows in groups.items() if symbol in CIRCULAR],
        remarks=remarks,
        circles=[(place, polar_plot(test), test) for place, test in stated.circles],
        stated=stated,
        positions=_positions(stated),
    )
    write_whole(path, printable(page, allowed="\n\t").encode())


def _positions(stated: Performance) -> list[tuple[str, ...]]:
    """Name and coordinates [mm] of each test pose."""
    if stated.poses is None:
        return []
    places = np.round(stated.poses[:, :3, 3] * MM, 1)
    return [(f"P{k}", *(fixed(v, 1) for v in place)) for k, place in enumerate(places, start=1)]


def say_performance(out: Console, stated: Performance) -> None:
    """Print the rows in columns, then the remarks and the notes."""
    rows, remarks = shown(stated.rows)
    lines = [["", "at", "cycles", *ROBOTS]]
    for row in rows:
        own = row.characteristic
        head = [own.symbol, own.place, str(own.cycles or MISSING)]
        lines.append([*head, *(_cell_text(cell, row.unit) for cell in row.cells)])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        text = "  ".join(cell.ljust(n) for cell, n in zip(line, widths, strict=True)).rstrip()
        out.print(escape(text), style="bold" if line is lines[0] else None)
    out.print("m measured, p predicted, in brackets the 95 % interval")
    for number, text in enumerate(remarks, start=1):
        out.print(escape(f"({number}) {text}"))
    if stated.side is not None:
        out.print(f"test cube of {stated.side * MM:g} mm (ISO 9283:1998, 6.8)")
    for note in stated.notes:
        out.print(escape(note))


def _cell_text(cell: Cell, unit: str) -> str:
    note = f" ({cell.note})" if cell.note else ""
    if cell.value == MISSING:
        return MISSING + note
    interval = f" [{cell.interval}]" if cell.interval else ""
    return f"{cell.value}{interval} {unit} {MARKS[cell.origin]}{note}"
