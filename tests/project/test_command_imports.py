"""A command imports what it uses: help and completion load no library, and no command another's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import typer

from ballbar.commands.listing import COMMANDS, MODULES
from tests.helpers.command_line import SHORT, application
from tests.helpers.simulated_recordings import SCENARIOS, Recorded
from tests.helpers.source_imports import FILES, names_within, reached, tree

LIBRARIES = {"numpy", "scipy", "yaml", "mujoco", "pyarrow", "pandas", "matplotlib", "rerun"}
SLOW = LIBRARIES - {"numpy", "yaml"} | {"jinja2"}
OF_OTHERS = {
    "ballbar.planning",
    "ballbar.ident.thesis.costs",
    "ballbar.export",
    "ballbar.identifiability",
}
PROGRAM = """
import atexit, json, sys
atexit.register(lambda: print(json.dumps(sorted(sys.modules)), file=sys.stderr))
sys.argv[:] = {}
from ballbar.__main__ import main
main()
"""


# The same at the answer too: a run ends there, an identification goes on with report and results.
ANSWERED = """
import atexit, json, os, sys
from types import ModuleType
def say():
    print(json.dumps(sorted(sys.modules)), file=sys.stderr, flush=True)
def answered(*given, **named):
    say()
    print("ANSWERED", flush=True)
    if sys.argv[1] == "run":
        os._exit(0)
    del sys.modules["ballbar.outputs"]
    from ballbar.outputs import write_outputs
    return write_outputs(*given, **named)
atexit.register(say)
sys.modules["ballbar.outputs"] = outputs = ModuleType("ballbar.outputs")
outputs.write_outputs = answered
sys.argv[:] = {}
from ballbar.__main__ import main
main()
"""


def loaded(*words: object, **variables: str) -> set[str]:
    """Modules that a process has at the end of a command, with the packages that they are in."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(["ballbar", *map(str, words)])],
        env=os.environ | variables,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout or "-q" in words
    return set(json.loads(done.stderr))


def in_functions(module: str, *functions: str) -> set[str]:
    """Modules that `reached` names of all that functions of a module import."""
    bodies = [f for f in tree(FILES[module]).body if getattr(f, "name", "") in functions]
    assert len(bodies) == len(functions)
    names = set().union(*(names_within(body) for body in bodies))
    ours = {part for name in names for part in (name, name.rpartition(".")[0]) if part in FILES}
    return names.union(*(reached(module) for module in ours))


def packages(modules: set[str]) -> set[str]:
    """The modules, and all packages that they are in."""
    return {name.rsplit(".", k)[0] for name in modules for k in range(name.count(".") + 1)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "variables"),
    [
        (("--help",), {}),
        (("--version",), {}),
        ((), {"_BALLBAR_COMPLETE": "complete_bash", "COMP_WORDS": "ballbar i", "COMP_CWORD": "1"}),
    ],
    ids=["help", "version", "completion"],
)
def test_help_version_and_completion_load_no_library_and_no_command(
    words: tuple[str, ...], variables: dict[str, str]
) -> None:
    modules = loaded(*words, **variables)
    assert "ballbar.commands.listing" in modules
    assert not modules & LIBRARIES
    assert not modules & {f"ballbar.commands.{module}" for module in MODULES.values()}
    assert not modules & {f"ballbar.{name}" for name in ("sim", "acquisition", "ident", "planning")}


@pytest.mark.slow
def test_options_are_described_where_python_leaves_docstrings_out() -> None:
    command = [sys.executable, "-OO", "-m", "ballbar", "new", "--help"]
    wide = os.environ | {"COLUMNS": "200"}
    done = subprocess.run(command, env=wide, capture_output=True, text=True, check=True)
    assert "Recording folder to make." in done.stdout
    assert "Lines of the encoders per turn." in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("module", sorted(set(MODULES.values())))
def test_the_options_of_a_command_need_no_slow_library(module: str) -> None:
    """So its own help and the completion of its options answer at once."""
    assert not reached(f"ballbar.commands.{module}") & SLOW


@pytest.mark.slow
@pytest.mark.parametrize("module", sorted(set(MODULES.values())))
def test_the_list_of_commands_has_those_of_a_module_and_their_help(module: str) -> None:
    app = typer.Typer()
    app.add_typer(import_module(f"ballbar.commands.{module}").commands)
    group: Any = typer.main.get_command(app)
    names = {name for name, home in MODULES.items() if home == module}
    assert set(group.commands) == names
    for name in names:
        listed = application().get_command(None, name)
        assert listed.help == application().imported(name).help
        assert listed.help
        assert name in COMMANDS[listed.rich_help_panel]


@pytest.mark.slow
def test_an_identification_imports_nothing_of_simulation_or_other_commands() -> None:
    used = packages(in_functions("ballbar.commands.identification", "identify", "_options"))
    assert "ballbar.ident.identify" in used
    assert not used & (OF_OTHERS | {"sim", "ballbar.scenario", "ballbar.replay"})
    assert not used & (SLOW - {"scipy", "pyarrow"})


@pytest.mark.slow
def test_a_run_imports_no_viewer_no_figures_and_nothing_of_other_commands() -> None:
    used = packages(in_functions("ballbar.commands.bench", "run"))
    assert {"ballbar.ident.identify", "ballbar.sim.simulate"} <= used
    assert not used & (OF_OTHERS | {"ballbar.replay"})
    assert not used & (SLOW - {"scipy", "pyarrow", "mujoco"})


def test_the_replay_of_a_run_is_opened_without_the_libraries_that_write_it() -> None:
    assert not in_functions("ballbar.commands.result", "replay") & LIBRARIES


@pytest.mark.slow
@pytest.mark.parametrize("command", ["run", "identify"])
def test_the_answer_comes_before_report_and_files_and_what_they_are_made_with(
    recorded: Recorded, tmp_path: Path, command: str
) -> None:
    """And an identification loads nothing of simulation or other commands, within functions too."""
    file = tmp_path / "short.yaml"
    file.write_text(SHORT.replace("PATHS", str(SCENARIOS / "paths")))
    words = {"run": (file,), "identify": (recorded.folder, "--samples", "300")}[command]
    program = ANSWERED.format(["ballbar", command, *map(str, words), "--out", str(tmp_path / "o")])
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    said, rest = done.stdout.split("ANSWERED")
    assert "stated TCP uncertainty over the workspace" in said
    assert ("limit" in said) == (command == "run")
    at_answer, *later_on = (json.loads(x) for x in done.stderr.splitlines() if x.startswith("["))
    modules = set(at_answer)
    later = {"matplotlib", "rerun", "pandas", "jinja2", "scipy.stats", "scipy.ndimage", "sqlite3"}
    ours = {"ballbar.planning", "ballbar.report.page", "ballbar.result.calibration_schema"}
    assert modules & (later | ours | ({"sim"} if command == "identify" else set())) == set()
    if command == "identify":
        (at_end,) = later_on
        assert "ballbar.ident.identify" in at_end
        assert "Results in" in rest
        # The report predicts what would help next by the planner, which knows paths of sim.
        others = OF_OTHERS - {"ballbar.planning"}
        unneeded = {"ballbar.sim.simulate", "mujoco", "rerun", "pandas"}
        assert not set(at_end) & (others | unneeded)
