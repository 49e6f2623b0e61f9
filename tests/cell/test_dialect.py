"""A dialect states its columns whole, and gives those of a robot of so many axes."""

from __future__ import annotations

from typing import Any

import pytest

from ballbar.cell.dialect import Dialect, dialect_names, load_dialect
from ballbar.cell.errors import DescriptionError

ROBOT: dict[str, Any] = {
    "schema": "ballbar-dialect/1", "source": "robot", "separators": [","],
    "time": {"column": "t", "unit": "s"}, "axes": [f"a{k}" for k in range(1, 7)],
    "period_s": [0.001, 0.1],
}  # fmt: skip
TRACKER = ROBOT | {"source": "tracker", "axes": [], "point": ["x", "y", "z"]}
FORCE = ROBOT | {"source": "force", "axes": [], "wrench": ["#2", "#3", "#4", "#5", "#6", "#7"]}


def dialect(values: dict[str, Any]) -> Dialect:
    return Dialect.model_validate(values)


def test_every_shipped_dialect_can_be_read() -> None:
    assert dialect_names() == sorted(dialect_names())
    assert {load_dialect(name).source for name in dialect_names()} >= {"robot", "ballbar"}
    with pytest.raises(DescriptionError, match="unknown dialect 'abbb'"):
        load_dialect("abbb")


@pytest.mark.parametrize("kind", ["motors", "axes", "joints"])
def test_the_angles_of_a_log_are_of_one_kind(kind: str) -> None:
    each = dialect(ROBOT | {"axes": [], kind: ["q1", "q2", "q3", "q4", "q5", "q6"]})
    assert each.angle_kind == kind
    assert each.angles == ("q1", "q2", "q3", "q4", "q5", "q6")
    assert each.torque_columns == ()


def test_columns_are_those_of_so_many_axes() -> None:
    each = dialect(ROBOT | {"torques": ["re:tau"]})
    assert each.torque_columns == tuple(f"re:tau[{k}/6]" for k in range(6))
    seven = each.for_axes(7)
    assert seven.angles == ("a1", "a2", "a3", "a4", "a5", "a6", "a7")
    assert seven.torque_columns == tuple(f"re:tau[{k}/7]" for k in range(7))
    named = dialect(ROBOT | {"axes": ["b", "c", "d", "e", "f", "g"]})
    assert named.for_axes(6).angles == named.angles
    with pytest.raises(DescriptionError, match="axes are 6 columns, and the robot has 7 axes"):
        named.for_axes(7)


@pytest.mark.parametrize(
    ("values", "why"),
    [
        (ROBOT | {"separators": []}, "separators: name at least one of"),
        (ROBOT | {"axes": []}, "names one of motors, axes and joints"),
        (ROBOT | {"motors": ["m1"] * 6}, "names one of motors, axes and joints"),
        (TRACKER | {"torques": ["n1"] * 6}, "are a robot's, not of a tracker"),
        (TRACKER | {"joints": ["n1"] * 6}, "are a robot's, not of a tracker"),
        (ROBOT | {"wrench": ["f"] * 6}, "of a force sensor's log only"),
        (FORCE | {"wrench": []}, "of a force sensor's log only"),
        (FORCE | {"wrench": ["f"] * 5}, "wrench: six columns"),
        (ROBOT | {"axes": ["a"] * 4}, "axes: one column for each axis, 5 to 8"),
        (ROBOT | {"axes": ["a"] * 9}, "axes: one column for each axis, 5 to 8"),
        (ROBOT | {"torques": ["a"] * 3}, "torques: one column for each axis"),
        (TRACKER | {"point": ["x", "y"]}, "point: three columns"),
        (ROBOT | {"point": ["x", "y", "z"]}, "point: three columns"),
        (ROBOT | {"period_s": [0.1, 0.1]}, "period_s: shortest and longest"),
        (ROBOT | {"period_s": [0.0, 0.1]}, "period_s: shortest and longest"),
        (ROBOT | {"time": {"column": "t"}}, "give either unit, or forms"),
        (ROBOT | {"time": {"column": "t", "unit": "s", "forms": ["s", "ms"]}}, "give either unit"),
    ],
)
def test_a_dialect_that_is_not_whole_is_refused(values: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        dialect(values)


@pytest.mark.parametrize("count", [5, 8])
def test_a_robot_has_five_to_eight_axes(count: int) -> None:
    assert len(dialect(ROBOT | {"axes": [f"x{k}" for k in range(count)]}).angles) == count


def test_a_log_needs_no_header_where_all_columns_are_counted() -> None:
    assert dialect(FORCE | {"time": {"column": "#1", "unit": "s"}}).headerless
    assert not dialect(FORCE).headerless
    assert not dialect(ROBOT | {"time": {"column": "#1", "unit": "s"}}).headerless
    assert not dialect(TRACKER | {"time": {"column": "#1", "unit": "s"}}).headerless


def test_the_columns_of_a_stamp_are_one_or_seconds_and_nanoseconds() -> None:
    time = {"column": "sec", "nanoseconds": "nsec", "unit": "s"}
    assert dialect(ROBOT | {"time": time}).time.columns == ("sec", "nsec")
    assert dialect(ROBOT).time.columns == ("t",)
    assert dialect(ROBOT).time.possible == ("s",)
    told = dialect(ROBOT | {"time": {"column": "t", "forms": ["s", "ms"]}})
    assert told.time.possible == ("s", "ms")
