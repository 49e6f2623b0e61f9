"""Time stamps of a log: order, duplicates, gaps, and float seconds counted from the first row.

Stamps stay as the device wrote them (integer nanoseconds, or float seconds) until the first one has been subtracted.
A stamp that goes back means that the clock or the recorder restarted; nothing here reorders.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from acquisition.dialect import TICKS_PER_SECOND, TimeColumn
from acquisition.report import Finding, finding
from acquisition.table import Table
from cell.errors import LogError

OVERRUN = 1.25  # times the nominal period; an overrun PLC cycle shows as 1.5 (thesis sec. 4.6: 15 ms for 10 ms)
GAP = 3.0  # times the nominal period; beyond it rows are missing


def in_order(table: Table, time: TimeColumn, findings: list[Finding]) -> Table:
    """The rows of one file with strictly increasing stamps; of rows with the same stamp the first is kept.

    Raises LogError where the stamps go back.
    """
    stamps = table.columns[time.column]
    if stamps.min() < 0:
        raise LogError(f"{table.place(int(np.argmin(stamps)))}: time stamp {stamps.min()} is negative.")
    step = np.diff(stamps)
    back = np.flatnonzero(step < 0)
    if back.size:
        amount = _amount(-float(step[back[0]]) / TICKS_PER_SECOND[time.unit])
        raise LogError(
            f"{table.place(back[0] + 1)}: stamp goes back by {amount}. The clock was set or the recorder restarted: "
            "split the file before this line and read the parts as two recordings."
        )
    repeated = np.flatnonzero(step == 0) + 1
    if not repeated.size:
        return table
    sentence = "same stamp as the row before; the first row of each stamp is kept."
    findings.append(finding("duplicate stamp", "repaired", table.files[0], sentence, lines=table.line[repeated]))
    return table.take(np.concatenate(([True], step > 0)))


def join(tables: list[Table], time: TimeColumn) -> Table:
    """Several files of one source as one table, in order of their first stamps.

    Raises LogError if two of them overlap.
    """
    ordered = sorted(tables, key=lambda table: table.columns[time.column][0])
    for before, after in pairwise(ordered):
        overlap = float(before.columns[time.column][-1] - after.columns[time.column][0]) / TICKS_PER_SECOND[time.unit]
        if overlap >= 0.0:
            raise LogError(
                f"{after.place(0)}: starts {_amount(overlap)} before {before.files[0]} ends. "
                "The files of one source must follow one another on one clock."
            )
    columns = {name: np.concatenate([table.columns[name] for table in ordered]) for name in _common_columns(ordered)}
    index = np.concatenate([np.full(len(table), i, dtype=np.int64) for i, table in enumerate(ordered)])
    return Table(columns, tuple(table.files[0] for table in ordered), index, np.concatenate([table.line for table in ordered]))


def seconds_from_first(stamps: NDArray[np.int64] | NDArray[np.float64], time: TimeColumn) -> NDArray[np.float64]:
    """(N,) [s] since the first stamp, which is subtracted before anything becomes a float."""
    return np.asarray((stamps - stamps[0]) / TICKS_PER_SECOND[time.unit], dtype=np.float64)


def report_periods(table: Table, t: NDArray[np.float64], usual_s: tuple[float, float], findings: list[Finding]) -> None:
    """Append overruns, gaps and an unusual period of a log to `findings`; t : (N,) [s]."""
    step = np.diff(t)
    period = float(np.median(step))
    if not usual_s[0] <= period <= usual_s[1]:
        sentence = f"the median period is {_amount(period)}; logs of this dialect have {_amount(usual_s[0])} to {_amount(usual_s[1])}."
        findings.append(
            finding("unusual period", "warning", table.files[0], sentence + " Is the time column in the declared unit?", count=1)
        )
    gap = step > GAP * period
    _report_steps("overrun", (step > OVERRUN * period) & ~gap, step, period, table, findings)
    _report_steps("gap", gap, step, period, table, findings)


def _report_steps(
    kind: str, where: NDArray[np.bool_], step: NDArray[np.float64], period: float, table: Table, findings: list[Finding]
) -> None:
    """One finding for each file, at the rows that come late."""
    for index, file in enumerate(table.files):
        late = np.flatnonzero(where & (table.file[1:] == index))
        if late.size:
            sentence = f"rows up to {_amount(float(step[late].max()))} after the one before; the nominal period is {_amount(period)}."
            findings.append(finding(kind, "warning", file, sentence, lines=table.line[late + 1]))


def _common_columns(tables: list[Table]) -> list[str]:
    return [name for name in tables[0].columns if all(name in table.columns for table in tables)]


def _amount(seconds: float) -> str:
    if seconds >= 1.0 or seconds == 0.0:
        return f"{seconds:.6g} s"
    return f"{seconds * 1e3:.6g} ms" if seconds >= 1e-5 else f"{seconds * 1e9:.6g} ns"
