"""Dataclasses of planning/ cannot be changed, and those that hold arrays have no `==`."""

from __future__ import annotations

from tests.helpers.dataclass_rules import assert_frozen


def test_a_dataclass_of_planning_is_frozen_and_compares_no_arrays() -> None:
    assert_frozen("planning", least=35)
