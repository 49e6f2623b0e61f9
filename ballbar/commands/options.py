"""What several commands share: arguments, the panels they stand in under --help, results as JSON."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from ballbar.terminal import silence

AT_THE_CELL, RESULT, TEST_BENCH = "At the cell", "With the result", "Test bench"


def _scenario(name: Path) -> Path:
    from ballbar.scenario import scenario_file

    return scenario_file(name)


ScenarioFile = Annotated[
    Path,
    typer.Argument(
        help="A scenario: a file, or the name of a shipped one such as irb2400.",
        metavar="SCENARIO",
        callback=_scenario,
    ),
]
RecordingFolder = Annotated[
    Path,
    typer.Argument(help="A folder with recording.yaml and the device files.", metavar="RECORDING"),
]
ResultFile = Annotated[
    Path, typer.Argument(help="A calibration.yaml, or the folder that holds it.", metavar="RESULT")
]
Out = Annotated[
    Path | None,
    typer.Option("--out", help="Folder for the output; nothing else may be in it.", metavar="DIR"),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON, SI units, and no words.")
]


def say_json(data: object) -> None:
    """Prints it; the words that would follow are left out."""
    typer.echo(json.dumps(data, indent=2))
    silence()


def command_line() -> str:
    """The command as typed, for the result's provenance."""
    return shlex.join(["ballbar", *sys.argv[1:]])
