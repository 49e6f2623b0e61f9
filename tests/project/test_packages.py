"""Imports point one way: cell <- sim, acquisition, ident <- planning <- ballbar; the three in the middle never meet."""

from __future__ import annotations

import ast
import sys

import pytest

from tests.helpers.source_imports import OURS, ROOT, imported

ALLOWED = {
    "cell": {"cell"},
    "sim": {"cell", "sim"},
    "acquisition": {"cell", "acquisition"},
    "ident": {"cell", "ident"},
    "planning": {"cell", "sim", "ident", "planning"},
    "ballbar": OURS,
}
FORBIDDEN = {
    "cell": {"mujoco", "rerun", "matplotlib", "typer", "rich", "pandas"},
    "acquisition": {"mujoco", "rerun", "matplotlib", "typer", "rich", "pandas"},
    "ident": {"mujoco", "rerun", "matplotlib", "typer", "rich", "pandas"},
    "sim": {"rerun", "matplotlib", "typer", "rich", "pandas"},
    "planning": {"rerun", "matplotlib", "typer", "rich", "pandas"},
    "ballbar": {"mujoco"},
}


@pytest.mark.parametrize("package", sorted(OURS))
def test_a_package_imports_only_what_lies_below_it(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for file in files:
        names = imported(file)
        assert names & OURS <= ALLOWED[package], (
            f"{file.name} imports {names & OURS - ALLOWED[package]}"
        )
        assert not names & FORBIDDEN[package], f"{file.name} imports {names & FORBIDDEN[package]}"


@pytest.mark.parametrize("package", ["acquisition", "ident"])
def test_what_reads_and_identifies_never_speaks_of_the_truth_file(package: str) -> None:
    for file in (ROOT / package).rglob("*.py"):
        strings = [
            n.value
            for n in ast.walk(ast.parse(file.read_text()))
            if isinstance(n, ast.Constant) and isinstance(n.value, str)
        ]
        assert not [s for s in strings if "truth.yaml" in s or "ballbar-truth" in s], file.name


def test_every_dependency_is_declared() -> None:
    declared = (ROOT / "pyproject.toml").read_text()
    distribution = {
        "mujoco": "mujoco-core",
        "yaml": "pyyaml",
        "rerun": "rerun-sdk",
        "pydantic_core": "pydantic",
    }
    standard = set(sys.stdlib_module_names)
    for package in OURS:
        for file in (ROOT / package).rglob("*.py"):
            for name in imported(file) - OURS - standard:
                assert f'"{distribution.get(name, name)}' in declared, f"{file.name} imports {name}"
