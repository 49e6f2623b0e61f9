"""The wheel by itself: built, installed outside the tree, and put to work there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

from ballbar import PACKAGES
from tests.helpers.source_imports import ROOT

pytestmark = pytest.mark.slow

SHIPPED = (*PACKAGES, "scenarios")
OFFLINE = ("--no-index", "--disable-pip-version-check")


def run(*command: object, cwd: Path) -> str:
    """Standard output of a command that sees nothing of the source tree. Fails with its errors."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy: setuptools leaves its build folder beside the sources.

    Without build isolation nothing is downloaded; setuptools is a requirement of the tests.
    """
    folder = tmp_path_factory.mktemp("wheel")
    for name in SHIPPED:
        shutil.copytree(
            ROOT / name, folder / "source" / name, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / "source")
    options = ("--no-deps", "--no-build-isolation", *OFFLINE)
    run(sys.executable, "-m", "pip", "wheel", folder / "source", "-w", "dist", *options, cwd=folder)
    (built,) = (folder / "dist").glob("ballbar_bench-*.whl")
    return built


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Interpreter of a fresh environment that holds the wheel alone.

    The dependencies are those of this environment, by a .pth file with its site-packages: this is
    quick and needs no network. The .pth files within a folder that a .pth file names are not read,
    so an editable install there, which would lead to the source tree, has no effect;
    --system-site-packages would give it one.
    """
    folder = tmp_path_factory.mktemp("alone")
    venv.create(folder, with_pip=False)
    interpreter = folder / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", interpreter)
    run(*pip, "install", "--no-deps", *OFFLINE, wheel, cwd=folder)
    packages = [entry for entry in sys.path if entry.endswith("site-packages")]
    (own,) = folder.glob("lib/python*/site-packages")
    (own / "dependencies.pth").write_text("\n".join(packages) + "\n")
    return interpreter


def test_every_file_of_the_packages_comes_along(wheel: Path) -> None:
    packed = set(zipfile.ZipFile(wheel).namelist())
    files = {
        file.relative_to(ROOT).as_posix()
        for name in SHIPPED
        for file in (ROOT / name).rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }
    assert files - packed == set()
    assert {name.split("/")[0] for name in packed} - set(SHIPPED) == {
        name.split("/")[0] for name in packed if ".dist-info/" in name
    }, "something else was packed"


@pytest.mark.slow
@pytest.mark.long
def test_the_installed_command_runs_a_shipped_scenario(python: Path, tmp_path: Path) -> None:
    where = run(
        python, "-c", "import cell, ballbar; print(cell.__file__, ballbar.__file__)", cwd=tmp_path
    )
    assert where.count(str(python.parents[1])) == 2
    command = python.with_name("ballbar")
    assert "Laser tracker, reflector" in run(command, "list", cwd=tmp_path)
    run(command, "init", "study", cwd=tmp_path)
    assert (tmp_path / "study/paths/irb2400_a.yaml").is_file()
    assert "Good fit" in run(command, "run", "study/irb2400.yaml", "--out", "out", cwd=tmp_path)
    for name in ("calibration.yaml", "report.html", "run.rrd", "recording/recording.yaml"):
        assert (tmp_path / "out" / name).is_file()
