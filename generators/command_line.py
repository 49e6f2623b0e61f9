"""docs/command_line.md: every command with arguments and options, from the texts of `--help`.

python -m generators.command_line
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import typer
from typer.models import ArgumentInfo, CommandInfo, OptionInfo

from ballbar.cell.files import write_whole
from ballbar.commands.listing import COMMANDS

PAGE = Path(__file__).parents[1] / "docs/command_line.md"
HEAD = """# Command line

Written by `python -m generators.command_line` from the texts of `--help`; do not edit.

## What holds for every command

**Exit codes.** 0: done. 1: the command ran, but its result is not acceptable; the first line says
why. 2: bad input; the message names file, line and key, and the remedy. 3: a fault of the program,
whose details are written to a file to be reported, or too little memory. A result that was fitted
and that its own reader then refuses is such a fault; it is kept whole in calibration.refused.yaml
in place of calibration.yaml. 130: ended by Ctrl-C or SIGTERM, but `record`, `watch` and the search
of `plan`, which then go on to their result.

**Output.** Results go to standard output, everything else to standard error.

**`--json`** of commands with a result prints it for a program: SI units, keys that carry them. The
exit code is the same.

```sh
ballbar compare runs/irb2400/calibration.yaml runs/irb2400/recording.truth.yaml --json
```

**`--quiet`, `-q`** leaves nothing but errors, and the JSON if `--json` is given. **`--verbose`,
`-v`** prints each stage with the second at which it began, also in a pipe. Both may stand before or
behind the name of the command.

**Colours** are for a terminal: in a pipe or a file there are none. `FORCE_COLOR=1` keeps them (for
`less -R`, or logs of continuous integration), `NO_COLOR=1` switches them off. Progress bars are
drawn on a terminal only.

**Ctrl-C** leaves no half-written file: each file is written aside and renamed when it is complete.
What an earlier run had left stays. A sweep keeps the runs that are done, and the same command
continues from there.

**Completion** of commands and options, for bash, zsh, fish and PowerShell, once per shell:

```sh
ballbar --install-completion
```

`ballbar --show-completion` prints the script instead. `ballbar --version` prints the release and a
digest of the code.
"""
_KINDS = {int: "whole number", float: "number", str: "text", Path: "path"}
_SHARED = {"--quiet", "--verbose"}  # at the head of the page


def page_text() -> str:
    """The page."""
    return HEAD + "".join(_panels())


def _panels() -> Iterator[str]:
    for panel, modules in COMMANDS.items():
        yield f"\n## {panel}\n"
        for name, module in modules.items():
            for words, command in _commands(import_module(f"ballbar.commands.{module}").commands):
                if words.split()[0] == name:
                    yield from _command(words, command)


def _commands(app: typer.Typer) -> Iterator[tuple[str, CommandInfo]]:
    """Commands of a module and of the groups in it, with the words that call them."""
    for command in app.registered_commands:
        assert command.callback is not None
        yield command.callback.__name__, command
    for group in app.registered_groups:
        assert group.typer_instance is not None
        for words, command in _commands(group.typer_instance):
            yield f"{group.typer_instance.info.name} {words}", command


def _command(name: str, command: CommandInfo) -> Iterator[str]:
    """Heading, purpose, usage, arguments, options, example."""
    function = command.callback
    assert function is not None
    parameters = list(_parameters(function))
    usage = " ".join(text for text, kind, _ in parameters if kind is ArgumentInfo)
    yield f"\n### {name}\n\n"
    yield f"```sh\nballbar {name} {usage}\n```\n\n"
    yield "\n\n".join(" ".join(part.split()) for part in _paragraphs(function)) + "\n"
    rows = [row for _, _, row in parameters if row]
    if rows:
        yield "\n| | values | default | meaning |\n|---|---|---|---|\n" + "".join(rows)
    if command.epilog:
        yield f"\n{command.epilog}\n"


def _paragraphs(function: Callable[..., Any]) -> list[str]:
    return (inspect.getdoc(function) or "").split("\n\n")


def _parameters(function: Callable[..., Any]) -> Iterator[tuple[str, type, str]]:
    """Name as typed, kind (argument or option) and row of the table of each parameter."""
    hints = get_type_hints(function, include_extras=True)
    for parameter in inspect.signature(function).parameters.values():
        hint, info = _described(hints[parameter.name])
        optional = parameter.default is not inspect.Parameter.empty
        if isinstance(info, ArgumentInfo):
            shown = info.metavar or parameter.name.upper()
            many = " ..." if get_origin(_without_none(hint)) is list else ""
            typed = f"[{shown}{many}]" if optional else f"{shown}{many}"
        else:
            declared = (info.default, *(info.param_decls or ()))  # the first name is taken for it
            names = [text for text in declared if isinstance(text, str)]
            shown = ", ".join(names or [f"--{parameter.name.replace('_', '-')}"])
            typed = shown
        default = "" if optional else "required"
        if optional and parameter.default not in (None, False):
            default = f"`{parameter.default}`"
        row = f"| `{shown}` | {_values(hint, info)} | {default} | {_text(info.help)} |\n"
        yield typed, type(info), "" if shown in _SHARED else row


def _described(hint: Any) -> tuple[Any, ArgumentInfo | OptionInfo]:
    """Type and description of a parameter's annotation."""
    assert get_origin(hint) is Annotated, f"{hint} carries no description"
    kind, *rest = get_args(hint)
    (info,) = (part for part in rest if isinstance(part, ArgumentInfo | OptionInfo))
    return kind, info


def _without_none(hint: Any) -> Any:
    kinds = [kind for kind in get_args(hint) if kind is not type(None)]
    return kinds[0] if type(None) in get_args(hint) and len(kinds) == 1 else hint


def _values(hint: Any, info: ArgumentInfo | OptionInfo) -> str:
    """Values that may follow an option, with its limits; empty for a switch."""
    kind = _without_none(hint)
    many = get_origin(kind) is list
    kind = get_args(kind)[0] if many else kind
    if kind is bool:
        return ""
    if get_origin(kind) is Literal:
        return ", ".join(f"`{choice}`" for choice in get_args(kind))
    named = isinstance(info, OptionInfo) and info.metavar
    text = f"`{_text(info.metavar)}`" if named else _KINDS.get(kind, str(kind))
    limits = [
        f"{sign} {limit:g}"
        for sign, limit in (("≥", info.min), ("≤", info.max))
        if limit is not None
    ]
    text = f"{text} ..." if many else text
    return ", ".join([" ".join([text, *limits[:1]]), *limits[1:]])


def _text(words: str | None) -> str:
    return " ".join((words or "").split()).replace("|", "\\|")


if __name__ == "__main__":
    write_whole(PAGE, page_text().encode())
    typer.echo(f"Wrote {PAGE}")
