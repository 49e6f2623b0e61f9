"""Every module of ident has a test module that imports it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.source_imports import FILES, ROOT, full_names

MODULES = {
    name
    for name, file in FILES.items()
    if name.startswith("ballbar.ident.") and file.name != "__init__.py"
}
TESTS = sorted((ROOT / "tests" / "ident").rglob("test_*.py"))


def imports_of(file: Path) -> set[str]:
    """Modules that a test imports, whole or by an object of theirs."""
    names = full_names(file)
    return names | {name.rpartition(".")[0] for name in names}


def test_modules_and_tests_are_found() -> None:
    """Or the next test would say nothing."""
    assert {
        "ballbar.ident.verdict",
        "ballbar.ident.estimator.fit",
        "ballbar.ident.corrections.rod_strain",
    } < MODULES
    assert len(TESTS) > 30


@pytest.mark.slow
def test_a_module_of_ident_is_imported_by_a_test_of_ident() -> None:
    untested = MODULES - {name for file in TESTS for name in imports_of(file)}
    assert not untested, f"without a test under tests/ident that imports them: {sorted(untested)}"
