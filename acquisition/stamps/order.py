"""Time stamps of a log: order, duplicates, gaps, and float seconds counted from the first row.

Stamps are integer nanoseconds until the first one has been subtracted. A stamp that goes back means
that the clock was set or the recorder started again: a new segment. Rows are put in another order
only where their sequence numbers say so.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.flags import RowFlag
from ballbar.acquisition.table.table import Table
from ballbar.acquisition.times import Stamps
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError

# Column that holds the stamps, whatever the file calls them; its blank keeps it apart from all
# headers.
STAMP = "stamp [ns]"
# Times the nominal period; an overrun PLC cycle shows as 1.5 (thesis sec. 4.6: 15 ms for 10 ms).
OVERRUN = 1.25
GAP = 3.0  # times the nominal period; beyond it rows are missing
IRREGULAR = 5.0  # times what the stamps usually vary by
FINEST = 5e-5  # [s] what a stamp may be off without any harm: 25 urad at 0.5 rad/s
STRAY_LIMIT = 0.01  # of the rows: more stamps out of place are no accident
COARSE = 0.1  # of the rows may share a stamp and not a value; more, and the clock is too coarse
_LATEST = 100  # rows: a message is late by no more


def in_sequence(table: Table, sequence: str | None) -> Table:
    """The rows of one file in the order of their sequence numbers.

    sequence : column that holds them, if there is one.
    Raises LogError for a negative stamp.
    """
    stamps = table.columns[STAMP]
    if stamps.size and stamps.min() < 0:
        row = int(np.argmin(stamps))
        raise LogError(
            f"{table.location(row)}: time stamp {stamps[row] * 1e-9:.9g} s is negative. "
            "Log a clock that counts up from its start, or cut this row out."
        )
    return table if sequence not in table.columns else _by_sequence(table, sequence)


def _by_sequence(table: Table, sequence: str) -> Table:
    """Rows by sequence number within each stretch.

    A number that falls far back is a new start of the logger.
    """
    step = np.diff(table.columns[sequence])
    if (step == 0).any():
        sentence = "same sequence number as the row before: read twice; the first is kept."
        again = np.flatnonzero(step == 0) + 1
        table = table.remarked("row read twice", sentence, rows=again)
        table = table.take(np.concatenate(([True], step != 0)))
        step = np.diff(table.columns[sequence])
    late = np.flatnonzero((step < 0) & (step >= -_LATEST)) + 1
    if not late.size:
        return table
    stretch = np.concatenate(([0], np.cumsum(step < -_LATEST)))
    order = np.lexsort((table.columns[sequence], stretch))
    sentence = "rows put in the order of their sequence numbers."
    table = table.remarked("rows out of order", sentence, rows=late).take(order)
    table = table.flagged(order != np.arange(order.size), RowFlag.REORDERED)
    restarted = np.diff(stretch[order], prepend=0) > 0
    return replace(table, begins=table.begins | restarted)


def without_strays(table: Table) -> Table:
    """The rows of one file without those whose stamp alone is out of place.

    Raises LogError where these are too many.
    """
    stamps = table.columns[STAMP]
    step = np.diff(stamps)
    back, forward = np.flatnonzero(step < 0) + 1, step[step > 0]
    if not back.size or not forward.size:
        return table
    close = GAP * float(np.median(forward))
    stray = np.zeros(stamps.size, dtype=bool)
    for late in back:
        for row in (late, late - 1):  # too low itself, or the one before too high
            inner = 0 < row < stamps.size - 1 and not stray[max(0, row - 1) : row + 2].any()
            if inner and 0 < stamps[row + 1] - stamps[row - 1] <= close:
                stray[row] = True
                break
    rows = np.flatnonzero(stray)
    if not rows.size:
        return table
    if rows.size > max(1.0, STRAY_LIMIT * stamps.size):
        what = f"out of the order of its neighbours, and so in {rows.size} of {stamps.size} rows."
        remedy = "Log the time at which rows were taken, or a sequence number to put them in order."
        raise LogError.at(table.location(rows[0]), f"the stamp stands {what}", remedy)
    sentence = "the stamp stands out of the order of its neighbours: damaged; row left out."
    return table.remarked("damaged stamp", sentence, rows=rows).take(~stray)


def in_order(table: Table) -> Table:
    """The rows of one file without damaged and repeated stamps.

    Of rows with the same stamp the first remains. Stamps that go back for good remain: a new
    segment begins there (ballbar.acquisition.faults.segments).
    Raises LogError where too many stamps are out of place, or the clock is too coarse.
    """
    table = without_strays(table)
    step = np.diff(table.columns[STAMP])
    repeated = np.flatnonzero(step == 0) + 1
    if not repeated.size:
        return table
    differs = np.zeros(repeated.size, dtype=bool)
    for name, column in table.columns.items():
        if name != STAMP and column.dtype != object:
            differs |= column[repeated] != column[repeated - 1]
    if differs.sum() > COARSE * len(table):
        what = f"{differs.sum()} of {len(table)} rows have the stamp of the row before."
        remedy = "Log a finer clock, or declare `quantised: true` if the rows were taken evenly."
        raise LogError.at(table.location(repeated[0]), f"{what} The clock is too coarse.", remedy)
    sentence = "same stamp as the row before; the first row of each stamp is kept."
    table = table.remarked("duplicate stamp", sentence, rows=repeated)
    first = np.concatenate(([True], step != 0))
    before = np.flatnonzero(first)[np.cumsum(first)[repeated] - 1]
    return table.flagged(before, RowFlag.DUPLICATE).take(first)


def join(tables: list[Table]) -> Table:
    """Several files of one source as one table, in order of their first stamps.

    Each file begins a stretch. Columns that some files lack are left out.
    Raises LogError if two files overlap.
    """
    if len(tables) == 1:
        return tables[0]
    ordered = sorted(tables, key=lambda table: int(table.columns[STAMP][0]))
    for before, after in pairwise(ordered):
        overlap = float(before.columns[STAMP].max() - after.columns[STAMP][0]) * 1e-9
        if overlap >= 0.0:
            what = f"starts {amount(overlap)} before {before.files[0]} ends."
            remedy = "Set the clock right at the logger, or make a recording of each file."
            raise LogError.at(after.location(0), what, remedy)
    common = [name for name in ordered[0].columns if all(name in t.columns for t in tables)]
    index = np.repeat(np.arange(len(ordered), dtype=np.int64), [len(table) for table in ordered])
    begins = np.concatenate([table.begins for table in ordered])
    return Table(
        columns={name: np.concatenate([t.columns[name] for t in ordered]) for name in common},
        files=tuple(table.files[0] for table in ordered),
        file=index,
        line=np.concatenate([table.line for table in ordered]),
        flags=np.concatenate([table.flags for table in ordered]),
        begins=begins | (np.diff(index, prepend=0) > 0),
        findings=tuple(chain.from_iterable(table.findings for table in tables)),
    )


def seconds_from(stamps: Stamps, first: int | np.integer) -> Array:
    """(N,) [s] from the stamp `first` [ns] to stamps (N,) [ns].

    It is subtracted before anything becomes a float.
    """
    t = np.empty(stamps.size)
    np.subtract(stamps, first, out=t, casting="unsafe")  # of integers, then made floats
    t /= 1_000_000_000
    return t


def seconds(table: Table) -> Array:
    """(N,) [s] from the first row of a table."""
    return seconds_from(table.columns[STAMP], table.columns[STAMP][0])


def with_periods_checked(table: Table, t: Array, usual_s: tuple[float, float]) -> Table:
    """The table with overruns and gaps flagged; they and an unusual period are reported.

    t : (N,) [s] of the rows. usual_s : shortest and longest usual period [s] of the dialect.
    """
    step = np.diff(t)
    period = float(np.median(step))
    if not usual_s[0] <= period <= usual_s[1]:
        usual = f"logs of this dialect have {amount(usual_s[0])} to {amount(usual_s[1])}"
        sentence = f"the median period is {amount(period)}; {usual}. Is it in the declared unit?"
        table = table.remarked("unusual period", sentence, count=1)
    gap = step > GAP * period
    overrun = (step > OVERRUN * period) & ~gap
    late = (("overrun", overrun, RowFlag.OVERRUN), ("gap", gap, RowFlag.GAP))
    for kind, steps, flag in late:
        most = amount(float(step[steps].max(initial=0.0)))
        sentence = f"rows up to {most} after the one before; nominal period {amount(period)}."
        table = table.remarked(kind, sentence, rows=np.flatnonzero(steps) + 1, flag=flag)
    return _with_irregular(table, step, period, gap | overrun)


def _with_irregular(table: Table, step: Array, period: float, known: NDArray[np.bool_]) -> Table:
    """The table with a few steps (N-1,) [s] reported that differ from the period [s] of the others.

    The clock was set there, or a stamp is damaged. known : (N-1,) gaps and overruns.
    """
    off = step - period
    np.abs(off, out=off)
    if off.max() <= FINEST:
        return table
    regular = off[~known]
    usual = float(np.quantile(regular, 0.95, overwrite_input=True)) if regular.size else 0.0
    del regular  # of a log of hours
    odd = np.flatnonzero((off > max(IRREGULAR * usual, FINEST)) & ~known) + 1
    if not 0 < odd.size <= max(3.0, STRAY_LIMIT * off.size):
        return table
    most, others = amount(float(off[odd - 1].max())), amount(max(usual, 1e-9))
    sentence = f"up to {most} off the period, which the other rows keep to {others}."
    return table.remarked("irregular stamp", sentence, rows=odd)


def amount(seconds: float) -> str:
    """Text of a duration, such as `3.2 ms`."""
    if seconds >= 1.0 or seconds == 0.0:
        return f"{seconds:.6g} s"
    return f"{seconds * 1e3:.6g} ms" if seconds >= 1e-5 else f"{seconds * 1e9:.6g} ns"
