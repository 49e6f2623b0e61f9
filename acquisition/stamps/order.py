"""Time stamps of a log: order, duplicates, gaps, and float seconds counted from the first row.

Stamps are integer nanoseconds until the first one has been subtracted. A stamp that goes back means that the clock was set or
the recorder started anew: a new segment. Rows are put in another order only where their sequence numbers say so.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from acquisition.flags import Flags, RowFlag
from acquisition.report import Finding, finding
from acquisition.table.table import Table
from acquisition.times import Stamps
from cell.errors import LogError

STAMP = "stamp [ns]"  # column that holds the stamps, whatever the file calls them; no header can have that name, for its blank
OVERRUN = 1.25  # times the nominal period; an overrun PLC cycle shows as 1.5 (thesis sec. 4.6: 15 ms for 10 ms)
GAP = 3.0  # times the nominal period; beyond it rows are missing
IRREGULAR = 5.0  # times what the stamps usually vary by
FINEST = 5e-5  # [s] what a stamp may be off without any harm: 25 urad at 0.5 rad/s
STRAY_LIMIT = 0.01  # of the rows: more stamps out of place are no accident
COARSE = 0.1  # of the rows may share a stamp and not a value; more, and the clock is too coarse for the rows


def in_sequence(table: Table, sequence: str | None, findings: list[Finding]) -> Table:
    """The rows of one file in the order of their sequence numbers; sequence : column that holds them, if there is one.

    Raises LogError for a negative stamp.
    """
    stamps = table.columns[STAMP]
    if stamps.size and stamps.min() < 0:
        raise LogError(
            f"{table.place(int(np.argmin(stamps)))}: time stamp {stamps.min() * 1e-9:.9g} s is negative."
        )
    return (
        table
        if sequence is None or sequence not in table.columns
        else _by_sequence(table, sequence, findings)
    )


def in_order(table: Table, findings: list[Finding]) -> Table:
    """The rows of one file without damaged and repeated stamps.

    Of rows with the same stamp the first is kept. Stamps that go back for good stay: there a new segment begins
    (acquisition.faults.segments).
    Raises LogError where too many stamps are out of place, or the clock is too coarse.
    """
    return _without_repeats(_without_strays(table, findings), findings)


def _by_sequence(table: Table, sequence: str, findings: list[Finding]) -> Table:
    """Rows by sequence number within each stretch; a number that falls far back is a new start of the logger."""
    number = table.columns[sequence]
    step = np.diff(number)
    repeated = np.flatnonzero(step == 0) + 1
    if repeated.size:
        sentence = "same sequence number as the row before: read twice; the first is kept."
        findings.append(
            finding(
                "row read twice", "repaired", table.files[0], sentence, lines=table.line[repeated]
            )
        )
        table = table.take(np.concatenate(([True], step != 0)))
        number = table.columns[sequence]
        step = np.diff(number)
    late = np.flatnonzero((step < 0) & (step >= -_REACH)) + 1
    if not late.size:
        return table
    stretch = np.concatenate(([0], np.cumsum(step < -_REACH)))
    order = np.lexsort((number, stretch))
    moved = order != np.arange(order.size)
    sentence = "rows put in the order of their sequence numbers."
    findings.append(
        finding("rows out of order", "repaired", table.files[0], sentence, lines=table.line[late])
    )
    table = table.take(order)
    table.flags[moved] |= np.uint32(RowFlag.REORDERED)
    table.begins[1:] |= np.diff(stretch[order]) > 0
    return table


_REACH = 100  # rows: a message is late by no more


def _without_strays(table: Table, findings: list[Finding]) -> Table:
    """Rows whose stamp alone is out of place, between neighbours that follow each other, are left out."""
    stamps = table.columns[STAMP]
    step = np.diff(stamps)
    forward = step[step > 0]
    if not forward.size:
        return table
    near = GAP * float(np.median(forward))
    stray = np.zeros(stamps.size, dtype=bool)
    for row in np.flatnonzero(step < 0) + 1:
        for one in (row, row - 1):  # too low itself, or the one before too high
            if (
                0 < one < stamps.size - 1
                and not stray[max(0, one - 1) : one + 2].any()
                and 0 < stamps[one + 1] - stamps[one - 1] <= near
            ):
                stray[one] = True
                break
    rows = np.flatnonzero(stray)
    if not rows.size:
        return table
    if rows.size > max(1.0, STRAY_LIMIT * stamps.size):
        raise LogError(
            f"{table.place(rows[0])}: the stamp stands out of the order of its neighbours, and so in {rows.size} of {stamps.size} rows. "
            "Rows that come late need a sequence number to be put in order: log it, or the time at which they were taken."
        )
    sentence = (
        "the stamp stands out of the order of its neighbours, so it is damaged; row left out."
    )
    findings.append(
        finding("damaged stamp", "repaired", table.files[0], sentence, lines=table.line[rows])
    )
    return table.take(~stray)


def _without_repeats(table: Table, findings: list[Finding]) -> Table:
    step = np.diff(table.columns[STAMP])
    repeated = np.flatnonzero(step == 0) + 1
    if not repeated.size:
        return table
    values = [
        column for name, column in table.columns.items() if name != STAMP and column.dtype != object
    ]
    other = np.zeros(repeated.size, dtype=bool)
    for column in values:
        other |= column[repeated] != column[repeated - 1]
    if other.sum() > COARSE * len(table):
        raise LogError(
            f"{table.place(repeated[0])}: {other.sum()} of {len(table)} rows have the stamp of the row before but other values. "
            "The clock is too coarse for the rows: log a finer one, or declare `quantised: true` if the rows were taken evenly."
        )
    sentence = "same stamp as the row before; the first row of each stamp is kept."
    findings.append(
        finding("duplicate stamp", "repaired", table.files[0], sentence, lines=table.line[repeated])
    )
    kept = np.concatenate(([True], step != 0))
    before = np.flatnonzero(kept)[np.cumsum(kept)[repeated] - 1]
    table.flags[before] |= np.uint32(RowFlag.DUPLICATE)
    return table.take(kept)


def join(tables: list[Table]) -> Table:
    """Several files of one source as one table, in order of their first stamps; each file begins a stretch.

    Raises LogError if two of them overlap.
    """
    if len(tables) == 1:
        return tables[0]
    ordered = sorted(tables, key=lambda table: int(table.columns[STAMP][0]))
    for before, after in pairwise(ordered):
        overlap = float(before.columns[STAMP].max() - after.columns[STAMP][0]) * 1e-9
        if overlap >= 0.0:
            raise LogError(
                f"{after.place(0)}: starts {amount(overlap)} before {before.files[0]} ends. "
                "The files of one source must follow one another on one clock."
            )
        after.begins[0] = True
    columns = {
        name: np.concatenate([table.columns[name] for table in ordered])
        for name in _common_columns(ordered)
    }
    index = np.concatenate(
        [np.full(len(table), i, dtype=np.int64) for i, table in enumerate(ordered)]
    )
    return Table(
        columns,
        tuple(table.files[0] for table in ordered),
        index,
        np.concatenate([table.line for table in ordered]),
        np.concatenate([table.flags for table in ordered]),
        np.concatenate([table.begins for table in ordered]),
    )


def seconds_from(stamps: Stamps, first: int | np.integer) -> NDArray[np.float64]:
    """(N,) [s] since a stamp, which is subtracted before anything becomes a float."""
    return np.asarray((stamps - first) / 1_000_000_000, dtype=np.float64)


def report_periods(
    table: Table, t: NDArray[np.float64], usual_s: tuple[float, float], findings: list[Finding]
) -> Flags:
    """(N,) flags of overruns and gaps of a log; they and an unusual period are appended to `findings`; t : (N,) [s]."""
    step = np.diff(t)
    period = float(np.median(step))
    if not usual_s[0] <= period <= usual_s[1]:
        sentence = f"the median period is {amount(period)}; logs of this dialect have {amount(usual_s[0])} to {amount(usual_s[1])}."
        findings.append(
            finding(
                "unusual period",
                "warning",
                table.files[0],
                sentence + " Is the time column in the declared unit?",
                count=1,
            )
        )
    gap = step > GAP * period
    overrun = (step > OVERRUN * period) & ~gap
    _report_steps("overrun", overrun, step, period, table, findings)
    _report_steps("gap", gap, step, period, table, findings)
    _report_irregular(step, period, gap | overrun, table, findings)
    flags = np.zeros(t.size, dtype=np.uint32)
    flags[1:] = gap * np.uint32(RowFlag.GAP) | overrun * np.uint32(RowFlag.OVERRUN)
    return flags


def _report_irregular(
    step: NDArray[np.float64],
    period: float,
    known: NDArray[np.bool_],
    table: Table,
    findings: list[Finding],
) -> None:
    """A few steps that differ from the period, in a log that otherwise keeps it: the clock was set, or a stamp is damaged."""
    off = np.abs(step - period)
    if off.max() <= FINEST:
        return
    usual = float(np.quantile(off[~known], 0.95)) if (~known).any() else 0.0
    odd = np.flatnonzero((off > max(IRREGULAR * usual, FINEST)) & ~known) + 1
    if 0 < odd.size <= max(3.0, STRAY_LIMIT * off.size):
        sentence = f"up to {amount(float(off[odd - 1].max()))} off the period, which the other rows keep to {amount(max(usual, 1e-9))}."
        file = table.files[table.file[odd[0]]]
        findings.append(
            finding("irregular stamp", "warning", file, sentence, lines=table.line[odd])
        )


def _report_steps(
    kind: str,
    where: NDArray[np.bool_],
    step: NDArray[np.float64],
    period: float,
    table: Table,
    findings: list[Finding],
) -> None:
    """One finding for each file, at the rows that come late."""
    for index, file in enumerate(table.files):
        late = np.flatnonzero(where & (table.file[1:] == index))
        if late.size:
            sentence = f"rows up to {amount(float(step[late].max()))} after the one before; the nominal period is {amount(period)}."
            findings.append(finding(kind, "warning", file, sentence, lines=table.line[late + 1]))


def _common_columns(tables: list[Table]) -> list[str]:
    return [name for name in tables[0].columns if all(name in table.columns for table in tables)]


def amount(seconds: float) -> str:
    """A duration in words."""
    if seconds >= 1.0 or seconds == 0.0:
        return f"{seconds:.6g} s"
    return f"{seconds * 1e3:.6g} ms" if seconds >= 1e-5 else f"{seconds * 1e9:.6g} ns"
