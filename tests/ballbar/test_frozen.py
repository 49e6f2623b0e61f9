"""Dataclasses of ballbar/ cannot be changed, and those that hold arrays have no `==`."""

from __future__ import annotations

from tests.helpers.dataclass_rules import assert_frozen


def test_a_dataclass_of_ballbar_is_frozen_and_compares_no_arrays() -> None:
    assert_frozen("ballbar", least=100)
