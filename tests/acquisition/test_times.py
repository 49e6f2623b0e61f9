"""Time stamps of single cells to nanoseconds, and stamps out of order."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.acquisition.stamps.order import STAMP, in_order
from ballbar.acquisition.table.table import Table
from ballbar.acquisition.times import (
    TIME_FORMS,
    TimeCells,
    day_of,
    forms_by_start,
    stamps_ns,
    words,
)

SECOND = 1_000_000_000  # [ns]


def cells(*texts: str) -> TimeCells:
    return TimeCells("log.csv", "time", texts, np.arange(len(texts)) + 2)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("T#1d", 86_400), ("T#2h", 7_200), ("T#1d2h3m4s", 93_784), ("LT#25h_5s", 90_005)],
)
def test_days_and_hours_of_an_iec_time_count_in_full(text: str, seconds: int) -> None:
    assert stamps_ns(cells(text), "iec-time")[0].tolist() == [seconds * SECOND]


def test_decimals_beyond_the_nanosecond_are_rounded_to_the_nearest() -> None:
    texts = ("7.0000000014", "7.0000000015", "7.00000000149", "-0.0000000016")
    ns = stamps_ns(cells(*texts), "s")[0] - np.array([7, 7, 7, 0]) * SECOND
    assert ns.tolist() == [1, 2, 1, -2]


def stamped(*stamps: int) -> Table:
    rows = len(stamps)
    return Table(
        {STAMP: np.array(stamps)}, ("log.csv",), np.zeros(rows, dtype=np.int64), np.arange(rows) + 2
    )


def test_a_last_stamp_that_goes_back_shows_the_damage_of_the_one_before() -> None:
    """Nothing follows the last row that could show that its own stamp is damaged."""
    even = (100 * np.arange(1, 300)).tolist()
    table = in_order(stamped(*even, 99_999, 30_100))
    assert table.columns[STAMP].tolist() == [*even, 30_100]
    assert [(entry.kind, entry.lines) for entry in table.findings] == [("damaged stamp", (301,))]


def test_every_form_stands_in_one_group_and_those_since_a_year_say_so() -> None:
    groups = forms_by_start()
    assert sorted(form for group in groups.values() for form in group) == sorted(TIME_FORMS)
    years = {words(form).split()[-1] for form in groups["counted since 1601, 1970 or 2000"][2:]}
    assert years == {"1970"}, "and FILETIME and the distributed clock stand before them"
    assert not any("since" in words(form) for form in groups["counted from any start"])
    assert groups["text"] == ["date", "iec-time"]


def test_the_day_of_stamps_is_that_of_the_last_and_none_without_epoch() -> None:
    late = np.datetime64("2026-03-31T23:59", "ns").astype(np.int64)
    assert day_of(np.array([late - 10**11, late])) == "2026-03-31"
    assert not day_of(np.array([0, 30 * 365 * 86_400 * 10**9]))  # an up-time of thirty years
    assert not day_of(np.array([], dtype=np.int64))


@pytest.mark.parametrize(
    ("text", "ns", "rounded"),
    [
        ("1.234567890E0", 1_234_567_890, False),
        ("-1.234567890E1", -12_345_678_900, True),
        ("1.23E-5", 12_300, True),
        ("1.234567891E+0", 1_234_567_891, False),
    ],
)
def test_a_stamp_in_exponent_form_is_rounded_where_its_digits_end_above_the_nanosecond(
    text: str, ns: int, *, rounded: bool
) -> None:
    stamps, findings = stamps_ns(cells(text), "s")
    assert stamps.tolist() == [ns]
    assert [each.kind for each in findings] == ["rounded stamp"] * rounded
