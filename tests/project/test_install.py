"""The smallest installation: what it lacks, what works with it, and what a command then says."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Sequence
from importlib.metadata import distribution
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.helpers.command_line import output
from tests.helpers.simulated_recordings import Recorded
from tests.helpers.source_imports import ROOT
from tests.helpers.wheels import COMMANDS

PLAIN = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
SMALL = [
    line
    for line in (ROOT / "requirements-identify.txt").read_text().splitlines()
    if not line.startswith("#")
]


def closure(requirements: list[str]) -> set[str]:
    """Names of the distributions that pip installs for requirements."""
    names: set[str] = set()
    wanted = [Requirement(text) for text in requirements]
    while wanted:
        requirement = wanted.pop()
        name = canonicalize_name(requirement.name)
        if name in names or (requirement.marker and not requirement.marker.evaluate()):
            continue
        names.add(name)
        wanted += [Requirement(text) for text in distribution(name).requires or ()]
    return names


def installed_by(name: str) -> Iterator[Path]:
    """Files and folders at the top of site-packages that a distribution puts there."""
    own = distribution(name)
    parts = {Path(file).parts[0] for file in own.files or ()}
    return (Path(str(own.locate_file(part))) for part in parts if part not in ("..", "bin"))


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A site-packages with our package and what requirements-identify.txt installs alone."""
    folder = tmp_path_factory.mktemp("small")
    for name in closure(SMALL):
        for entry in installed_by(name):
            if entry.exists() and entry.name != "__pycache__":
                (folder / entry.name).symlink_to(entry)
    (folder / "ballbar").symlink_to(ROOT / "ballbar")
    own = folder / "ballbar_bench-1.dist-info"  # as installed; this metadata is of the sources
    own.mkdir()
    lines = ["Metadata-Version: 2.1", "Name: ballbar-bench", "Version: 1"]
    (own / "METADATA").write_text("\n".join(lines + [f"Requires-Dist: {x}" for x in PLAIN]) + "\n")
    return folder


class Done(NamedTuple):
    """Exit code and output of a command."""

    code: int
    out: str
    err: str


def small(packages: Path, *commands: Sequence[object]) -> list[Done]:
    """Commands, one after the other, of an interpreter that sees no other packages."""
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", COMMANDS, packages],
        input="".join(json.dumps(list(map(str, words))) + "\n" for words in commands),
        env=os.environ | {"COLUMNS": "400"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [Done(*json.loads(line)) for line in done.stdout.splitlines()]


def test_the_small_installation_has_the_bounds_of_the_whole_one() -> None:
    assert set(SMALL) < set(PLAIN)
    missing = {Requirement(text).name for text in set(PLAIN) - set(SMALL)}
    lacks = {"mujoco-core", "rerun-sdk", "pyarrow", "pandas", "matplotlib", "cma", "fpdf2"}
    assert missing == lacks
    assert not closure(SMALL) & lacks


@pytest.mark.slow
def test_recordings_are_read_identified_reported_and_exported_alike(
    packages: Path, recorded: Recorded, tmp_path: Path
) -> None:
    """Without pyarrow the slower reader gives the same values, to the last bit of the result."""
    identify = ("identify", recorded.folder, "--samples", 300, "--out")
    whole = output(*identify, tmp_path / "whole")
    commands = (
        (*identify, tmp_path / "small"),
        ("check", recorded.folder),
        ("export", tmp_path / "small", "--to", "urdf"),
        ("compare", tmp_path / "small", tmp_path / "whole"),
        ("verify", tmp_path / "small", recorded.folder),
        ("list",),
        ("--version",),
    )
    every = small(packages, *commands)
    for done, words in zip(every, commands, strict=True):
        assert done.code == 0, (words, done.err)
        assert done.out
    assert every[0].out.replace("small", "") == whole.replace("whole", "")
    texts = [(tmp_path / out / "calibration.yaml").read_text() for out in ("small", "whole")]
    small_robot, whole_robot = (yaml.safe_load(text)["parameters"] for text in texts)
    assert small_robot == whole_robot
    assert (tmp_path / "small/report.html").stat().st_size > 1e5


@pytest.mark.slow
def test_a_command_that_lacks_a_library_names_what_pip_installs(
    packages: Path, recorded: Recorded, tmp_path: Path
) -> None:
    out = ("--out", tmp_path / "out")
    lacking: tuple[tuple[tuple[object, ...], str], ...] = (
        (("simulate", "irb2400", *out), "mujoco-core"),
        (("run", "irb2400", *out), "rerun-sdk"),
        (("identify", recorded.folder, "--rerun", *out), "rerun-sdk"),
        (("robot", "show", "irb2400"), "rerun-sdk"),
        (("sweep", ROOT / "scenarios/sweeps/seeds.yaml", *out), "pyarrow"),
    )
    every = small(packages, *(words for words, _ in lacking))
    for done, (words, requirement) in zip(every, lacking, strict=True):
        assert done.code == 2, (words, done.err)
        (asked,) = [x for x in map(Requirement, PLAIN) if x.name == requirement]
        assert f"which is not installed: pip install '{requirement}" in done.err
        command = done.err.partition("pip install '")[2].partition("'")[0]
        assert Requirement(command).specifier == asked.specifier
        assert not (tmp_path / "out").exists()


def test_the_readme_states_what_the_small_installation_saves() -> None:
    """Sizes of whole distributions, without what Python compiles; releases differ a little."""
    size = {
        name: sum(
            file.stat().st_size
            for file in (Path(str(f.locate())) for f in distribution(name).files or ())
            if file.is_file() and file.suffix != ".pyc"
        )
        for name in closure(PLAIN)
    }
    total = [sum(size[name] for name in closure(names)) for names in (PLAIN, SMALL)]
    text = (ROOT / "README.md").read_text()
    stated = [
        float(re.search(pattern, text)[1]) for pattern in (r"whole: (\d+) MB", r"small: (\d+) MB")
    ]  # type: ignore[index]
    assert [s / 1e6 for s in total] == pytest.approx(stated, rel=0.15)
