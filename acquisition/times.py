"""Time stamps of device logs to integer nanoseconds, exactly.

They are clock counts of several epochs and units, dates (year first, or day first with points), or
IEC times. A clock that counts from an
epoch shows which one by its size: from 2016 to 2036 the counts of Windows (100 ns since 1601), of
the distributed clock (ns since 2000) and of Unix (since 1970) lie in ranges that do not overlap.
Counts without epoch (up-time, CPU counter) show nothing of the kind: their unit is declared, never
guessed.

Stamps with an epoch become ns since 1970, others ns since wherever the clock began.
Sources: Beckhoff, time sources of TwinCAT; FILETIME, DCTIME64 and TIME conversions of its
libraries.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.report import Finding, finding
from ballbar.cell.dialect import TimeForm
from ballbar.cell.errors import DescriptionError, LogError
from ballbar.cell.schema_errors import nearest

Stamps = NDArray[np.int64]
TIME_FORMS: tuple[TimeForm, ...] = get_args(TimeForm)
COARSEST = 1_000_000  # [ns] a stamp that a spreadsheet rounded to no worse is still a stamp
EARLIEST, LATEST = 1980, 2100  # years; a controller that has lost its battery starts in 1980
_WHOLE, _DECIMAL = re.compile(r"[+-]?[0-9]{1,20}"), re.compile(r"([+-]?)([0-9]*)\.?([0-9]*)")
_EXPONENT = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][+-]?[0-9]{1,3}")
# Year first (2026-03-31), or day first with points (31.03.2026). SYSTEMTIME_TO_STRING and
# DCTIME64_TO_STRING put a dash between date and time.
_DATE = re.compile(
    r"(?:DT#|DATE_AND_TIME#|LDT#)?"
    r"(?:(?P<year>\d{4})-(?P<month>\d\d)-(?P<day>\d\d)|(?P<dd>\d\d?)\.(?P<mm>\d\d?)\.(?P<yyyy>\d{4}))"
    r"[- T](?P<clock>\d\d?:\d\d:\d\d)(?:[.,](?P<fraction>\d{1,9}))?(?:Z|\+00:00)?",
    re.IGNORECASE,
)
_SHORT_YEAR = re.compile(r"\d\d?[.\-/]\d\d?[.\-/]\d\d[ T]\d\d?:\d\d.*")  # 31.03.26 08:15
_IEC = re.compile(
    r"L?T(?:IME)?#(-?)(?:(\d+)d)?_?(?:(\d+)h)?_?(?:(\d+)m(?!s))?_?(?:(\d+)s)?_?(?:(\d+)ms)?",
    re.IGNORECASE,
)
FILETIME_1970 = 116_444_736_000_000_000  # [100 ns] from 1601 to 1970
SINCE_2001 = 10**18  # [ns] no clock without epoch counts so far
_DC_1970 = 946_684_800_000_000_000  # [ns] from 1970 to 2000
_SECONDS = re.compile(r"(?<![A-Za-z])(secs?|seconds)$")
_NANOSECONDS = {
    "sec": ("nanosec", "nsec"),
    "secs": ("nsecs", "nanosecs"),
    "seconds": ("nanoseconds",),
}
_REMEDY = "Correct the cell, or declare the form of the stamps in recording.yaml under `time`."
_WRAP = 2**32
_MOST_NS = 9.2e18  # of 64 bits


@dataclass(frozen=True)
class _Count:
    """A number of ticks."""

    tick: int  # [ns]
    start: int = 0  # [ticks] count at 1970
    # Counts from 2016 to 2036, by which the form is recognised; None if they do not show it.
    between: tuple[float, float] | None = None
    wraps: bool = False  # after 32 bits
    words: str = ""


_COUNTS: dict[str, _Count] = {
    "s": _Count(10**9, words="s"),
    "ms": _Count(10**6, words="ms"),
    "us": _Count(10**3, words="us"),
    "100ns": _Count(100, words="100 ns"),
    "ns": _Count(1, words="ns"),
    "ms-32bit": _Count(10**6, wraps=True, words="ms in 32 bits"),
    "ns-32bit": _Count(1, wraps=True, words="ns in 32 bits"),
    "filetime": _Count(
        100, FILETIME_1970, (1.31e17, 1.38e17), words="100 ns since 1601 (FILETIME)"
    ),
    "dc": _Count(1, -_DC_1970, (5.0e17, 1.14e18), words="ns since 2000 (distributed clock)"),
    "unix-s": _Count(10**9, 0, (1.45e9, 2.1e9), words="s since 1970"),
    "unix-ms": _Count(10**6, 0, (1.45e12, 2.1e12), words="ms since 1970"),
    "unix-us": _Count(10**3, 0, (1.45e15, 2.1e15), words="us since 1970"),
    "unix-ns": _Count(1, 0, (1.45e18, 2.1e18), words="ns since 1970"),
}
_WORDS = {"date": "dates with time of day", "iec-time": "IEC times (T#1h2m3s4ms)"}


@dataclass(frozen=True, eq=False)
class TimeCells:
    """The time column of one file as it stands there."""

    file: str
    column: str
    cells: Sequence[str] | NDArray[Any]  # (N,) text; int64 or float64 where the file holds numbers
    line: NDArray[np.int64]  # (N,)

    def location(self, row: int) -> str:
        """`file:line: column name: cell` of a row."""
        return f"{self.file}:{self.line[row]}: column {self.column}: {str(self.cells[row])!r}"


def words(form: TimeForm) -> str:
    """Text of a form of time stamps, such as `ms since 1970`."""
    return _COUNTS[form].words if form in _COUNTS else _WORDS[form]


def forms_by_start() -> dict[str, list[TimeForm]]:
    """All forms of time stamps by what they count from."""
    out: dict[str, list[TimeForm]] = {}
    for form in TIME_FORMS:
        if form in _WORDS:
            start = "text"
        elif _COUNTS[form].between is None:
            start = "counted from any start"
        else:
            start = "counted since 1601, 1970 or 2000"
        out.setdefault(start, []).append(form)
    return out


def recognised(cell: str, forms: Sequence[TimeForm]) -> TimeForm | None:
    """The only one of several forms that a stamp may have; None if none or several fit."""
    if _DATE.fullmatch(cell) or _SHORT_YEAR.fullmatch(cell):
        return "date" if "date" in forms else None
    if _is_iec(cell):
        return "iec-time" if "iec-time" in forms else None
    try:
        value = float(cell)
    except ValueError:
        return None
    fits: list[TimeForm] = []
    for form in forms:
        between = _COUNTS[form].between if form in _COUNTS else None
        if between is not None and between[0] <= value <= between[1]:
            fits.append(form)
    return fits[0] if len(fits) == 1 else None


def checked_form(declared: str, place: str) -> TimeForm:
    """The form of time stamps of that name. Raises DescriptionError, beginning with `place`."""
    for form in TIME_FORMS:
        if form == declared:
            return form
    choices = nearest(declared, TIME_FORMS, noun="form")
    raise DescriptionError(f"{place}: unknown form of time {declared!r}.{choices}")


def form_shown(time: TimeCells, forms: Sequence[TimeForm], declare: str) -> TimeForm:
    """The form that the first, middle and last stamp show.

    declare : how it can be declared instead, such as "in recording.yaml: `time: ms`".
    Raises LogError if they show none, or several.
    """
    rows = {0, len(time.cells) // 2, len(time.cells) - 1}
    shown = {recognised(str(time.cells[row]), forms) for row in rows} - {None}
    if len(shown) == 1:
        return next(form for form in forms if form in shown)
    remedy = f"Declare it {declare}; forms: {', '.join(TIME_FORMS)}."
    raise LogError.at(time.location(0), "the form of the time stamps does not show.", remedy)


def stamps_ns(time: TimeCells, form: TimeForm) -> tuple[Stamps, tuple[Finding, ...]]:
    """(N,) [ns] stamps of one file, and findings about what was rounded in the file.

    Raises LogError for a stamp that is not of that form.
    """
    if form == "date":
        return _dates(time), ()
    if form == "iec-time":
        return unwrapped(_iec_times(time), 10**6), ()
    count = _COUNTS[form]
    ns, findings = _counts(time, count)
    if ns.size and count.between is not None:
        _refuse_other_epoch(time, ns, count, count.between)
    return unwrapped(ns, count.tick) if count.wraps else ns, findings


def unwrapped(ns: Stamps, tick: int) -> Stamps:
    """(N,) [ns] stamps (N,) [ns] of a 32-bit clock, ticks of `tick` [ns], without its wraps.

    A stamp that goes back by half the clock's range or more has wrapped.
    """
    span = _WRAP * tick
    back = np.diff(ns, prepend=ns[:1])
    return np.asarray(ns + span * np.cumsum(back < -(span // 2)))


def two_columns(names: Sequence[str]) -> tuple[str, str] | None:
    """Names of whole seconds and of the nanoseconds beside them; None where there are not two.

    ROS flattens the stamp that a device gave its message to `sec` and `nanosec`.
    """
    pairs = (
        (name, name[: ending.start(1)] + nano)
        for name in names
        if (ending := _SECONDS.search(name))
        for nano in _NANOSECONDS[ending[1]]
    )
    return next((pair for pair in pairs if pair[1] in names), None)


def popped_stamps(
    columns: dict[str, Any], names: Sequence[str], file: str, line: NDArray[np.int64]
) -> TimeCells:
    """The stamps of one column, or in ns of whole seconds and nanoseconds, taken out of `columns`.

    line : (N,) of the rows. Raises LogError for two numbers that are no such stamp.
    """
    cells = [columns.pop(name) for name in names]
    stamps = TimeCells(file, " and ".join(names), cells[0], line)
    if len(cells) == 1:
        return stamps
    whole, nano = (np.asarray(cell, dtype=np.float64) for cell in cells)  # exact to 9e15
    wrong = (np.rint(whole) != whole) | (np.abs(whole) * 1e9 > _MOST_NS)
    wrong |= (np.rint(nano) != nano) | (nano < 0) | (nano >= 1e9)
    if wrong.any():
        row = int(np.argmax(wrong))
        what = f"and {nano[row]} are no whole seconds with nanoseconds below 1e9."
        raise _wrong(stamps, row, what)
    return replace(stamps, cells=whole.astype(np.int64) * 10**9 + nano.astype(np.int64))


def _is_iec(cell: str) -> bool:
    return bool((match := _IEC.fullmatch(cell)) and any(match.groups()[1:]))


def _counts(time: TimeCells, count: _Count) -> tuple[Stamps, tuple[Finding, ...]]:
    """(N,) [ns] since 1970, or since the clock began, of numbers of ticks."""
    cells = time.cells
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "iu":
        return _scaled(time, cells.astype(np.int64), count), ()
    if isinstance(cells, np.ndarray) and cells.dtype.kind == "f":
        ns = np.rint((cells - count.start) * count.tick)
        _refuse_far(time, ns, count)
        return np.asarray(ns, dtype=np.int64), ()
    try:
        whole = np.array(cells, dtype=np.int64) if all(map(_WHOLE.fullmatch, cells)) else None
    except (OverflowError, ValueError):
        whole = None
    return _decimals(time, count) if whole is None else (_scaled(time, whole, count), ())


def _scaled(time: TimeCells, whole: Stamps, count: _Count) -> Stamps:
    from_start = whole - count.start
    _refuse_far(time, from_start.astype(np.float64) * count.tick, count)
    return np.asarray(from_start * count.tick)


def _refuse_far(time: TimeCells, ns: NDArray[np.float64], count: _Count) -> None:
    """Raises LogError for a stamp (N,) [ns] that 64 bits do not hold."""
    far = np.flatnonzero(np.abs(ns) > _MOST_NS)
    if far.size:
        raise _wrong(time, int(far[0]), f"is no time stamp in {count.words}.")


def _decimals(time: TimeCells, count: _Count) -> tuple[Stamps, tuple[Finding, ...]]:
    """(N,) [ns] of decimal text, exactly: a float64 resolves today's time to 0.2 us only."""
    digits = len(str(count.tick)) - 1  # decimals that a nanosecond needs
    out, rounded = np.empty(len(time.cells), dtype=np.int64), []
    for row, cell in enumerate(time.cells):
        match = _DECIMAL.fullmatch(cell)
        if match and (match[2] or match[3]) and len(match[2]) < 20:
            sign, whole, fraction = match.groups()
            if not digits and fraction.strip("0"):
                raise _wrong(time, row, "is not a whole number of nanoseconds.")
            part = int(fraction[:digits].ljust(digits, "0") or 0)
            part += fraction[digits : digits + 1] >= "5" and digits > 0
            ticks = int(whole or 0) * count.tick + part
            value = (-ticks if sign == "-" else ticks) - count.start * count.tick
        elif _EXPONENT.fullmatch(cell):
            exact = Decimal(cell)
            exponent = exact.as_tuple().exponent
            quantum = Decimal(10) ** (exponent if isinstance(exponent, int) else 0) * count.tick
            if quantum > COARSEST or abs(exact) * count.tick > 10**20:
                raise LogError(
                    f"{time.location(row)} is in exponent form: a spreadsheet has rounded it and "
                    "digits are lost. Use the file as the logger wrote it."
                )
            if quantum > 1:
                rounded.append(row)
            value = int((exact * count.tick).to_integral_value()) - count.start * count.tick
        else:
            raise _wrong(time, row, _why_not(cell))
        if not -(2**63) <= value < 2**63:
            raise _wrong(time, row, f"is no time stamp in {count.words}.")
        out[row] = value
    if not rounded:
        return out, ()
    sentence = "in exponent form, rounded to no worse than 1 ms by a spreadsheet."
    lines = time.line[rounded]
    return out, (finding("rounded stamp", time.file, sentence, lines=lines),)


def _wrong(time: TimeCells, row: int, what: str) -> LogError:
    """The error about a cell, such as `is no time stamp.`"""
    return LogError(f"{time.location(row)} {what} {_REMEDY}")


def _why_not(cell: str) -> str:
    if not cell:
        return "is an empty cell; a time stamp was expected."
    if _DATE.fullmatch(cell) or _is_iec(cell):
        return "is a time stamp of another form than those before it, or than the declared one."
    if _WHOLE.fullmatch(cell) or re.fullmatch(r"[+-]?[0-9]+", cell):
        return "does not fit a 64-bit integer."
    return "is not a number."


def _refuse_other_epoch(
    time: TimeCells, ns: Stamps, count: _Count, between: tuple[float, float]
) -> None:
    """Raises LogError if the first or last stamp (N,) [ns] is far from our time."""
    ticks = ns[[0, -1]].astype(np.float64) / count.tick + count.start
    for row, value in zip((0, -1), ticks, strict=True):
        if value < 0:
            raise LogError(f"{time.location(row)}: time stamp is negative. {_REMEDY}")
        if not 0.5 * between[0] <= value <= 2.0 * between[1]:
            year = 1970 + ns[row] / 3.156e16
            raise LogError(
                f"{time.location(row)} is no {count.words}: that would be the year {year:.0f}. "
                "Another form? Declare it in recording.yaml under `time`."
            )


def _dates(time: TimeCells) -> Stamps:
    texts = []
    for row, cell in enumerate(time.cells):
        match = _DATE.fullmatch(str(cell))
        if not match:
            raise _no_date(time, row, str(cell))
        year = match["year"] or match["yyyy"]
        if not EARLIEST <= int(year) <= LATEST:
            raise _wrong(time, row, "is no date of our time.")
        month, day = match["month"] or match["mm"], match["day"] or match["dd"]
        fraction = (match["fraction"] or "").ljust(9, "0")
        texts.append(f"{year}-{month:0>2}-{day:0>2}T{match['clock']:0>8}.{fraction}")
    try:
        return np.array(texts, dtype="datetime64[ns]").astype(np.int64)
    except ValueError:
        row = next(i for i, text in enumerate(texts) if not _is_date(text))
        raise _wrong(time, row, "is no date of the calendar.") from None


def _no_date(time: TimeCells, row: int, cell: str) -> LogError:
    if _SHORT_YEAR.fullmatch(cell):
        return LogError(
            f"{time.location(row)}: the year has two digits, so day, month and year cannot be "
            "distinguished. Export the log with years of four digits, such as 31.03.2026 or "
            "2026-03-31."
        )
    example = "2016-04-20 13:45:10.123 or 20.04.2016 13:45:10,123"
    return _wrong(time, row, f"is no date with time of day, such as {example}.")


def _is_date(text: str) -> bool:
    try:
        np.datetime64(text)
    except ValueError:
        return False
    return True


def _iec_times(time: TimeCells) -> Stamps:
    out = np.empty(len(time.cells), dtype=np.int64)
    for row, cell in enumerate(time.cells):
        match = _IEC.fullmatch(str(cell))
        parts = [int(part or 0) for part in match.groups()[1:]] if match else []
        given = match is not None and any(match.groups()[1:])
        if match is None or not given or match[1] or max(parts) >= _WRAP:
            raise _wrong(time, row, "is no IEC time, such as T#1h2m3s4ms.")
        days, hours, minutes, seconds, ms = parts
        out[row] = ((((days * 24 + hours) * 60 + minutes) * 60 + seconds) * 1000 + ms) * 10**6
    return out


def day_of(stamps: Stamps) -> str:
    """Day of the last of stamps (N,) [ns], such as 2026-03-31; empty where they have no epoch."""
    last = int(stamps.max(initial=0))
    return str(np.datetime64(last, "ns").astype("datetime64[D]")) if last > SINCE_2001 else ""
