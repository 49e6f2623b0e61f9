"""Arguments and options that several commands share, and how they print JSON."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, get_type_hints

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


def with_options(kind: type[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A command whose parameter `options` stands for one option for each field of a dataclass."""
    hints = get_type_hints(kind, include_extras=True)
    fields = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[name])
        for name, field in signature(kind).parameters.items()
    ]

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        parameters = list(signature(command, eval_str=True).parameters.values())
        place = [parameter.name for parameter in parameters].index("options")

        @wraps(command)
        def run(*words: Any, **given: Any) -> None:
            options = kind(**{field.name: given.pop(field.name) for field in fields})
            command(*words, options=options, **given)

        parameters[place : place + 1] = fields
        vars(run)["__signature__"] = Signature(parameters)
        run.__annotations__ = {each.name: each.annotation for each in parameters}
        return run

    return decorated
