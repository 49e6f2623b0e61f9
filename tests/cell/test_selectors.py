"""Columns are found by name, number or expression, and expressions for several in their order."""

from __future__ import annotations

import pytest

from ballbar.cell.errors import DescriptionError
from ballbar.cell.selectors import by_position, checked, find, require, spread, why_not

NAMES = ["t", "q10", "q2", "q1", "q2"]


def test_a_name_finds_all_columns_of_that_name_and_no_part_of_one() -> None:
    assert find("q2", NAMES) == [2, 4]
    assert find("q", NAMES) == []


@pytest.mark.parametrize(("selector", "found"), [("#1", [0]), ("#5", [4]), ("#6", [])])
def test_a_number_counts_columns_from_one(selector: str, found: list[int]) -> None:
    assert find(selector, NAMES) == found


def test_an_expression_finds_every_name_that_it_matches_somewhere() -> None:
    assert find("re:2$", NAMES) == [2, 4]
    assert find("re:^q1", NAMES) == [1, 3]
    assert find("re:x", ["x" * 300, "x" * 301]) == [0]  # longer names take forever


def test_columns_of_one_expression_are_taken_in_the_order_of_the_number_that_counts_on() -> None:
    names = ["axis10", "axis9", "time", "axis8"]
    assert [find(each, names) for each in spread(["re:axis"], 3)] == [[3], [1], [0]]
    assert [find(each, names) for each in spread(["re:axis"], 2)] == [[], []]
    assert why_not("re:axis[0/2]", names) == " re:axis finds 3 columns, not 2."


@pytest.mark.parametrize(
    "names",
    [
        ["a1", "a2", "a4"],  # one is missing
        ["a1", "a2", "a2"],
        ["a1", "b2", "c3"],  # more than the number differs
        ["a1x1", "a2x2", "a3x3"],
        ["a1", "a2", "a3b"],
        ["ab", "ac", "ad"],
    ],
)
def test_columns_that_do_not_count_on_are_refused_with_their_names(names: list[str]) -> None:
    assert [find(each, names) for each in spread(["re:^a|b|c"], 3)] == [[], [], []]
    said = "columns that are not equal but for one number that counts on"
    assert why_not("re:^a|b|c[1/3]", names) == f" re:^a|b|c finds {said}: {', '.join(names)}."
    assert why_not("a1", names) == ""


def test_names_that_count_on_from_one_are_continued_or_cut() -> None:
    assert spread(["q1", "q2"], 4) == ("q1", "q2", "q3", "q4")
    assert spread(["q1", "q2", "q3"], 2) == ("q1", "q2")
    assert spread(["q1", "q3"], 3) == ("q1", "q3")
    assert spread(["q2", "q3"], 3) == ("q2", "q3")
    assert spread([], 2) == ()
    assert spread(["re:q", "re:p"], 1) == ("re:q", "re:p")


@pytest.mark.parametrize("selector", ["t", "#1", "#9999", r"re:a.*b+c{2,}", r"re:[*+]{2}\*\+\+x*"])
def test_what_can_be_used_is_given_back(selector: str) -> None:
    assert checked(selector) == selector


@pytest.mark.parametrize(
    ("selector", "why"),
    [
        ("  ", "a column name is empty"),
        ("#0", "'#0' is no column number; write #1 for the first column"),
        ("#10000", "is no column number"),
        ("re:(a+)+", "repeated groups and more than 3 of"),
        ("re:(a)?b", "repeated groups"),
        ("re:a*b*c*d+", "more than 3"),
        ("re:" + "a" * 301, "they can take forever"),
        ("re:(a", "'re:\\(a' is no regular expression: "),
    ],
)
def test_what_cannot_be_used_or_could_take_forever_is_refused(selector: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        checked(selector)
    with pytest.raises(DescriptionError, match=rf"cell.yaml: columns: .*{why}"):
        require(["t", selector], "cell.yaml: columns")


def test_no_header_is_needed_where_all_columns_are_given_by_number() -> None:
    assert by_position(["#1", "#22"])
    assert not by_position(["#1", "q2"])
