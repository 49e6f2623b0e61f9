"""Imports point one way, workers start light, and every third-party package is declared.

cell <- sim, acquisition, ident <- planning <- ballbar; the three in the middle never meet.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from ballbar import PACKAGES
from ballbar.commands.listing import MODULES
from tests.helpers.source_imports import FILES, ROOT, full_names, imported, nodes, part_of, reached

ALLOWED = {
    "cell": {"cell"},
    "sim": {"cell", "sim"},
    "acquisition": {"cell", "acquisition"},
    "ident": {"cell", "ident"},
    "planning": {"cell", "sim", "acquisition", "ident", "planning"},
    "ballbar": set(PACKAGES),
}
FORBIDDEN = {
    "cell": {"mujoco", "rerun", "matplotlib", "typer", "rich", "pandas"},
    "acquisition": {"mujoco", "rerun", "matplotlib", "typer", "rich", "pandas"},
    "ident": {"mujoco", "rerun", "matplotlib", "typer", "rich", "pandas"},
    "sim": {"rerun", "matplotlib", "typer", "rich", "pandas"},
    "planning": {"rerun", "matplotlib", "typer", "rich", "pandas"},
    "ballbar": {"mujoco"},
}
# Beside the ground floor, which a newcomer has to know, stand two wings: what simulates and
# studies, and what plans, exports, corrects and shows.
BENCH = (
    "ballbar.sim", "ballbar.ident.thesis", "ballbar.claims", "ballbar.commands.bench",
    "ballbar.commands.bench_json", "ballbar.commands.identifiability", "ballbar.commands.shipped",
    "ballbar.identifiability", "ballbar.json_schemas", "ballbar.rehearsal", "ballbar.run",
    "ballbar.scenario", "ballbar.sweep", "ballbar.trial", "ballbar.truth",
)  # fmt: skip
SHOP = (
    "ballbar.planning", "ballbar.acquisition.live", "ballbar.commands.live",
    "ballbar.commands.planning", "ballbar.commands.result", "ballbar.commands.robots",
    "ballbar.compensation",
    "ballbar.export", "ballbar.plan", "ballbar.record", "ballbar.replay", "ballbar.robot_file",
    "ballbar.watch",
)  # fmt: skip
INTO_THE_WINGS = {  # imports of the ground floor that remain, each for its reason
    # a result is compared with the truth of its simulation where the user names such a file
    "ballbar.commands.comparison": {"ballbar.truth"},
    # names of shipped scenarios are found when a command of the bench is called
    "ballbar.commands.options": {"ballbar.scenario"},
    # the settings of a scenario and of `identify` are one file schema
    "ballbar.identify_settings": {"ballbar.ident.thesis"},
    # identify --rerun
    "ballbar.outputs": {"ballbar.replay"},
    # what another recording would add is predicted by the planner
    "ballbar.report.machine": {"ballbar.planning", "ballbar.sim"},
    # types of what a simulated run has beside an identification
    "ballbar.result.run_data": {"ballbar.scenario", "ballbar.truth", "ballbar.sim"},
}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
DISTRIBUTIONS = {
    "mujoco": "mujoco-core",
    "yaml": "pyyaml",
    "rerun": "rerun-sdk",
    "fpdf": "fpdf2",
    "pydantic_core": "pydantic",
    "cv2": "opencv-python-headless",
}  # whose import name is another; pydantic requires its core at one exact version
USED_EXTRAS = (
    "ads",
    "camera",
    "dask",
    "ros",
    "xlsx",
)  # of the product; docs and dev serve the project


def names_of(requirements: list[str]) -> set[str]:
    """Distributions in a list of requirements, as exact names: scipy-stubs is not scipy."""
    return {canonicalize_name(Requirement(text).name) for text in requirements}


def third_party() -> dict[str, set[str]]:
    """Distributions that the product imports anywhere, with the files that do."""
    users: dict[str, set[str]] = {}
    for file in FILES.values():
        for name in imported(file) - set(PACKAGES) - set(sys.stdlib_module_names):
            users.setdefault(DISTRIBUTIONS.get(name, name), set()).add(str(file.relative_to(ROOT)))
    return users


@pytest.mark.slow
@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_what_lies_below_it(package: str) -> None:
    files = [file for name, file in FILES.items() if part_of(name) == package]
    assert files
    for file in files:
        names = imported(file)
        above = (names & set(PACKAGES)) - ALLOWED[package]
        assert not above, f"{file.relative_to(ROOT)} imports {above}"
        unwanted = names & FORBIDDEN[package]
        assert not unwanted, f"{file.relative_to(ROOT)} imports {unwanted}"


def wing_of(name: str) -> str | None:
    """The part of a wing that a module is in; None on the ground floor."""
    return next((p for p in (*BENCH, *SHOP) if name == p or name.startswith(f"{p}.")), None)


@pytest.mark.slow
def test_the_ground_floor_imports_neither_bench_nor_shop() -> None:
    """Also within functions, and for types alone."""
    doors = {}
    for name, file in FILES.items():
        if wing_of(name) is None and (parts := {wing_of(n) for n in full_names(file)} - {None}):
            doors[name] = parts
    assert doors == INTO_THE_WINGS


@pytest.mark.parametrize("package", ["acquisition", "ident"])
def test_what_reads_and_identifies_never_speaks_of_the_truth_file(package: str) -> None:
    for file in (ROOT / package).rglob("*.py"):
        strings = [
            n.value for n in nodes(file) if isinstance(n, ast.Constant) and isinstance(n.value, str)
        ]
        assert not [s for s in strings if "truth.yaml" in s or "ballbar-truth" in s], file.name


@pytest.mark.slow
def test_nothing_is_imported_from_a_test_or_by_a_test_from_a_benchmark() -> None:
    """Code that tests and benchmarks share stands in tests/helpers."""
    files = [
        file
        for folder in ("tests", "benchmarks", "generators")
        for file in (ROOT / folder).rglob("*.py")
    ]
    suspect = re.compile(
        r"^\s*(?:from|import) [^(\n]*(?:\([^)]*)?(?:test_|conftest|benchmarks)", re.M
    )
    for file in files:
        if not suspect.search(file.read_text()):
            continue
        modules = {
            name for name in full_names(file) if name.split(".")[0] in ("tests", "benchmarks")
        }
        tests = {name for name in modules if ".test_" in name or "conftest" in name}
        assert not tests, f"{file.relative_to(ROOT)} imports {tests}"
        if file.is_relative_to(ROOT / "tests"):
            benchmarks = {name for name in modules if name.startswith("benchmarks")}
            assert not benchmarks, f"{file.relative_to(ROOT)} imports {benchmarks}"


@pytest.mark.slow
def test_what_the_product_imports_is_what_it_declares() -> None:
    extras = PROJECT["optional-dependencies"]
    required = names_of(PROJECT["dependencies"])
    optional = set().union(*(names_of(extras[name]) for name in USED_EXTRAS))
    users = third_party()
    assert required | optional == users.keys(), {
        "imported, not declared": {
            name: users[name] for name in users.keys() - required - optional
        },
        "declared, not imported": (required | optional) - users.keys(),
    }
    assert not required & optional


@pytest.mark.parametrize(
    "entry",
    [
        "ballbar",
        "ballbar.acquisition.recording",
        "ballbar.run",
        "ballbar.commands.cli",
        *sorted({f"ballbar.commands.{module}" for module in MODULES.values()}),
    ],
)
def test_the_product_starts_without_any_extra(entry: str) -> None:
    extras = PROJECT["optional-dependencies"]
    optional = set().union(*(names_of(extras[name]) for name in USED_EXTRAS))
    assert not {DISTRIBUTIONS.get(name, name) for name in reached(entry)} & optional


@pytest.mark.parametrize("module", ["ballbar.trial.trial", "ballbar.sweep.chunk"])
def test_a_worker_of_a_sweep_imports_no_viewer_and_no_page(module: str) -> None:
    assert not reached(module) & {"rerun", "matplotlib", "jinja2"}


@pytest.mark.slow
def test_all_text_is_printed_by_the_consoles_of_the_terminal() -> None:
    """They show control characters of names in files as escapes."""
    for name, file in FILES.items():
        if name == "ballbar.terminal":
            continue
        for node in nodes(file):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in ("print", "Console"), f"{file}:{node.lineno}"
