"""Every warning of an import says what to do."""

from __future__ import annotations

import ast

import pytest

from acquisition.report import REMEDIES, finding, finding_line
from tests.helpers.source_imports import FILES, tree

BY_NAME = {"gap", "overrun", "off the sample time"}  # kinds that a variable holds


def warned_of() -> set[str]:
    """Kinds in all calls of acquisition that state the severity `warning`, or remark on a table."""
    kinds = set()
    for name, file in FILES.items():
        if not name.startswith("acquisition"):
            continue
        for call in (node for node in ast.walk(tree(file)) if isinstance(node, ast.Call)):
            texts = [a.value for a in call.args if isinstance(a, ast.Constant)]
            remark = isinstance(call.func, ast.Attribute) and call.func.attr == "remark"
            remark = remark and "repaired" not in texts
            if texts and (remark or ("warning" in texts and texts[0] != "warning")):
                kinds.add(str(texts[0]))
    return kinds


@pytest.mark.slow
def test_every_kind_of_warning_has_a_remedy_and_no_other_has() -> None:
    kinds = warned_of()
    assert len(kinds) > 20  # or nothing was looked at
    assert kinds | BY_NAME == set(REMEDIES)


def test_a_warning_is_shown_with_its_remedy_and_a_repair_is_not() -> None:
    entry = finding("overrun", "warning", "a.csv", "rows up to 9 ms after the one before.")
    assert finding_line(entry).endswith(f"one before. {REMEDIES['overrun']}")
    assert finding("overrun", "repaired", "a.csv", "").remedy == ""


@pytest.mark.parametrize("remedy", REMEDIES.values())
def test_a_remedy_is_a_sentence(remedy: str) -> None:
    assert remedy[0].isupper()
    assert remedy.endswith(".")
