"""The test bench: a scenario run once or many times, the thesis's statements, what a cost can tell."""

from __future__ import annotations

import json
import os
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from rich.markup import escape

from ballbar.commands.options import TEST_BENCH, AsJson, Out, ScenarioFile, command_line, say_json
from ballbar.terminal import INTERRUPTED, err, out, progress_bar
from cell.errors import InputError
from ident.thesis.costs import COSTS

CLAIM_WORKERS = 2  # processes: claims are for a laptop, and for continuous integration


commands = typer.Typer()


@commands.command(
    rich_help_panel=TEST_BENCH,
    epilog="Example: `ballbar run scenarios/irb2400.yaml --out runs/irb2400`",
)
def run(
    scenario: ScenarioFile,
    out_dir: Out = None,
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="Show the cell and the identification in a rerun window as they come."
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Simulate a scenario, identify the robot from its logs, compare with the truth, write report and replay.

    Writes recording/, calibration.yaml, import_report.json, report.html and run.rrd to DIR (default runs/NAME).
    Exits with 1 when a limit under `accept` is not met.
    """
    from ballbar.commands.result_json import run_data
    from ballbar.replay.live import live_run
    from ballbar.report.terminal import say_comparison, say_identification, say_plant
    from ballbar.run import run_scenario
    from ballbar.scenario import load_scenario

    settings = load_scenario(scenario)
    folder = out_dir or Path("runs") / settings.name
    with live_run() if live else nullcontext() as window, progress_bar() as progress:
        data = run_scenario(
            settings, scenario, folder, command=command_line(), progress=progress, live=window
        )
    if as_json:
        say_json(run_data(data, folder))
    say_identification(out, data)
    if data.simulation is not None:
        say_plant(out, data.simulation)
    if data.comparison is not None:
        say_comparison(out, data.comparison)
    for limit in data.limits:
        colour, word = ("green", "met   ") if limit.met else ("red", "missed")
        out.print(
            f"  [{colour}]{word}[/] {limit.what} {limit.measured:.3g}{' ' * bool(limit.unit)}{limit.unit} (limit {limit.allowed:g})"
        )
    out.print(
        f"Look at {escape(str(folder / 'report.html'))}, or: ballbar replay {escape(str(folder))}"
    )
    raise typer.Exit(0 if data.acceptable else 1)


@commands.command(
    rich_help_panel=TEST_BENCH,
    epilog="Example: `ballbar simulate scenarios/irb2400.yaml --out runs/logs`",
)
def simulate(scenario: ScenarioFile, out_dir: Out = None, as_json: AsJson = False) -> None:
    """Simulate a scenario and write its device logs as a recording; the truth goes beside the folder, not into it."""
    from ballbar.commands.result_json import simulation_data
    from ballbar.report.terminal import say_plant
    from ballbar.run import simulate_scenario
    from ballbar.scenario import load_scenario
    from sim.simulate import truth_path

    settings = load_scenario(scenario)
    folder = out_dir or Path("runs") / f"{settings.name}-recording"
    with progress_bar() as progress:
        simulation = simulate_scenario(settings, scenario, folder, progress=progress)
    if as_json:
        say_json(simulation_data(simulation, folder))
    say_plant(out, simulation)
    out.print(f"Recording {escape(str(folder))}, truth {escape(str(truth_path(folder)))}")


@commands.command(
    rich_help_panel=TEST_BENCH,
    epilog="Example: `ballbar sweep scenarios/sweeps/noise.yaml --workers 4`, or on a cluster `--scheduler tcp://10.0.0.5:8786`",
)
def sweep(
    file: Annotated[
        Path, typer.Argument(help="A sweep, such as scenarios/sweeps/noise.yaml.", metavar="FILE")
    ],
    out_dir: Out = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes on this machine; default one a core.", min=1)
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(help="Run on the workers of this Dask scheduler instead.", metavar="ADDRESS"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a scenario many times with values and seeds that vary; one table with a row for each run.

    Writes NAME.parquet and NAME.csv to DIR (default runs/NAME-sweep). Interrupted, the same command goes on where it stopped.
    Exits with 1 when every run failed, with 130 when it was stopped.
    """
    from ballbar.commands.result_json import sweep_data
    from ballbar.sweep.check import load_sweep
    from ballbar.sweep.run import run_sweep
    from ballbar.sweep.show import run_bar, say_outcome
    from ballbar.sweep.workers import dask_cluster, processes
    from ballbar.trial.trial import run_trial

    if workers is not None and scheduler is not None:
        raise InputError(
            "--workers counts processes on this machine; with --scheduler the cluster's own workers compute. Give one."
        )
    settings = load_sweep(file)
    folder = out_dir or Path("runs") / f"{settings.plan.data.name}-sweep"
    computing = (
        partial(dask_cluster, address=scheduler)
        if scheduler
        else partial(processes, count=workers or os.cpu_count() or 1)
    )
    with run_bar(err, settings.plan) as progress:
        outcome = run_sweep(settings, folder, run_trial, computing, progress=progress)
    if as_json:
        say_json(sweep_data(outcome))
    succeeded = say_outcome(out, outcome)
    if not outcome.finished:
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(0 if succeeded else 1)


@commands.command(
    rich_help_panel=TEST_BENCH,
    epilog="Example: `ballbar claims --quick`, or `ballbar claims noise`",
)
def claims(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Of scenarios/claims, or files; default all.", metavar="NAME"),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer points and seeds: less than a minute.")
    ] = False,
    page: Annotated[
        Path | None,
        typer.Option("--out", help="Write them, with figures, as a page.", metavar="FILE.md"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check what the thesis says against what comes out here, by the runs behind each claim.

    Exits with 1 when a check fails.
    """
    from ballbar.claims.run import judge_all, topics
    from ballbar.claims.show import say_verdicts, write_page
    from ballbar.commands.result_json import claims_data
    from ballbar.sweep.show import run_bar
    from ballbar.sweep.workers import process_pool

    if page is not None and names:
        raise InputError("--out: the page is of all claims; leave the names out.")
    chosen = topics(names or ())
    with (
        TemporaryDirectory(prefix="ballbar-claims-") as work,
        process_pool(CLAIM_WORKERS) as computing,
    ):
        judged = judge_all(
            chosen, Path(work), computing, quick=quick, showing=partial(run_bar, err)
        )
    if as_json:
        say_json(claims_data(judged))
    passed = say_verdicts(out, judged)
    if page is not None:
        write_page(page, judged)
        out.print(f"Page {escape(str(page))}")
    raise typer.Exit(0 if passed else 1)


@commands.command(
    rich_help_panel=TEST_BENCH,
    epilog="Example: `ballbar identifiability scenarios/irb2400.yaml --cost all --encoders 1,2,4,5`",
)
def identifiability(
    scenario: ScenarioFile,
    cost: Annotated[
        str | None,
        typer.Option(help=f"{', '.join(COSTS)} or all; default: the scenario's.", metavar="NAME"),
    ] = None,
    encoders: Annotated[
        str | None,
        typer.Option(
            help="Ball-bar joints with an encoder, such as 1,2,4,5, or none; default: the scenario's.",
            metavar="LIST",
        ),
    ] = None,
    complete: Annotated[
        bool,
        typer.Option(
            "--complete", help="Ask for Hayati angles and base tilt too, which the thesis has not."
        ),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """What a cost can tell of the parameters on a scenario's path: thesis Tables 3.2 to 3.4, and what to keep (sec. 3.3).

    Judged on the nominal mechanism; nothing is simulated.
    """
    from ballbar.identifiability import (
        LEGEND,
        chosen_costs,
        influences,
        nominal_loop,
        parse_encoders,
        study,
        study_data,
        study_lines,
    )
    from ballbar.scenario import load_scenario

    settings = load_scenario(scenario)
    fitted = settings.encoders.fitted if encoders is None else parse_encoders(encoders)
    costs, passed_over = chosen_costs(settings.identify.cost if cost is None else cost, fitted)
    loop = nominal_loop(settings, relative_to=scenario.parent)
    with progress_bar() as progress:
        found = []
        for name in costs:
            progress(name)
            judged = study(loop, name, fitted, complete=complete)
            found.append((judged, influences(loop, judged)))
    if as_json:
        tables = [study_data(judged, moved) for judged, moved in found]
        typer.echo(
            json.dumps(
                {"scenario": settings.name, "costs": tables, "passed_over": passed_over}, indent=2
            )
        )
        return
    for judged, moved in found:
        for k, line in enumerate(study_lines(judged, moved)):
            out.print(f"[bold]{escape(line)}[/]" if k == 0 else escape(line))
        out.print()
    for name, reason in passed_over.items():
        out.print(f"[yellow]passed over:[/] {name}, {escape(reason)}")
    out.print(f"[dim]{escape(LEGEND)}[/]")
