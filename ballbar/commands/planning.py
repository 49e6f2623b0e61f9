"""What is worth doing at the cell, before anyone goes there."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballbar.commands.options import AT_THE_CELL, AsJson, Out, say_json
from ballbar.terminal import err, out, silence
from planning.what_if import CHANGES, ENCODERS

WHAT_IF = (*CHANGES, ENCODERS)


commands = typer.Typer()


@commands.command(
    rich_help_panel=AT_THE_CELL,
    epilog="Example: `ballbar plan scenarios/plans/irb2400.yaml --out plans/irb2400`",
)
def plan(
    request: Annotated[
        Path,
        typer.Argument(
            help="What is asked for, such as scenarios/plans/irb2400.yaml.", metavar="REQUEST"
        ),
    ],
    out_dir: Out = None,
    seconds: Annotated[
        float, typer.Option(help="For the search; 0 takes the first path that can be run.", min=0.0)
    ] = 110.0,
    path: Annotated[
        Path | None,
        typer.Option(
            "--path", help="Judge, check and export this path file instead.", metavar="FILE"
        ),
    ] = None,
    position: Annotated[
        str | None,
        typer.Option(help="Where the ball-bar stands [m], with --path.", metavar="X,Y,Z"),
    ] = None,
    what_if: Annotated[
        list[str] | None,
        typer.Option(
            "--what-if",
            help=f"Expected TCP error if one of {', '.join(WHAT_IF)} were another; may be repeated.",
            metavar="KEY=A,B",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Plan a path for the cell: what it will tell, before anyone goes there, and programs that run it.

    Writes path.yaml, scenario.yaml, plan.yaml, plan.svg, path.csv and programs for ABB (.mod) and Comau (.pdl) to DIR (default
    runs/NAME-plan). Exits with 1 when the path violates a limit in MuJoCo. Ctrl-C stops the search and keeps the best path so far.
    """
    from ballbar.commands.result_json import plan_data
    from ballbar.plan.show import default_folder, parse_position, plan_path

    place = None if position is None else parse_position(position)
    folder = out_dir or default_folder(request)
    if as_json:
        silence()
    kept = plan_path(
        request,
        folder=folder,
        path=path,
        position=place,
        seconds=seconds,
        what_if=what_if or (),
        out=out,
        err=err,
    )
    if as_json:
        say_json(plan_data(folder, kept=kept))
    raise typer.Exit(0 if kept else 1)
