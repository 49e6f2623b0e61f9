"""The command `ballbar identifiability`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated

import typer
from rich.markup import escape

from ballbar.cell.errors import InputError
from ballbar.commands.options import AsJson, Overrides, ScenarioFile, command, say_json
from ballbar.ident.thesis.names import COSTS
from ballbar.terminal import out, progress_bar

commands = typer.Typer()


@command(commands)
def identifiability(
    scenario: ScenarioFile,
    cost: Annotated[
        str | None,
        typer.Option(
            help=f"Cost to study: {', '.join(COSTS)}, or all. Default: that of the scenario.",
            metavar="NAME",
        ),
    ] = None,
    encoders: str | None = None,
    complete: bool = False,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Show what a cost can identify on a scenario's path, as thesis Tables 3.2 to 3.4 do.

    The study uses the nominal mechanism; nothing is simulated. It lists parameters without effect,
    dependencies between the others, and which of them to keep (thesis sec. 3.3).

    Example: `ballbar identifiability scenarios/irb2400.yaml --cost all --encoders 1,2,4,5`

    --encoders LIST : Ball-bar joints with an encoder, such as 1,2,4,5, or none. Default: those of
        the scenario.
    --complete : Include the Hayati angles and the tilt of the base, which the thesis leaves out.
    """
    from ballbar.identifiability import (
        LEGEND,
        influences,
        nominal_loop,
        study,
        study_data,
        study_lines,
    )
    from ballbar.scenario import load_scenario

    settings = load_scenario(scenario, overrides=overrides or (), moving=True)
    fitted = settings.encoders.fitted if encoders is None else parse_encoders(encoders)
    costs, passed_over = chosen_costs(cost or settings.identify.cost, fitted)
    loop = nominal_loop(settings, relative_to=scenario.parent)
    with progress_bar() as progress:
        results = []
        for name in costs:
            progress(name)
            result = study(loop, name, fitted, complete=complete)
            results.append((result, influences(loop, result)))
    if as_json:
        tables = [study_data(result, changes) for result, changes in results]
        say_json({"scenario": settings.name, "costs": tables, "passed_over": passed_over})
        return
    for result, changes in results:
        title, *lines = (escape(line) for line in study_lines(result, changes))
        out.print("\n".join([f"[bold]{title}[/]", *lines, ""]))
    for name, reason in passed_over.items():
        out.print(f"[yellow]passed over:[/] {name}, {escape(reason)}")
    out.print(f"[dim]{escape(LEGEND)}[/]")


def parse_encoders(text: str) -> tuple[int, ...]:
    """`1,2,4,5` as numbers of ball-bar joints, `none` as no encoder. Raises InputError."""
    from ballbar.cell.geometry import BAR_ROWS

    if text.strip() == "none":
        return ()
    parts = [part.strip() for part in text.split(",")]
    known = all(re.fullmatch(f"[1-{BAR_ROWS}]", part) for part in parts)
    if not known or len(set(parts)) < len(parts):
        raise InputError(
            f"--encoders {text}: give different ball-bar joints from 1 to {BAR_ROWS}, such as "
            "1,2,4,5, or none"
        )
    return tuple(sorted(int(part) for part in parts))


def chosen_costs(name: str, fitted: Sequence[int]) -> tuple[list[str], dict[str, str]]:
    """The costs to study, and of `all` the reasons why others are passed over.

    name : one of COSTS, or `all`. fitted : ball-bar joints with an encoder.

    Raises InputError for another name, and where a single cost lacks encoders.
    """
    from ballbar.identifiability import encoders_used

    if name != "all" and name not in COSTS:
        raise InputError(f"--cost {name}: unknown; choose one of {', '.join(COSTS)}, or all")
    candidates = COSTS if name == "all" else (name,)
    encoders = ", ".join(f"b{j}" for j in fitted) or "none"
    passed_over = {}
    for cost in candidates:
        if lacking := [f"b{j}" for j in encoders_used(cost, ()) if j not in fitted]:
            passed_over[cost] = f"needs {', '.join(lacking)}; fitted: {encoders}"
    if name in passed_over:
        remedy = "Use --encoders to choose others, or --cost ml, which takes any."
        raise InputError.at(f"--cost {name}", f"{passed_over[name]}.", remedy)
    return [cost for cost in candidates if cost not in passed_over], passed_over
