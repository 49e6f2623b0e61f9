"""Times of still poses: any form of acquisition.times, or digits of date and time of day."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from acquisition.report import Finding, finding
from acquisition.table.quantities import PoseRows
from acquisition.times import TIME_FORMS, TimeCells, recognised, stamps_ns
from cell.dialect import TimeForm
from cell.errors import DescriptionError, LogError
from cell.pose_file import PoseTime
from cell.schema_errors import nearest

_DIGITS = re.compile(r"(\d{4})(\d\d)(\d\d)(\d\d)(\d\d)(\d\d)(\.\d+)?")  # 20200714163904
_EXPONENT = re.compile(r"[+-]?[0-9.,]+[eE][+-]?[0-9]+")


def pose_stamps(
    time: PoseTime, selector: str, rows: PoseRows
) -> tuple[NDArray[np.int64] | None, tuple[Finding, ...]]:
    """(N,) [ns] stamps of the rows of one file; None, with a finding, if they tell no time.

    Raises LogError for a stamp that is not of the form of the others.
    """
    cells = rows.text(selector)
    if not all(cells):
        empty = rows.line[[not cell for cell in cells]]
        return None, (_dropped(rows, "empty stamps; the times are not used.", empty),)
    # A spreadsheet that shows 14 digits as 2.02E+13 has cut date and time to the month.
    cut = [bool(_EXPONENT.fullmatch(cell)) for cell in cells]
    if any(cut) and not _resolved(cells):
        sentence = f"{cells[cut.index(True)]}: cut by a spreadsheet; the times are not used."
        return None, (_dropped(rows, sentence, rows.line[cut]),)
    if all(map(_DIGITS.fullmatch, cells)) and time.form is None:
        cells = [_DIGITS.sub(r"\1-\2-\3 \4:\5:\6\7", cell) for cell in cells]
    column = TimeCells(rows.file, selector, cells, rows.line)
    return stamps_ns(column, _form(time, column))


def _form(time: PoseTime, column: TimeCells) -> TimeForm:
    if time.form is not None:
        if time.form not in TIME_FORMS:
            raise DescriptionError(
                f"poses.yaml: unknown form of time {time.form!r}."
                f"{nearest(time.form, get_args(TimeForm), noun='form')}"
            )
        return next(form for form in TIME_FORMS if form == time.form)
    form = recognised(str(column.cells[0]), TIME_FORMS)
    if form is None:
        raise LogError(
            f"{column.location(0)} does not show its form. Declare it in poses.yaml: `time: "
            f"{{column: {time.column}, form: s}}`; forms: {', '.join(TIME_FORMS)}."
        )
    return form


def _resolved(cells: Sequence[str]) -> bool:
    """Whether numbers in exponent form tell the poses apart: most of them differ."""
    return len(set(cells)) > 0.5 * len(cells)


def _dropped(rows: PoseRows, sentence: str, lines: NDArray[np.int64]) -> Finding:
    return finding("time not used", "repaired", rows.file, sentence, lines=lines)
