"""Arguments and options that several commands share, and how they print JSON."""

from __future__ import annotations

import ast
import json
import re
import shlex
import sys
from collections.abc import Callable, Iterable
from copy import copy
from functools import wraps
from inspect import Parameter, Signature, getdoc, getsource, signature
from operator import getitem
from pathlib import Path
from textwrap import dedent
from typing import Annotated, Any, cast, get_args, get_origin, get_type_hints

import typer
from typer.models import ArgumentInfo, OptionInfo

from ballbar.terminal import silence

Command = Callable[..., None]
_ENTRY = re.compile(r"\n(?=--[a-z-]+[^\n]* : |[A-Z]+ : )")


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


def replacing(more: str = "") -> OptionInfo:
    """The option --set with its help, and more about its keys."""
    text = "Replace the value of a dotted key of the file, such as seed=2; may be repeated."
    return cast(OptionInfo, typer.Option("--set", help=text + more, metavar="KEY=VALUE"))


Overrides = Annotated[list[str] | None, replacing()]
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


def purpose(docstring: str) -> str:
    """The purpose of a command in its docstring, without example and parameters."""
    return _ENTRY.split(docstring)[0].partition("\n\nExample: ")[0].strip()


def command(app: typer.Typer, panel: str | None = None) -> Callable[[Command], Command]:
    """Registers a command whose docstring describes its arguments and options.

    Below the purpose stand an example and, in the order of the signature, the parameters that no
    annotation describes; a line that goes on is indented:

        Example: `ballbar watch runs/monday --accuracy 0.05`

        DIR : Folder with recording.yaml.
        --duration SECONDS : Time that the recording will take.
    """

    def registered(function: Command) -> Command:
        docstring = _docstring(function)
        parameters = signature(function, eval_str=True).parameters.values()
        _set_parameters(function, _described(parameters, docstring))
        function.__doc__ = purpose(docstring)
        _, _, example = " ".join(_ENTRY.split(docstring)[0].split()).partition("Example: ")
        app.command(epilog=f"Example: {example}", rich_help_panel=panel)(function)
        return function

    return registered


def _docstring(described: Command | type[Any]) -> str:
    """The docstring; from the source where Python leaves docstrings out (-OO)."""
    if sys.flags.optimize < 2:
        return getdoc(described) or ""
    (definition,) = ast.parse(dedent(getsource(described))).body
    assert isinstance(definition, ast.FunctionDef | ast.ClassDef)
    return ast.get_docstring(definition) or ""


def _described(parameters: Iterable[Parameter], docstring: str) -> list[Parameter]:
    """Parameters whose annotations describe them, from the lines of a docstring where they lack."""
    entries, parameters = iter(_ENTRY.split(docstring)[1:]), list(parameters)
    for place, each in enumerate(parameters):
        annotated = get_origin(each.annotation) is Annotated
        kind, *info = get_args(each.annotation) if annotated else [each.annotation]
        if not info or info[0].help is None:
            kind = getitem(Annotated, (kind, _info(" ".join(next(entries).split()), *info)))
            parameters[place] = each.replace(annotation=kind)
    assert not list(entries), "there are fewer parameters than the docstring describes"
    return parameters


def _set_parameters(function: Command, parameters: list[Parameter]) -> None:
    """Gives a function the parameters that typer reads."""
    vars(function)["__signature__"] = Signature(parameters)
    function.__annotations__ = {each.name: each.annotation for each in parameters}


def _info(entry: str, *limits: ArgumentInfo | OptionInfo) -> ArgumentInfo | OptionInfo:
    """Name, form and meaning of a parameter from its line `--name FORM : meaning`."""
    declared, _, meaning = entry.partition(" : ")
    flag, _, form = declared.partition(" ")
    option = flag.startswith("--")
    info = copy(limits[0]) if limits else typer.Option() if option else typer.Argument()
    info.help, info.metavar = meaning, (form if option else flag) or None
    if option:
        info.param_decls = (flag,)
    return info


def with_options(kind: type[Any]) -> Callable[[Command], Command]:
    """A command whose parameter `options` stands for one option for each field of a dataclass.

    The docstring of the dataclass describes them as that of a command.
    """
    hints = get_type_hints(kind, include_extras=True)
    named = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[name])
        for name, field in signature(kind).parameters.items()
    ]
    fields = _described(named, _docstring(kind))

    def decorated(command: Command) -> Command:
        parameters = list(signature(command, eval_str=True).parameters.values())
        place = [parameter.name for parameter in parameters].index("options")

        @wraps(command)
        def run(*words: Any, **given: Any) -> None:
            options = kind(**{field.name: given.pop(field.name) for field in fields})
            command(*words, options=options, **given)

        parameters[place : place + 1] = fields
        _set_parameters(run, parameters)
        return run

    return decorated
