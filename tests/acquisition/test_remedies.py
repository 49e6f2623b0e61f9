"""Every warning of an import says what to do."""

from __future__ import annotations

import ast

import pytest

from ballbar.acquisition.report import REMEDIES, finding, finding_line
from tests.helpers.source_imports import FILES, tree


def test_every_remedy_is_of_a_kind_that_is_found() -> None:
    """A kind is a warning by its remedy, so one that is spelt otherwise would be a repair."""
    files = [file for name, file in FILES.items() if name.startswith("ballbar.acquisition.")]
    nodes = [node for file in files for node in ast.walk(tree(file))]
    places = [node.value for node in nodes if isinstance(node, ast.Constant)]
    assert {kind for kind in REMEDIES if places.count(kind) < 2} == set()


def test_a_warning_is_shown_with_its_remedy_and_a_repair_is_not() -> None:
    entry = finding("overrun", "a.csv", "rows up to 9 ms after the one before.")
    assert finding_line(entry).endswith(f"one before. {REMEDIES['overrun']}")
    repair = finding("torn line", "a.csv", "dropped.")
    assert (entry.severity, repair.severity, repair.remedy) == ("warning", "repaired", "")


@pytest.mark.parametrize("remedy", REMEDIES.values())
def test_a_remedy_is_a_sentence(remedy: str) -> None:
    assert remedy[0].isupper()
    assert remedy.endswith(".")
