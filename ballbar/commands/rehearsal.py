"""The command `ballbar rehearse`: a whole day at the cell on the bench."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from ballbar.commands.options import AsJson, Out, Overrides, ScenarioFile, command_line, say_json
from ballbar.terminal import out, progress_bar, silence
from cell.errors import InputError

if TYPE_CHECKING:
    from ballbar.rehearsal.day import Stage

commands = typer.Typer()


@commands.command(
    epilog="Example: `ballbar rehearse irb2400`, or `ballbar rehearse irb2400 --fault slip`"
)
def rehearse(
    scenario: ScenarioFile,
    out_dir: Out = None,
    speed: Annotated[
        float,
        typer.Option(
            help="Times real time at which the robot moves; less while the identification is late.",
            min=0.1,
            max=20.0,
        ),
    ] = 10.0,
    fault: Annotated[
        str | None,
        typer.Option(
            help="Fault that begins midway in the first path, which is recorded again once it was "
            "noticed, such as slip, encoder_frozen or tool_moved.",
            metavar="NAME",
        ),
    ] = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Rehearse a day: record live, identify, plan a second path, identify, correct, verify.

    A simulated PLC and controller deliver the paths to the recorder over ADS and EGM; files of a
    sensed length grow. Writes recordings, results, plan, targets, rehearsal.html and rehearsal.json
    to DIR (default runs/NAME-rehearsal). Exits with 1 when a limit under `accept` is not met, for
    an alarm without a fault, and for a fault that nothing notices.
    """
    from ballbar.record.show import ads_reader
    from ballbar.rehearsal.files import chain, rehearse_into
    from ballbar.scenario import load_scenario

    settings = load_scenario(scenario, overrides=overrides or ())
    if settings.cell.instrument is None:
        ads_reader("a simulated PLC")
    if settings.identify.cost != "ml" or settings.identify.data != "files":
        raise InputError(f"{scenario}: a rehearsal identifies device logs with ml.")
    folder = out_dir or Path("runs") / f"{settings.name}-rehearsal"
    if as_json:
        silence()

    def show(stage: Stage) -> None:
        word = "[green]ok[/]    " if stage.met else "[red]missed[/]"
        out.print(f"{word} {stage.took:4.0f} s  {escape(f'{stage.name}: {stage.sentence}')}")

    with progress_bar() as progress:
        day = rehearse_into(
            folder,
            settings,
            file=scenario,
            speed=speed,
            fault=fault,
            command=command_line(),
            show=show,
            progress=progress,
        )
    if as_json:
        say_json(chain(day))
    for limit in day.limits:
        word = "[green]met   [/]" if limit.met else "[red]missed[/]"
        measured, allowed = limit.sizes
        out.print(f"  {word} {limit.what} {measured} (limit {allowed})")
    out.print(f"Look at {escape(str(folder / 'rehearsal.html'))}; {day.took:.0f} s in all")
    raise typer.Exit(0 if day.acceptable else 1)
