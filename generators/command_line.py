"""docs/command_line.md: every command with arguments and options, from the texts of `--help`.

python -m generators.command_line
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import typer
from typer.models import ArgumentInfo, CommandInfo, OptionInfo

from ballbar.cell.files import write_whole
from ballbar.commands.listing import COMMANDS
from ballbar.commands.options import Out, ResultFile, ScenarioFile

PAGE = Path(__file__).parents[1] / "docs/command_line.md"
HEAD = """# Command line

Written by `python -m generators.command_line` from the texts of `--help`; do not edit.

## What holds for every command

**Exit codes.** 0: done. 1: the result is not acceptable; the first line says why. 2: bad input;
the message names file, line and key, and the remedy. 3: a fault of the program, whose details are
written to a file to be reported, or too little memory; a result that its own reader refuses is kept
in calibration.refused.yaml. 130: ended by Ctrl-C or SIGTERM, but `record`, `watch` and the search
of `plan`, which then go on to their result.

**Output.** Results go to standard output, everything else to standard error. `--quiet`, `-q`
leaves nothing but errors and JSON. `--verbose`, `-v` prints each stage with the second at which it
began. Both may stand before the name of the command. In a pipe there are no colours
(`FORCE_COLOR=1` keeps them, `NO_COLOR=1` leaves them out) and no progress bars. Ctrl-C leaves no
half-written file.

**Common.** `SCENARIO` is a scenario file, or the name of a shipped one such as irb2400; `RESULT` a
calibration.yaml, or the folder that holds it. `--out DIR` of what writes a folder names it; it must
hold nothing else. `--set KEY=VALUE` of what takes a scenario, a sweep or a plan request replaces the
value of a dotted key, such as `seed=2`; repeatable, as everything with `...` below.

**Completion** for bash, zsh, fish and PowerShell: `ballbar --install-completion`; `ballbar
--show-completion` prints the script. `ballbar --version` prints the release and a digest of the
code.

Each command's `--help` says more, with more examples.

## Fields of --json

`--json` prints the result as one JSON value (`watch`: one a line), SI units, with the same exit
code. `comparison`, `plant` and `limits` are null or empty for a real cell.

|command|fields|
|---|---|
|`run`, `identify`|`acceptable`; `sentence`; `folder`, `files`; `calibration`: [calibration.yaml](calibration_file.md); `plant`: largest loop-closure error `closure_position_m`, `closure_angle_rad`, and `rod_force_min_N`, `rod_force_max_N` (pull is positive), of still poses a sentence; `comparison`; `limits`: `what`, `measured`, `allowed`, `unit` (the only numbers not in SI), `met`|
|`compare`|as `comparison`: `tcp_error`, `tcp_error_nominal`: `mean_m`, `max_m`, `mean_without_scale_m`; `deviations`: estimated minus true of each parameter; `distance`: their norm; `clock_offset_error_s`, `clock_skew_error`|
|`simulate`|`recording`, `truth`: paths; `plant`; `limits`; of still poses `force_N` in place of `limits`|
|`plan`|`acceptable`; `folder`, `files`; `plan`: plan.yaml|
|`rehearse`|rehearsal.json: `acceptable`; `scenario`, `robot`, `measured_by`, `seed`, `speed`, `fault`; `wall_time_s`; `stages`: `name`, `sentence`, `met`, `wall_time_s`, `figures`; `limits`|
|`sweep`|`finished`; `runs`, `done`; `folder`; `table`, `csv`, `failed`, `commonest_failure`; `points`: `values`, `runs`, `failed`, `results` (`median`, `q95`) of the columns of [the table](sweeps.md)|
|`claims`|of each file `title` and `claims`: `name`, `source`, `says`, `verdict`, `passed`, checks|
|`check`, `new`|of each file what was read; findings, logs, coarse clock; `new` also `recording`|
|`record`|`recording`; `sources`: counts, losses and events; `missing`; `identified`, the last line of `watch`, or `identification_ended`: why there is none|
|`watch`|`recorded_s`; `rows` by source; `waiting`; `alarms`: `kind`, `sentence`, `raised` [s], `subject`; `verdict`, `model`, `identified_until_s`; `tcp_sigma_m`, `tcp_sigma_without_scale_m`, `tcp_sigma_end_m`; clock; `noise` [rad]; `sphere_covered`, `axes_covered` (0 to 1); `predicted`, `enough`|
|`verify` of a recording|`holds`, `comparable` (false: cannot tell, exit code 2), `sentence`, `warnings`; `position_rms_m`, `angle_rms_rad`; `normalised_innovation`: residual over what noise and stated uncertainty explain; `chi2_per_dof_with_free_machine`; `log_bayes_factor` of a change, `limit`; `causes`: `kind`, `axis`, `parameters`, `size`, `sigma`, `log_bayes_factor`, `named`|
|`verify` of still poses|`holds`, `comparable`, `sentence`, `warnings`; `poses`, `poses_outside_fitted_ranges`; `mean_error_m`, `expected_mean_error_m`, `largest_mean_error_m`; `sum_of_squares`, `degrees_of_freedom`, `limit`; `causes`: `kind`, `name`, `size`, `sigma`, `sum_of_squares_left`, `named`|
|`performance`|`cube_side_m`, `cube_poses`: 4x4 matrices, `cube_axes_rad`, or null; `characteristics`: `symbol`, `name`, `clause`, `place`, `unit`, `cycles`, and of `nominal`, `identified`, `corrected` each `origin` (measured, predicted, not stated), `value`, `low`, `high`, `reason`; `notes`|
|`correct` of a program|`files`; `targets`: `file`, `name`, `line`, `position_error_m`, `angle_error_rad`, `axis_correction_rad`, `left_in_the_model_m`; `notes`|
|`correct` of a table|`file`, `targets`, `included`, `warnings`, `predicted_position_error_m`, `predicted_angle_error_rad` (`mean`, `max`), `left_in_the_model_m`, `largest_axis_correction_rad`|
|`list`|`robots`, `ballbars`, `instruments`, `plates`, `dialects`, `scenarios`: names and titles|
"""  # noqa: E501  rows of a table
_KINDS = {int: "integer", float: "number", str: "text", Path: "path"}
_SHARED = {"--quiet", "--verbose", "--json", "--set"}  # at the head of the page
_SHARED_HELP = [get_args(kind)[1].help for kind in (ScenarioFile, ResultFile, Out)]  # there, too
_REPEATABLE = re.compile(r"[;.,]? ?(?:[Mm]ay be repeated|repeatable)(?=\.|$)")  # `...` says it


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
    """Heading, usage, purpose, arguments, options, example."""
    function = command.callback
    assert function is not None
    parameters = list(_parameters(function))
    usage = " ".join(text for text, kind, _ in parameters if kind is ArgumentInfo)
    yield f"\n### {name}\n\n`{' '.join(filter(None, ('ballbar', name, usage)))}`\n\n"
    yield " ".join((inspect.getdoc(function) or "").split("\n\n")[0].split()) + "\n"
    rows = [row for _, _, row in parameters if row]
    if rows:
        yield "\n| |values (default)|meaning|\n|---|---|---|\n" + "".join(rows)
    if example := re.match(r"Example: `[^`]+`", command.epilog or ""):  # the first; --help has all
        yield f"\n{example[0]}\n"


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
        values = _values(hint, info)
        if optional and parameter.default not in (None, False, ""):
            values += f" (`{parameter.default}`)"
        row = f"|`{shown}`|{values}|{_text(_REPEATABLE.sub('', info.help or ''))}|\n"
        yield typed, type(info), "" if shown in _SHARED or info.help in _SHARED_HELP else row


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
    if isinstance(info, ArgumentInfo) and kind in (str, Path):  # its meaning says which
        text = ""
    if info.min is not None and info.max is not None:
        text = f"{text} {info.min:g} to {info.max:g}"
    elif info.min is not None:
        text = f"{text} ≥ {info.min:g}"
    return f"{text} ...".strip() if many else text


def _text(words: str | None) -> str:
    return " ".join((words or "").split()).replace("|", "\\|")


if __name__ == "__main__":
    write_whole(PAGE, page_text().encode())
    typer.echo(f"Wrote {PAGE}")
