"""The command `ballbar plan`: what is computed before anyone goes to the cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballbar.commands.options import AsJson, Out, Overrides, command, say_json
from ballbar.planning.questions import CHANGES, ENCODERS
from ballbar.terminal import err, out, silence

WhatIf = Annotated[
    list[str] | None,
    typer.Option(
        "--what-if",
        help="Print the expected TCP error for other values of one of "
        f"{', '.join((*CHANGES, ENCODERS))}; repeatable.",
        metavar="KEY=A,B",
    ),
]
commands = typer.Typer()


@command(commands)
def plan(
    request: Path,
    out_dir: Out = None,
    seconds: Annotated[float, typer.Option(min=0.0)] = 110.0,
    path: Path | None = None,
    position: str | None = None,
    what_if: WhatIf = None,
    after: list[Path] | None = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Plan a trajectory or still poses for the cell, predict what they identify, write programs.

    For a ball-bar: path.yaml, scenario.yaml, plan.yaml, plan.svg, path.csv and a program for the
    robot's controller (ABB .mod, Comau .pdl, KUKA .src) in DIR (default runs/NAME-plan). Exits with
    1 when the trajectory violates a limit in MuJoCo. Ctrl-C stops the search and keeps the best
    trajectory so far.

    For still poses of another instrument: poses.csv, poses.yaml, plan.yaml and the program. Exits
    with 1 when a move between two poses comes too close.

    Example: `ballbar plan scenarios/plans/irb2400.yaml --out plans/irb2400`

    REQUEST : Planning request, such as scenarios/plans/irb2400.yaml, or irb2400_tracker.yaml there
        for still poses.
    --seconds : Longest duration of the search; 0 takes the first feasible trajectory.
    --path FILE : Evaluate, check and export this path file instead of a search.
    --position X,Y,Z : Base position of the ball-bar [m], with --path.
    --after RESULT : A result of this robot's recordings, to which the plan adds most; repeatable.
    """
    from ballbar.commands.result_json import plan_data
    from ballbar.plan.show import PlanOptions, make_plan, parse_position
    from ballbar.planning.request import load_request

    planned = load_request(request, overrides=overrides or ())
    folder = out_dir or Path("runs") / f"{planned.name}-plan"
    base = None if position is None else parse_position(position)
    if as_json:
        silence()
    options = PlanOptions(
        folder=folder,
        seconds=seconds,
        out=out,
        err=err,
        overrides=overrides or (),
        path=path,
        position=base,
        what_if=what_if or (),
        after=after or (),
    )
    acceptable = make_plan(planned, request, options)
    if as_json:
        say_json(plan_data(folder, feasible=acceptable))
    raise typer.Exit(0 if acceptable else 1)
