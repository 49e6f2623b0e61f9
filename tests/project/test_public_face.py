"""Names that a user of Python imports from `ballbar`, the API page, and the examples."""

from __future__ import annotations

import ast
import re
import runpy
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import ballbar
from tests.helpers.simulated_recordings import Recorded
from tests.helpers.source_imports import ROOT

HEAVY = {"numpy", "scipy", "pydantic", "mujoco", "matplotlib", "rerun", "typer", "pandas"}
VERBS = {"read", "identify", "verify", "load", "simulate"}
PAGE = (ROOT / "docs/api.md").read_text()


def script(text: str, folder: Path) -> str:
    """The output of a plain script: no `__main__` guard, and warnings are errors."""
    file = folder / "script.py"
    file.write_text(text)
    command = [sys.executable, "-W", "error", file]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_ballbar_loads_no_library() -> None:
    program = f"import sys, ballbar; print(sorted({HEAVY} & sys.modules.keys()))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"


@pytest.mark.slow
def test_an_identification_needs_neither_plant_nor_viewer_nor_tables(recorded: Recorded) -> None:
    unused = HEAVY - {"numpy", "scipy", "pydantic"}
    text = (
        "import sys, ballbar\n"
        f"result = ballbar.identify({str(recorded.folder)!r})\n"
        f"print(sorted({unused} & sys.modules.keys()))\n"
    )
    assert script(text, recorded.folder.parent) == "[]\n"


def test_every_public_name_is_the_object_of_its_module() -> None:
    assert set(ballbar.__all__) <= set(dir(ballbar))
    for name in ballbar.__all__:
        value = getattr(ballbar, name)
        assert value is getattr(import_module(value.__module__), name)


def test_the_package_and_type_checkers_read_the_same_names() -> None:
    tree = ast.parse((ROOT / "ballbar/__init__.pyi").read_text())
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    seen = {alias.asname: node.module for node in imports for alias in node.names}
    assert seen == ballbar._HOME
    assert set(seen) > VERBS


def test_the_functions_are_five_beside_descriptions_and_kinematics() -> None:
    """One function for each thing to be done: no second name for the same."""
    words = ("load_", "identify", "read", "verify", "write")
    assert {n for n in ballbar.__all__ if n.startswith(words)} == {
        *VERBS - {"load", "simulate"}, "load_cell", "load_robot", "load_truth"
    }  # fmt: skip


def test_the_api_page_lists_every_public_name() -> None:
    listed = dict(reversed(line.rsplit(".", 1)) for line in re.findall(r"^::: (\S+)$", PAGE, re.M))
    assert listed.pop("Views") == "ballbar.result.views"  # methods that a Calibration inherits
    assert listed == ballbar._HOME


def test_an_unknown_name_is_refused_with_the_public_ones() -> None:
    with pytest.raises(AttributeError, match=r"has no 'identfy'; public: .*identify, .*load_cell"):
        ballbar.identfy  # noqa: B018


@pytest.mark.parametrize("package", ballbar.PACKAGES)
def test_every_package_says_that_it_is_typed(package: str) -> None:
    assert (ROOT / package / "py.typed").is_file()


@pytest.mark.slow
def test_the_blocks_of_the_api_page_run_as_printed_in_one_plain_script(tmp_path: Path) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    assert len(blocks) == 3
    alone = "from multiprocessing.process import BaseProcess; BaseProcess.start = None"
    screen = "import matplotlib; matplotlib.use('Agg')"
    said = script("\n".join((alone, screen, *blocks)), tmp_path)
    first, *_, reached, held = said.splitlines()
    assert first.startswith("Good fit")
    assert reached == "[ True  True  True]"
    assert held.startswith("Holds")
    assert (tmp_path / "identified/report.html").is_file()


@pytest.mark.slow
def test_the_example_from_arrays_finds_the_robot(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(ROOT / "examples/from_arrays.py"), run_name="__main__")
    said = capsys.readouterr().out
    assert said.startswith("Good fit")
    error_mm = float(said.split("TCP error over the workspace: ")[1].split()[0])
    assert error_mm < 0.005  # the noise of the logs allows 0.002 mm


def test_the_example_from_poses_finds_the_robot_and_what_changed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    runpy.run_path(str(ROOT / "examples/from_poses.py"), run_name="__main__")
    said = capsys.readouterr().out
    assert said.startswith("Good fit")
    assert float(said.split("joint 4 zero: ")[1].split()[0]) == pytest.approx(2.0, abs=0.05)  # mrad
    assert "Changed since: zero of axis 3 by +1.0" in said


@pytest.mark.slow
def test_the_example_from_a_recording_writes_its_calibration(
    recorded: Recorded,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "identified"
    monkeypatch.setattr(sys, "argv", ["from_recording.py", str(out), str(recorded.folder)])
    runpy.run_path(str(ROOT / "examples/from_recording.py"), run_name="__main__")
    assert "raw/ballbar.csv: overrun (" in capsys.readouterr().out
    length = ballbar.load(out).geometry["ra2"]
    assert length == pytest.approx(recorded.simulation.truth.geometry["ra2"], abs=20e-6)
