"""Commands of the test bench: a scenario run once, many times or as a day at the cell; claims."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from ballbar.cell.errors import InputError
from ballbar.cell.files import require_writable
from ballbar.cell.plugins import PluginTable
from ballbar.commands.options import (
    AsJson,
    Out,
    ScenarioFile,
    command,
    command_line,
    replacing,
    say_json,
)
from ballbar.terminal import INTERRUPTED, err, out, progress_bar, silence

if TYPE_CHECKING:  # each command loads what it shows alone
    from ballbar.rehearsal.day import Stage
    from ballbar.replay.live import LiveRun
    from ballbar.result.run_data import RunData
    from ballbar.truth.limits import Limit

CLAIM_WORKERS = 2  # processes: claims are run on laptops and in continuous integration

commands = typer.Typer()
SOURCES = ", ".join(f"errors.{name}" for name in PluginTable("error_sources", {}))
Overrides = Annotated[
    list[str] | None, replacing(f" Error sources of plug-ins: {SOURCES}." if SOURCES else "")
]


@command(commands)
def run(
    scenario: ScenarioFile,
    out_dir: Out = None,
    live: bool = False,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a scenario, identify the robot from its logs, and compare it with the truth.

    Prints the result; writes recording/, calibration.yaml, import_report.json, report.html and
    run.rrd to DIR (default runs/NAME), of a scenario of still poses recording/, calibration.yaml
    and report.html. Exits with 1 when a limit under `accept` is not met.

    Example: `ballbar run scenarios/irb2400.yaml --out runs/irb2400`

    --live : Show the cell in a rerun window while it is simulated, then the replay.
    """
    from ballbar.cell.processes import second_process
    from ballbar.result.names import REPLAY_MODULES
    from ballbar.scenario import load_scenario

    settings = load_scenario(scenario, overrides=overrides or ())
    folder, moves = out_dir or Path("runs") / settings.name, settings.path is not None
    if as_json:
        silence()
    if live and not moves:
        what = "--live shows a motion, and in a scenario of still poses nothing moves."
        raise InputError.at(scenario, what, "Leave it out.")
    with (
        _live_window() if live else nullcontext() as window,
        progress_bar() as progress,
        second_process(*REPLAY_MODULES) if moves else nullcontext(partial) as begin,
    ):
        from ballbar.run import run_scenario

        def answer(run: RunData) -> None:
            with progress.removed():
                _say_run(run)

        data = run_scenario(
            settings,
            scenario,
            out=folder,
            command=command_line(),
            progress=progress,
            answered=answer,
            live=window,
            begin=begin,
        )
    if as_json:
        from ballbar.commands.result_json import run_data

        say_json(run_data(data, folder))
    report, name = escape(str(folder / "report.html")), escape(str(folder))
    out.print(f"Look at {report}" + (f", or: ballbar replay {name}" if moves else ""))
    raise typer.Exit(0 if data.acceptable else 1)


def _say_run(data: RunData) -> None:
    from ballbar.report.terminal import say_comparison, say_identification

    say_identification(out, data)
    if data.simulation is not None:
        out.print(escape(data.simulation.plant))
    if data.comparison is not None:
        say_comparison(out, data.comparison)
    _say_limits(data.limits)


def _live_window() -> AbstractContextManager[LiveRun]:
    from ballbar.replay.live import live_run

    return live_run()


def _say_limits(limits: Sequence[Limit]) -> None:
    for limit in limits:
        word = "[green]met   [/]" if limit.met else "[red]missed[/]"
        measured, allowed = limit.sizes
        out.print(f"  {word} {limit.what} {measured} (limit {allowed})")


@command(commands)
def simulate(
    scenario: ScenarioFile,
    out_dir: Out = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a scenario and write its device logs as a recording.

    The truth is written beside the recording's folder, not into it. Exits with 1 when a limit of
    the plant under `accept` is not met.

    Example: `ballbar simulate scenarios/irb2400.yaml --out runs/logs`
    """
    from ballbar.commands.bench_json import simulation_data
    from ballbar.run import simulate_scenario
    from ballbar.scenario import load_scenario
    from ballbar.sim.recording_files import truth_path
    from ballbar.truth.limits import plant_limits

    settings = load_scenario(scenario, overrides=overrides or ())
    folder = out_dir or Path("runs") / f"{settings.name}-recording"
    with progress_bar() as progress:
        simulation = simulate_scenario(settings, scenario, folder, progress=progress)
    limits = plant_limits(simulation.truth, settings.accept)
    if as_json:
        say_json(simulation_data(simulation, limits, folder))
    out.print(escape(simulation.plant))
    _say_limits(limits)
    what = "Poses" if simulation.still else "Recording"
    out.print(f"{what} {escape(str(folder))}, truth {escape(str(truth_path(folder)))}")
    raise typer.Exit(0 if all(limit.met for limit in limits) else 1)


@command(commands)
def rehearse(
    scenario: ScenarioFile,
    out_dir: Out = None,
    speed: Annotated[float, typer.Option(min=0.1, max=20.0)] = 10.0,
    fault: str | None = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Rehearse a day: record live, identify, plan a second path, identify, correct, verify.

    A simulated PLC and controller deliver the paths to the recorder over ADS and EGM; files of a
    sensed length grow. Writes recordings, results, plan, targets, rehearsal.html and rehearsal.json
    to DIR (default runs/NAME-rehearsal). Exits with 1 when a limit under `accept` is not met, for
    an alarm without a fault, and for a fault that nothing notices.

    Example: `ballbar rehearse irb2400`, or `ballbar rehearse irb2400 --fault slip`

    --speed : Times real time at which the robot moves; less while the identification is late.
    --fault NAME : Fault that begins midway in the first path, such as slip or tool_moved.
    """
    from ballbar.record.show import ads_reader
    from ballbar.rehearsal.day import Day
    from ballbar.rehearsal.files import chain, rehearse_into
    from ballbar.scenario import load_scenario

    settings = load_scenario(scenario, overrides=overrides or (), moving=True)
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
        day = Day(
            settings,
            scenario,
            folder,
            speed=speed,
            fault=fault,
            command=command_line(),
            show=show,
            progress=progress,
        )
        rehearsal = rehearse_into(day)
    if as_json:
        say_json(chain(rehearsal))
    _say_limits(rehearsal.limits)
    took = rehearsal.day.took
    out.print(f"Look at {escape(str(folder / 'rehearsal.html'))}; {took:.0f} s in all")
    raise typer.Exit(0 if rehearsal.acceptable else 1)


@command(commands)
def sweep(
    file: Path,
    out_dir: Out = None,
    workers: Annotated[int | None, typer.Option(min=1)] = None,
    scheduler: str | None = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Run a scenario many times with varied values and seeds; write one table with a row per run.

    Writes NAME.parquet and NAME.csv to DIR (default runs/NAME-sweep). After an interruption the
    same command goes on where it stopped. Exits with 1 when every run failed, with 130 when it was
    stopped.

    Example: `ballbar sweep scenarios/sweeps/noise.yaml --workers 4`, or on a cluster `--scheduler
    tcp://10.0.0.5:8786`

    FILE : Sweep file, such as scenarios/sweeps/noise.yaml.
    --workers : Worker processes on this machine. Default: one for each core.
    --scheduler ADDRESS : Run on the workers of this Dask scheduler instead.
    """
    from ballbar.commands.bench_json import sweep_data
    from ballbar.sweep.check import load_sweep
    from ballbar.sweep.run import dask_cluster, processes, run_sweep
    from ballbar.sweep.show import run_bar, say_outcome
    from ballbar.trial.trial import run_trial

    if workers is not None and scheduler is not None:
        raise InputError(
            f"--workers {workers} counts processes on this machine; with --scheduler {scheduler} "
            "the cluster's own workers compute. Leave one of the two out."
        )
    settings = load_sweep(file, overrides or ())
    folder = out_dir or Path("runs") / f"{settings.plan.data.name}-sweep"
    pool = (
        partial(dask_cluster, address=scheduler)
        if scheduler
        else partial(processes, count=workers or os.cpu_count() or 1)
    )
    with run_bar(err, settings.plan) as progress:
        outcome = run_sweep(settings, folder, run_trial, pool, progress=progress)
    if as_json:
        say_json(sweep_data(outcome))
    succeeded = say_outcome(out, outcome)
    if not outcome.finished:
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(0 if succeeded else 1)


@command(commands)
def claims(
    names: list[str] | None = None,
    quick: bool = False,
    page: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Check the thesis's statements against the runs behind each of them.

    Exits with 1 when a check fails.

    Example: `ballbar claims --quick`, or `ballbar claims noise`

    NAME : Names of claim files in scenarios/claims, or paths. Default: all of that folder.
    --quick : Use fewer points and seeds: less than a minute for all.
    --out FILE.md : Write the claims with their plots as a page.
    """
    from ballbar.claims.run import judge_all, topics
    from ballbar.claims.show import say_verdicts, write_page
    from ballbar.commands.bench_json import claims_data
    from ballbar.sweep.run import process_pool
    from ballbar.sweep.show import run_bar

    if page is not None and names:
        raise InputError(
            f"--out {page}: the page is of all claims; leave out {', '.join(names)}, or --out."
        )
    chosen = topics(names or ())
    if page is not None:
        require_writable(page.parent)
    with (
        TemporaryDirectory(prefix="ballbar-claims-") as folder,
        process_pool(CLAIM_WORKERS) as workers,
    ):
        showing = partial(run_bar, err)
        judged = judge_all(chosen, Path(folder), workers, quick=quick, showing=showing)
    if as_json:
        say_json(claims_data(judged))
    passed = say_verdicts(out, judged)
    if page is not None:
        write_page(page, judged)
        out.print(f"Page {escape(str(page))}")
    raise typer.Exit(0 if passed else 1)
