"""A dialect for a table that fits none: from what the file shows, and answers to the rest.

Separator, decimal sign, names of columns and the form of dates show; what the numbers mean does
not. The dialect becomes a file of the recording folder, which may be edited.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from acquisition.times import TIME_FORMS, recognised
from ballbar.recordings.preview import LogPreview, number
from ballbar.recordings.proposals import counting
from ballbar.recordings.questions import Ask, answer, one_of, time_form
from cell.arrays import Array
from cell.errors import InputError
from cell.logs import SourceName

PERIODS = (2.0e-4, 0.1)  # [s] of rows that a robot or ball-bar logger writes without a remark
DEGREES = 7.0  # a joint angle above it [rad] would be more than a turn
_AXES = range(5, 9)
_TIME_NAME = re.compile(r"(time|zeit|t|stamp|timestamp|date|datum|uhrzeit)\b", re.IGNORECASE)


def new_dialect(
    source: SourceName, log: LogPreview, time: str | None, ask: Ask
) -> tuple[dict[str, Any], str | None]:
    """A dialect (ballbar-dialect/1) for a table, and the form of its stamps where they hide it.

    source : robot, ballbar or length. time : the form, where an option gave it.

    Raises InputError where no header shows, or an answer is missing.
    """
    if len(log.columns) < 2 or not log.rows:
        raise InputError(
            f"{log.name}: no line of column names shows above the rows, so no dialect can be "
            "made from it. Write one (docs, Read your own log) and name its file."
        )
    dated = [n for n in log.columns if recognised(log.cells(n)[0], TIME_FORMS)]
    named = [n for n in log.columns if _TIME_NAME.match(n)]
    proposal = next(iter((*dated, *named)), None)
    question = f"{log.name}: which column holds the time stamps? Columns: {', '.join(log.columns)}."
    column = answer(None, question, proposal, one_of(*log.columns), ask)
    cells, hidden = log.cells(column), None
    form: str | None = recognised(cells[len(cells) // 2], TIME_FORMS) if time is None else None
    if form is None:
        stamps = _numbers(log, column)
        form = hidden = time_form(log.name, stamps, periods=PERIODS, given=time, ask=ask)
    commas = log.separator != "," and any(
        "," in cell and number(cell) is not None for row in log.rows for cell in row
    )
    data: dict[str, Any] = {
        "schema": "ballbar-dialect/1",
        "source": source,
        "separators": [log.separator],
        "decimal": "comma" if commas else "point",
        "time": {"column": column, "forms": [form]},
    }
    if source == "robot":
        data |= _angles(log, [name for name in log.columns if name != column], ask)
    return data | {"period_s": list(PERIODS)}, hidden


def _numbers(log: LogPreview, name: str) -> Array:
    """(N,) numbers of a column, without the cells that are none."""
    return np.array([value for value in log.numbers(name) if value is not None])


def _one_an_axis(names: Sequence[str], reply: str) -> list[str]:
    """The columns of a reply, one for each axis; names : of the columns that there are."""
    chosen = [part.strip() for part in reply.split(",")]
    if unknown := [name for name in chosen if name not in names]:
        raise InputError(f"{unknown[0]!r} is no column. Columns: {', '.join(names)}.")
    if len(chosen) not in _AXES:
        raise InputError(f"{len(chosen)} columns; expected one for each axis, 5 to 8.")
    return chosen


def _angles(log: LogPreview, names: Sequence[str], ask: Ask) -> dict[str, Any]:
    """Columns, kind and unit of a robot's angles; names : of the columns that may hold them."""
    question = f"{log.name}: which columns hold the angles, in the order of the axes?"
    likely = next((family for family in counting(names).values() if len(family) in _AXES), ())
    chosen = answer(None, question, ", ".join(likely) or None, partial(_one_an_axis, names), ask)
    question = (
        f"{log.name}: which angles are they? (motors: motor angles; axes: as the controller shows "
        "them; joints: of the DH model)"
    )
    kind = answer(None, question, None, one_of("motors", "axes", "joints"), ask)
    largest = max(float(np.abs(_numbers(log, name)).max(initial=0.0)) for name in chosen)
    proposal = "deg" if kind != "motors" and largest > DEGREES else None
    question = f"{log.name}: in which unit? The largest is {largest:.4g}. (rad or deg)"
    unit = answer(None, question, proposal, one_of("rad", "deg"), ask)
    return {kind: chosen, "angle_unit": unit}
