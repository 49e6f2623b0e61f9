"""A dialect for a table that fits none: from what the file shows, and answers to the rest.

Separator, decimal sign, names of columns and the form of dates show; what the numbers mean does
not. The dialect becomes a file of the recording folder, which may be edited.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from acquisition.table.fields import column_names, likely_separator, split_fields
from acquisition.table.text import LogText
from acquisition.times import TIME_FORMS, recognised
from ballbar.recordings.questions import Ask, answer, one_of, time_form
from cell.arrays import Array
from cell.errors import InputError
from cell.logs import SourceName

OWN = "new"  # the answer that asks for a dialect of one's own
PERIODS = (2.0e-4, 0.1)  # [s] of rows that a robot or ball-bar logger writes without a remark
DEGREES = 7.0  # a joint angle above it [rad] would be more than a turn
SHOWN = 2000  # rows that are looked at
_AXES = range(5, 9)
_TIME_NAME = re.compile(r"(time|zeit|t|stamp|timestamp|date|datum|uhrzeit)\b", re.IGNORECASE)
_NUMBER = re.compile(r"\d+")


class _Table:
    """A table's columns by name, as text."""

    def __init__(self, text: LogText) -> None:
        self.separator = likely_separator(text)
        self.names = column_names(text)
        rows = [split_fields(line, self.separator) for line in text.lines[:SHOWN]]
        below = rows[rows.index(self.names) + 1 :] if self.names else []
        self.rows = [row for row in below if len(row) == len(self.names)]

    def cells(self, name: str) -> list[str]:
        return [row[self.names.index(name)] for row in self.rows]

    def values(self, name: str) -> Array:
        """(N,) numbers of a column, those cells left out that are none."""
        return np.array([v for cell in self.cells(name) if (v := _number(cell)) is not None])

    @property
    def decimal_commas(self) -> bool:
        return self.separator != "," and any(
            "," in cell and _number(cell) is not None for row in self.rows for cell in row
        )


def _number(cell: str) -> float | None:
    try:
        return float(cell.replace(",", "."))
    except ValueError:
        return None


def new_dialect(
    source: SourceName, text: LogText, time: str | None, ask: Ask
) -> tuple[dict[str, Any], str | None]:
    """A dialect (ballbar-dialect/1) for a table, and the form of its stamps where they hide it.

    source : robot, ballbar or length. time : the form, where an option gave it.

    Raises InputError where no header shows, or an answer is missing.
    """
    table = _Table(text)
    if len(table.names) < 2 or not table.rows:
        raise InputError(
            f"{text.file}: no line of column names shows above the rows, so no dialect can be "
            "made from it. Write one (docs, Read your own log) and name its file."
        )
    column = _time_column(text.file, table, ask)
    form, shown = _time_form(text.file, table, column, time, ask)
    data: dict[str, Any] = {
        "schema": "ballbar-dialect/1",
        "source": source,
        "separators": [table.separator],
        "decimal": "comma" if table.decimal_commas else "point",
        "time": {"column": column, "forms": [form]},
    }
    if source == "robot":
        data |= _angles(text.file, table, column, ask)
    return data | {"period_s": list(PERIODS)}, None if shown else form


def _time_column(file: str, table: _Table, ask: Ask) -> str:
    dated = [n for n in table.names if recognised(table.cells(n)[0], TIME_FORMS)]
    named = [n for n in table.names if _TIME_NAME.match(n)]
    proposal = next(iter((*dated, *named)), None)
    question = f"{file}: which column holds the time stamps? Columns: {', '.join(table.names)}."
    return answer(None, question, proposal, one_of(*table.names), ask)


def _time_form(
    file: str, table: _Table, column: str, given: str | None, ask: Ask
) -> tuple[str, bool]:
    """The form of the stamps, and whether they show it."""
    cells = table.cells(column)
    if given is None and (form := recognised(cells[len(cells) // 2], TIME_FORMS)):
        return form, True
    stamps = table.values(column)
    return time_form(file, stamps, periods=PERIODS, given=given, ask=ask), False


def _angles(file: str, table: _Table, time: str, ask: Ask) -> dict[str, Any]:
    """Columns, kind and unit of a robot's angles."""
    names = [name for name in table.names if name != time]

    def columns(reply: str) -> list[str]:
        chosen = [part.strip() for part in reply.split(",")]
        if unknown := [name for name in chosen if name not in names]:
            raise InputError(f"{unknown[0]!r} is no column. Columns: {', '.join(names)}.")
        if len(chosen) not in _AXES:
            raise InputError(f"{len(chosen)} columns; expected one for each axis, 5 to 8.")
        return chosen

    proposal = counted(names)
    question = f"{file}: which columns hold the angles, in the order of the axes?"
    chosen = answer(None, question, ", ".join(proposal) or None, columns, ask)
    kind = answer(
        None,
        f"{file}: which angles are they? (motors: motor angles; axes: as the controller shows them;"
        " joints: of the DH model)",
        None,
        one_of("motors", "axes", "joints"),
        ask,
    )
    largest = max(float(np.abs(table.values(name)).max(initial=0.0)) for name in chosen)
    degrees = kind != "motors" and largest > DEGREES
    unit = answer(
        None,
        f"{file}: in which unit? The largest is {largest:.4g}. (rad or deg)",
        "deg" if degrees else None,
        one_of("rad", "deg"),
        ask,
    )
    return {kind: chosen, "angle_unit": unit}


def counted(names: Sequence[str]) -> list[str]:
    """The first columns, 5 to 8, whose names differ in one number that counts on; else none."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(_NUMBER.sub("#", name), []).append(name)
    for shape, group in groups.items():
        numbers = [[int(n) for n in _NUMBER.findall(name)] for name in group]
        steps = np.diff(np.array(numbers), axis=0) if "#" in shape else np.zeros((0, 1))
        if len(group) in _AXES and (steps.sum(axis=1) == 1).all():
            return group
    return []
