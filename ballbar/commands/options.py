"""Arguments and options that several commands share, and how they print JSON."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from ballbar.terminal import silence


def _scenario(name: Path) -> Path:
    from ballbar.scenario import scenario_file

    return scenario_file(name)


ScenarioFile = Annotated[
    Path,
    typer.Argument(
        help="A scenario file, or the name of a shipped scenario such as irb2400.",
        metavar="SCENARIO",
        callback=_scenario,
    ),
]
RecordingFolder = Annotated[
    Path,
    typer.Argument(help="Folder with recording.yaml and the device files.", metavar="RECORDING"),
]
RecordingOrPoses = Annotated[
    Path,
    typer.Argument(
        help="Folder with recording.yaml and the device files, or with poses.yaml.",
        metavar="RECORDING",
    ),
]
ResultFile = Annotated[
    Path, typer.Argument(help="A calibration.yaml, or the folder that holds it.", metavar="RESULT")
]
Out = Annotated[
    Path | None,
    typer.Option("--out", help="Folder for the output; it must hold nothing else.", metavar="DIR"),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Replace the value of a dotted key of the file, such as seed=2; may be repeated.",
        metavar="KEY=VALUE",
    ),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON in SI units instead of text.")
]


def say_json(data: object) -> None:
    """Prints `data` as JSON; text that would follow on standard output is suppressed."""
    typer.echo(json.dumps(data, indent=2))
    silence()


def command_line() -> str:
    """The command as typed, for the provenance of the result."""
    return shlex.join(["ballbar", *sys.argv[1:]])
