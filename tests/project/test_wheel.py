"""The wheel by itself: built, installed outside the tree, and put to work there."""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

import pytest

from tests.helpers.source_imports import ROOT
from tests.helpers.wheels import SHIPPED, built, copied, python, run

pytestmark = pytest.mark.slow

__all__ = ["python"]  # fixture
LINKS = SHIPPED[:-2] + SHIPPED[-1:]  # folders that the source tree links within `ballbar`


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
