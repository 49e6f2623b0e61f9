"""The command `ballbar plan`: what is computed before anyone goes to the cell."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from ballbar.commands.options import AsJson, Out, Overrides, say_json
from ballbar.terminal import err, out, silence
from planning.questions import CHANGES, ENCODERS

WHAT_IF = (*CHANGES, ENCODERS)

commands = typer.Typer()


@commands.command(epilog="Example: `ballbar plan scenarios/plans/irb2400.yaml --out plans/irb2400`")
def plan(
    request: Annotated[
        Path,
        typer.Argument(
            help="Planning request, such as scenarios/plans/irb2400.yaml for a ball-bar or "
            "scenarios/plans/irb2400_tracker.yaml for still poses.",
            metavar="REQUEST",
        ),
    ],
    out_dir: Out = None,
    seconds: Annotated[
        float,
        typer.Option(
            help="Longest duration of the search; 0 takes the first feasible trajectory.", min=0.0
        ),
    ] = 110.0,
    path: Annotated[
        Path | None,
        typer.Option(
            "--path",
            help="Evaluate, check and export this path file instead of a search.",
            metavar="FILE",
        ),
    ] = None,
    position: Annotated[
        str | None,
        typer.Option(help="Base position of the ball-bar [m], with --path.", metavar="X,Y,Z"),
    ] = None,
    what_if: Annotated[
        list[str] | None,
        typer.Option(
            "--what-if",
            help="Print the expected TCP error for other values of one of "
            f"{', '.join(WHAT_IF)}; may be repeated.",
            metavar="KEY=A,B",
        ),
    ] = None,
    after: Annotated[
        list[Path] | None,
        typer.Option(
            "--after",
            help="A result of this robot's recordings (calibration.yaml or its folder): plan what "
            "adds most to it. May be repeated.",
            metavar="RESULT",
        ),
    ] = None,
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
    """
    from ballbar.commands.result_json import plan_data
    from ballbar.plan.show import default_folder, parse_position, plan_path
    from cell.errors import InputError
    from planning.poses.request import holds_pose_request

    changes = overrides or ()
    if holds_pose_request(request, overrides=changes):
        _refuse_path_options(
            {"--path": path, "--position": position, "--what-if": what_if, "--after": after}
        )
        raise typer.Exit(_plan_poses(request, out_dir, seconds, changes, as_json=as_json))
    if position is not None and path is None:
        raise InputError(
            "--position belongs to --path. For a search, set cell.ballbar_position_m or "
            "cell.ballbar_region_m of the request, here with --set."
        )
    base = None if position is None else parse_position(position)
    folder = out_dir or default_folder(request, changes)
    if as_json:
        silence()
    feasible = plan_path(
        request,
        folder=folder,
        path=path,
        position=base,
        seconds=seconds,
        what_if=what_if or (),
        after=after or (),
        overrides=changes,
        out=out,
        err=err,
    )
    if as_json:
        say_json(plan_data(folder, feasible=feasible))
    raise typer.Exit(0 if feasible else 1)


def _plan_poses(
    request: Path, folder: Path | None, seconds: float, changes: Sequence[str], *, as_json: bool
) -> int:
    """Plans still poses; returns the exit code."""
    from ballbar.commands.result_json import plan_data
    from ballbar.plan.poses import default_pose_folder, plan_poses

    folder = folder or default_pose_folder(request, changes)
    if as_json:
        silence()
    clear = plan_poses(request, folder=folder, seconds=seconds, overrides=changes, out=out, err=err)
    if as_json:
        say_json(plan_data(folder, feasible=clear))
    return 0 if clear else 1


def _refuse_path_options(options: dict[str, object]) -> None:
    from cell.errors import InputError

    for name, value in options.items():
        if value:
            raise InputError(f"{name} belongs to trajectories; a plan of still poses has none.")
