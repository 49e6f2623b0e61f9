"""A dialect for a table that fits none: from what the file shows, and answers to the rest.

Separator, decimal sign, names of columns and the form of dates show; what the numbers mean does
not. The dialect becomes a file of the recording folder, which may be edited.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from functools import partial
from typing import Any, get_args

import numpy as np

from ballbar.acquisition.times import TIME_FORMS, recognised, two_columns
from ballbar.cell.dialect import AngleKind
from ballbar.cell.errors import InputError
from ballbar.cell.logs import SourceName
from ballbar.recordings.answers import Answers
from ballbar.recordings.preview import LogPreview, number
from ballbar.recordings.proposals import ColumnNames, counting, joint_columns
from ballbar.recordings.questions import Ask, answer, one_of, time_form

PERIODS = (2.0e-4, 0.1)  # [s] of rows that a robot or ball-bar logger writes without a remark
DEGREES = 7.0  # a joint angle above it [rad] would be more than a turn
_AXES, _ONE_EACH = range(5, 9), "one for each axis, 5 to 8"
_TIME_NAME = re.compile(r"(time|zeit|t|stamp|timestamp|date|datum|uhrzeit)\b", re.IGNORECASE)


def new_dialect(
    source: SourceName,
    log: LogPreview,
    time: str | None,
    answers: Answers,
    ask: Ask,
    *,
    axes: int = 6,
    point: Sequence[str] = (),
) -> tuple[dict[str, Any], str | None]:
    """A dialect (ballbar-dialect/1) for a table, and the form of its stamps where they hide it.

    source : robot, ballbar, length or tracker. time : the form, where an option gave it. axes : of
    a robot. point : columns of a tracker's x, y and z.

    Raises InputError where no header shows, or an answer is missing.
    """
    if len(log.columns) < 2 or not log.rows:
        raise InputError(
            f"{log.name}: no line of column names shows above the rows, so no dialect can be "
            "made from it. Write one (docs, Read your own log) and name its file."
        )
    seen = joint_columns(ColumnNames(tuple(log.columns), counted=False), axes)
    named = answers.joints.split(",") if answers.joints else [*seen, ()][0]
    likely = [*point, *(name.strip() for name in named if source == "robot")]
    signal = next((name for name in likely if name in log.columns), None)
    columns = _stamp_columns(log, signal, ask)
    cells, hidden = log.filled(columns[0], signal), None
    middle = cells[len(cells) // 2] if cells else ""
    declared: dict[str, Any] = {"column": columns[0]}
    if len(columns) == 2:
        whole = str(10**9 * int(number(middle) or 0.0))
        epoch = recognised(whole, TIME_FORMS) == "unix-ns"
        declared |= {"forms": ["unix-ns"]} if epoch else {"unit": "ns"}
        declared["nanoseconds"] = columns[1]
    else:
        form: str | None = recognised(middle, TIME_FORMS) if time is None else None
        if form is None:
            stamps = np.array([value for cell in cells if (value := number(cell)) is not None])
            form = hidden = time_form(log.name, stamps, periods=PERIODS, given=time, ask=ask)
        declared |= {"forms": [form]}
    commas = log.separator != "," and any(
        "," in cell and number(cell) is not None for row in log.rows for cell in row
    )
    data: dict[str, Any] = {
        "schema": "ballbar-dialect/1",
        "source": source,
        "separators": [log.separator],
        "decimal": "comma" if commas else "point",
        "time": declared,
    }
    if source == "robot":
        names = [name for name in log.columns if name not in columns]
        data |= _angles(log, names, seen, answers, ask)
    if point:
        data["point"] = list(point)
    return data | {"period_s": list(PERIODS)}, hidden


def _stamp_columns(log: LogPreview, signal: str | None, ask: Ask) -> list[str]:
    """The column of the time stamps, or those of seconds and nanoseconds, which go first.

    signal : a column whose rows the stamps have to fill.
    """
    rows = len(log.filled(signal)) if signal else len(log.rows)
    full = [name for name in log.columns if len(log.filled(name, signal)) == rows]
    both = [", ".join(pair)] if (pair := two_columns(full)) else []
    dated = [n for n in full if recognised(log.filled(n, signal)[0], TIME_FORMS)] if rows else []
    named = [n for n in log.columns if _TIME_NAME.match(n)]
    proposal = next(iter((*both, *dated, *named)), None)
    question = f"{log.name}: which column holds the time stamps? Columns: {', '.join(log.columns)}."
    reply = answer(None, question, proposal, one_of(*log.columns, *both), ask)
    return reply.split(", ") if reply in both else [reply]


def named_columns(
    reply: str, names: Sequence[str], counts: Collection[int], expected: str
) -> list[str]:
    """The columns of an answer; raises InputError unless they are among names, and so many.

    expected : the number of columns, as the error says it.
    """
    chosen = [part.strip() for part in reply.split(",")]
    if unknown := [name for name in chosen if name not in names]:
        raise InputError(f"{unknown[0]!r} is no column. Columns: {', '.join(names)}.")
    if len(chosen) not in counts:
        raise InputError(f"{len(chosen)} columns; expected {expected}.")
    return chosen


def _angles(
    log: LogPreview,
    names: Sequence[str],
    seen: Sequence[tuple[str, ...]],
    answers: Answers,
    ask: Ask,
) -> dict[str, Any]:
    """Columns, kind and unit of a robot's angles.

    names : of the columns that may hold them. seen : those whose names say so.
    """
    question = f"{log.name}: which columns hold the angles, in the order of the axes?"
    families = (family for family in counting(names).values() if len(family) in _AXES)
    proposal = ", ".join(next(iter((*seen, *families)), ()))
    check = partial(named_columns, names=names, counts=_AXES, expected=_ONE_EACH)
    chosen = answer(answers.joints, question, proposal or None, check, ask)
    largest = float(np.abs(log.throughout(chosen)).max(initial=0.0))
    question = (
        f"{log.name}: which angles are they? (motors: motor angles; axes: as the controller shows "
        "them; joints: of the DH model)"
    )
    shown = tuple(chosen) in seen and largest > DEGREES  # a controller shows its axes in degrees
    kind = answer(None, question, "axes" if shown else None, one_of(*get_args(AngleKind)), ask)
    proposal = "deg" if kind != "motors" and largest > DEGREES else ""
    question = f"{log.name}: in which unit? The largest is {largest:.4g}. (rad or deg)"
    unit = answer(answers.joint_unit, question, proposal or None, one_of("rad", "deg"), ask)
    return {kind: chosen, "angle_unit": unit}
