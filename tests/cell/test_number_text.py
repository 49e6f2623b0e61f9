"""Numbers as people read them: no digit that no measurement has, no value that is not known."""

from __future__ import annotations

import pytest

from ballbar.cell.clock import UNSEEN_OFFSET, UNSEEN_SKEW, Clock
from ballbar.cell.number_text import (
    clock_offset_text,
    clock_skew_text,
    duration_text,
    significant_text,
)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (2.4e-13, 2, "0"),  # printed as 0.00000000000024 mrad where a length tells no angle
        (-2.4e-13, 2, "0"),
        (0.0, 3, "0"),
        (0.012345, 2, "0.012"),
        (9.996, 3, "10.0"),
        (-1.5, 2, "-1.5"),
        (209988.1, 2, "209988"),  # no exponent
        (float("inf"), 2, "inf"),
    ],
)
def test_a_number_has_no_exponent_and_no_digits_of_rounding(
    value: float, digits: int, text: str
) -> None:
    assert significant_text(value, digits) == text


def test_a_sign_is_shown_where_it_is_asked_for() -> None:
    assert significant_text(0.25, 2, sign=True) == "+0.25"
    assert significant_text(1e-12, 2, sign=True) == "0"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (3.24e-6, "3.2 us"),
        (0.2099881, "210 ms"),
        (0.00123, "1.2 ms"),
        (12.0, "12 s"),
        (0.0, "0 us"),
    ],
)
def test_a_duration_is_in_the_unit_that_is_readable(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


def test_a_clock_that_is_known_is_stated_with_its_deviations() -> None:
    clock = Clock(0.0123456, 2.5e-5)
    assert clock_offset_text(clock, 3.2e-6) == "+12.3456 ms (sigma 3.2 us)"
    assert clock_skew_text(clock, 1.2e-7) == "+25.000 ppm (sigma 0.12 ppm)"


def test_a_clock_that_no_motion_shows_is_not_determined() -> None:
    """A length that hardly changes left 0.21 s, printed as `sigma 209988.1 us` beside a value."""
    clock = Clock(0.0123456, 2.5e-5)
    assert clock_offset_text(clock, 0.2099881) == "not determined (sigma 210 ms)"
    assert clock_skew_text(clock, 5.2e-3) == "not determined (sigma 5200 ppm)"
    assert clock_offset_text(clock, float("nan")).startswith("not determined")


def test_a_clock_is_determined_up_to_the_limits_and_not_beyond() -> None:
    clock = Clock(0.0, 0.0)
    assert clock_offset_text(clock, UNSEEN_OFFSET).startswith("+0.0000 ms")
    assert clock_offset_text(clock, 1.01 * UNSEEN_OFFSET).startswith("not determined")
    assert clock_skew_text(clock, UNSEEN_SKEW).startswith("+0.000 ppm")
    assert clock_skew_text(clock, 1.01 * UNSEEN_SKEW).startswith("not determined")
    # rows of a slow log: its clock is told within a row
    assert clock_offset_text(clock, 0.05, longest=0.1).startswith("+0.0000 ms")
