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
LINKS = SHIPPED[:-2] + SHIPPED[-1:]  # folders that the source tree links within `ballbar`
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


def copied(folder: Path) -> Path:
    """The source tree as git makes it: setuptools leaves its build folder beside the sources."""
    for name in SHIPPED:
        shutil.copytree(
            ROOT / name, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    return folder


def built(source: Path) -> Path:
    """The wheel of a tree or of a source distribution.

    Without build isolation nothing is downloaded; setuptools is a requirement of the tests.
    """
    options = ("--no-deps", "--no-build-isolation", *OFFLINE)
    run(sys.executable, "-m", "pip", "wheel", source, "-w", "dist", *options, cwd=source.parent)
    (made,) = (source.parent / "dist").glob("ballbar_bench-*.whl")
    return made


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from the source distribution."""
    tree = copied(tmp_path_factory.mktemp("wheel") / "tree")
    program = "from setuptools.build_meta import build_sdist; print(build_sdist('..'))"
    name = run(sys.executable, "-c", program, cwd=tree).splitlines()[-1]
    return built(tree.parent / name)


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


def packed(wheel: Path) -> set[str]:
    """Names of the files in a wheel but those that describe it."""
    return {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}


def test_every_file_of_the_packages_comes_along_under_one_name(wheel: Path) -> None:
    files = {
        file.relative_to(ROOT if name == "ballbar" else ROOT.parent).as_posix()
        for name in SHIPPED
        for file in (ROOT / name).rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }
    inside = {
        name if name.startswith("ballbar/") else f"ballbar/{name.partition('/')[2]}"
        for name in files
    }
    assert packed(wheel) == inside


def test_a_checkout_without_links_gives_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    """Where git writes none (Windows by default), a link is a text file with its target."""
    tree = copied(tmp_path / "tree")
    for name in LINKS:
        (tree / "ballbar" / name).unlink()
        (tree / "ballbar" / name).write_text(f"../{name}")
    assert packed(built(tree)) == packed(wheel)


def test_an_editor_finds_every_package_below_ballbar() -> None:
    """Editors and mypy read folders, not the mapping of an editable installation."""
    for name in LINKS:
        assert (ROOT / "ballbar" / name).readlink() == Path("..", name)


def test_files_of_a_user_with_the_names_of_our_folders_are_no_obstacle(
    python: Path, tmp_path: Path
) -> None:
    for name in (*LINKS, "benchmarks", "generators", "tests"):
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('the file of the user')\n")
    script = tmp_path / "script.py"
    script.write_text(
        "from ballbar import *\n"
        "from ballbar.commands.listing import MODULES\n"
        "from importlib import import_module\n"
        "for name in MODULES.values(): import_module(f'ballbar.commands.{name}')\n"
        "import ballbar.sim.simulate\n"
        "print(simulate, ballbar.sim.simulate.__file__)\n"
    )
    for interpreter in (python, Path(sys.executable)):  # installed, and editable
        assert "simulate" in run(interpreter, script, cwd=tmp_path)


@pytest.mark.slow
@pytest.mark.long
def test_the_installed_command_runs_a_shipped_scenario(python: Path, tmp_path: Path) -> None:
    where = run(
        python,
        "-c",
        "import ballbar.cell; print(ballbar.cell.__file__, ballbar.__file__)",
        cwd=tmp_path,
    )
    assert where.count(str(python.parents[1])) == 2
    command = python.with_name("ballbar")
    assert "Laser tracker, reflector" in run(command, "list", cwd=tmp_path)
    run(command, "init", "study", cwd=tmp_path)
    assert (tmp_path / "study/paths/irb2400_a.yaml").is_file()
    assert "Good fit" in run(command, "run", "study/irb2400.yaml", "--out", "out", cwd=tmp_path)
    for name in ("calibration.yaml", "report.html", "run.rrd", "recording/recording.yaml"):
        assert (tmp_path / "out" / name).is_file()
