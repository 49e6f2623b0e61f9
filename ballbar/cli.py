"""The command line. Exit codes: 0 done, 1 ran but the result is not acceptable, 2 bad input."""

from __future__ import annotations

import json
import os
import shlex
import sys
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from pydantic import ValidationError
from rich.markup import escape

from acquisition import explain_lines, read_recording
from acquisition.live.recorder import RecorderError
from acquisition.times import TIME_FORMS
from ballbar import check as check_page
from ballbar.claim_command import say_verdicts, write_page
from ballbar.claim_run import judge_all, topics
from ballbar.compare import Comparison, compare, compare_with_truth
from ballbar.correct import correct_file, correction_data, correction_lines, write_corrected
from ballbar.export import Format, export_summary, exported, write_export
from ballbar.export_result import load_result
from ballbar.identifiability import COSTS, LEGEND, chosen_costs, influences, nominal_loop, parse_encoders, study, study_data, study_lines
from ballbar.iterations import IterationLog
from ballbar.new_recording import Told, new_recording
from ballbar.plan_command import default_folder, parse_position, plan_path
from ballbar.replay import ViewerError, open_viewer, serve_web
from ballbar.replay_command import Layout, chosen_replay
from ballbar.replay_live import live_run
from ballbar.report_terminal import say_identification
from ballbar.result_json import claims_data, comparison_data, plan_data, run_data, simulation_data, sweep_data
from ballbar.run import OUTPUTS, run_scenario, simulate_scenario, write_outputs
from ballbar.run_recordings import identify_recordings
from ballbar.scenario import IdentifySettings, load_scenario
from ballbar.sweep_check import load as load_sweep
from ballbar.sweep_command import run_bar, say_outcome
from ballbar.sweep_run import SweepError, run_sweep
from ballbar.sweep_workers import dask_cluster, process_pool, processes
from ballbar.terminal import INTERRUPTED, CommandGroup, Quiet, Verbose, err, fresh_terminal, out, progress_bar, silence
from ballbar.trial import run_trial
from cell.descriptions import load_cell
from cell.errors import InputError
from cell.files import claim_folder, write_whole
from cell.inverse import UnreachableError
from cell.schema_errors import explain
from ident.calibration import Calibration, load_calibration
from ident.corrections import CORRECTIONS
from ident.identify import DEFAULT_SAMPLES, ModelName
from ident.machine import ForceSource
from ident.start import StartError
from planning.what_if import CHANGES, ENCODERS
from sim.plant import PlantError
from sim.simulate import Simulation, truth_path
from sim.statics import NoEquilibriumError
from sim.truth import load_truth

WHAT_IF = (*CHANGES, ENCODERS)
CLAIM_WORKERS = 2  # processes: claims are for a laptop, and for continuous integration

app = typer.Typer(
    cls=CommandGroup,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)

ScenarioFile = Annotated[Path, typer.Argument(help="A scenario, such as scenarios/irb2400.yaml.", metavar="SCENARIO")]
RecordingFolder = Annotated[Path, typer.Argument(help="A folder with recording.yaml and the device files.", metavar="RECORDING")]
ResultFile = Annotated[Path, typer.Argument(help="A calibration.yaml, or the folder that holds it.", metavar="RESULT")]
Out = Annotated[Path | None, typer.Option("--out", help="Folder for the output; nothing else may be in it.", metavar="DIR")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON, SI units, and no words.")]


@app.callback()
def shared(quiet: Quiet = False, verbose: Verbose = False) -> None:
    """Robot calibration with a sensed double ball-bar: simulate the cell, read its logs, identify the robot, look at the result."""


@app.command(epilog="Example: `ballbar run scenarios/irb2400.yaml --out runs/irb2400`")
def run(
    scenario: ScenarioFile,
    out_dir: Out = None,
    live: Annotated[bool, typer.Option("--live", help="Show the cell and the identification in a rerun window as they come.")] = False,
    as_json: AsJson = False,
) -> None:
    """Simulate a scenario, identify the robot from its logs, compare with the truth, write report and replay.

    Writes recording/, calibration.yaml, report.html and run.rrd to DIR (default runs/NAME).
    Exits with 1 when a limit under `accept` is not met.
    """
    settings = load_scenario(scenario)
    folder = out_dir or Path("runs") / settings.name
    with live_run() if live else nullcontext() as window, progress_bar() as progress:
        data = run_scenario(settings, scenario, folder, command=_command(), progress=progress, live=window)
    if as_json:
        _say_json(run_data(data, folder))
    say_identification(out, data)
    if data.simulation is not None:
        _say_plant(data.simulation)
    if data.comparison is not None:
        _say_comparison(data.comparison)
    for limit in data.limits:
        colour, word = ("green", "met   ") if limit.met else ("red", "missed")
        out.print(f"  [{colour}]{word}[/] {limit.what} {limit.measured:.3g}{' ' * bool(limit.unit)}{limit.unit} (limit {limit.allowed:g})")
    out.print(f"Look at {escape(str(folder / 'report.html'))}, or: ballbar replay {escape(str(folder))}")
    raise typer.Exit(0 if data.acceptable else 1)


@app.command(epilog="Example: `ballbar simulate scenarios/irb2400.yaml --out runs/logs`")
def simulate(scenario: ScenarioFile, out_dir: Out = None, as_json: AsJson = False) -> None:
    """Simulate a scenario and write its device logs as a recording; the truth goes beside the folder, not into it."""
    settings = load_scenario(scenario)
    folder = out_dir or Path("runs") / f"{settings.name}-recording"
    with progress_bar() as progress:
        simulation = simulate_scenario(settings, scenario, folder, progress=progress)
    if as_json:
        _say_json(simulation_data(simulation, folder))
    _say_plant(simulation)
    out.print(f"Recording {escape(str(folder))}, truth {escape(str(truth_path(folder)))}")


@app.command(epilog="Example: `ballbar check runs/irb2400/recording`, or for programs `ballbar check runs/irb2400/recording --json`")
def check(
    recording: RecordingFolder,
    explain_reading: Annotated[
        bool, typer.Option("--explain", help="Say first how each file will be read, and why: dialect, columns, time, units, encoders.")
    ] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 if anything had to be repaired or left out.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the import report as JSON.")] = False,
) -> None:
    """Read a recording and report what was found and repaired, without identifying anything."""
    if explain_reading and not as_json:
        for line in explain_lines(recording):
            out.print(escape(line))
        out.print()
    read = read_recording(recording)
    alignment = check_page.aligned(read)
    if as_json:
        typer.echo(json.dumps(check_page.check_data(read, alignment), indent=2))
    else:
        for line in check_page.check_lines(read, alignment):
            out.print(f"[bold]{escape(line)}[/]" if line[0] != " " else escape(line))
    if strict and (repaired := check_page.repairs(read)):
        err.print(f"[red]not as logged:[/] {len(repaired)} kinds of repairs were needed, and --strict allows none")
        raise typer.Exit(1)


@app.command(epilog="Example: `ballbar new runs/monday robot.csv ballbar.csv`, and answer what it asks")
def new(
    folder: Annotated[Path, typer.Argument(help="The recording folder to make.", metavar="DIR")],
    robot_log: Annotated[Path, typer.Argument(help="The robot's log.", metavar="ROBOTLOG", exists=True, dir_okay=False)],
    ballbar_log: Annotated[Path, typer.Argument(help="The ball-bar's log.", metavar="BALLBARLOG", exists=True, dir_okay=False)],
    robot: Annotated[str | None, typer.Option(help="Robot, by name or .yaml file.")] = None,
    ballbar: Annotated[str | None, typer.Option(help="Ball-bar, by name or .yaml file.")] = None,
    robot_dialect: Annotated[str | None, typer.Option(help="Dialect of the robot's log, or a .yaml file of your own.")] = None,
    ballbar_dialect: Annotated[str | None, typer.Option(help="Dialect of the ball-bar's log, or a .yaml file.")] = None,
    robot_time: Annotated[str | None, typer.Option(help=f"Its time stamps, if they do not show it: {', '.join(TIME_FORMS)}.")] = None,
    ballbar_time: Annotated[str | None, typer.Option(help="Likewise.")] = None,
    encoder: Annotated[list[str] | None, typer.Option(help="Counter column of an encoder; repeat.", metavar="b1=COLUMN[:-1]")] = None,
    lines: Annotated[int | None, typer.Option(help="Lines of the encoders a turn.", min=1)] = None,
    bits: Annotated[int | None, typer.Option(help="Bits of their interpolation.", min=8, max=13)] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Take what is proposed without asking; fail where nothing can be.")] = False,
) -> None:
    """Make a recording folder from two log files: what they show is proposed, what they cannot show is asked.

    The folder appears only once it has been read without error.
    """
    told = Told(robot, ballbar, robot_dialect, ballbar_dialect, robot_time, ballbar_time, tuple(encoder or ()), lines, bits)
    read = new_recording(folder, robot_log, ballbar_log, told, partial(_answer, proposals_taken=yes))
    for line in check_page.check_lines(read, None):
        out.print(f"[bold]{escape(line)}[/]" if line[0] != " " else escape(line))
    out.print(f"Made {escape(str(folder))}. Look at recording.yaml in it, then: ballbar check {escape(str(folder))}")


def _answer(question: str, proposal: str | None, *, proposals_taken: bool) -> str:
    """What the user answers, or the proposal."""
    if proposals_taken and proposal is not None:
        out.print(f"{escape(question)} [bold]{escape(proposal)}[/]")
        return proposal
    if proposals_taken or not sys.stdin.isatty():
        raise InputError(f"not told: {question}{f' Proposed: {proposal}; --yes takes it.' * bool(proposal)} Nothing was written.")
    return str(typer.prompt(question, default=proposal))


@app.command(epilog="Example: `ballbar identify runs/a/recording runs/b/recording --validate runs/c/recording --out runs/together`")
def identify(
    recordings: Annotated[
        list[Path], typer.Argument(help="Folders with recording.yaml and the device files, of one robot.", metavar="RECORDING")
    ],
    validate: Annotated[
        list[Path] | None,
        typer.Option("--validate", help="A recording to try the result on, not fitted; may be repeated.", metavar="RECORDING"),
    ] = None,
    out_dir: Out = None,
    samples: Annotated[int, typer.Option(help="Instants of the logs that enter the fit.", min=50, max=100_000)] = DEFAULT_SAMPLES,
    model: Annotated[
        ModelName, typer.Option(help="Kinematics alone (dh), or with corrections; auto takes what the recording asks for.")
    ] = "auto",
    corrections: Annotated[
        str, typer.Option(help=f"Of the complete model: auto, or some of {', '.join(CORRECTIONS)}.", metavar="auto|NAME,NAME")
    ] = "auto",
    force: Annotated[ForceSource, typer.Option(help="Where the rod's force comes from; auto takes the best that was logged.")] = "auto",
    rod_sigma: Annotated[
        float | None,
        typer.Option(help="Standard deviation [m] of a measured rod, whose length is bd3 of the ball-bar's file.", metavar="METRES"),
    ] = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="Write the replay file run.rrd too.")] = False,
    as_json: AsJson = False,
) -> None:
    """Identify a robot from one recording, or from several together; try it on others.

    Writes calibration.yaml and report.html to DIR (default: the first RECORDING's folder with -identified behind its name).
    Exits with 1 when the fit or a held-out recording is not acceptable.
    """
    settings = _settings(
        samples=samples,
        model=model,
        corrections="auto" if corrections == "auto" else [name.strip() for name in corrections.split(",")],
        force=force,
        rod_sigma_m=rod_sigma,
    )
    first = recordings[0]
    folder = out_dir or first.with_name(first.resolve().name + "-identified")
    claim_folder(folder, OUTPUTS, "the result")
    with progress_bar() as progress:
        log = IterationLog(progress)
        data = identify_recordings(recordings, validate or (), settings=settings, progress=log.progress, watch=log.watch if rerun else None)
        data = replace(data, iterations=tuple(log.steps))
        write_outputs(folder, data, command=_command(), replay=rerun, progress=progress)
    if as_json:
        _say_json(run_data(data, folder))
    say_identification(out, data)
    out.print(f"Results in {escape(str(folder))}")
    raise typer.Exit(0 if data.acceptable else 1)


@app.command(name="compare", epilog="Example: `ballbar compare runs/irb2400/calibration.yaml runs/irb2400/recording.truth.yaml`")
def compare_files(
    calibration: Annotated[Path, typer.Argument(help="A calibration.yaml.", metavar="CALIBRATION")],
    reference: Annotated[Path, typer.Argument(help="A truth file, or another calibration.yaml.", metavar="REFERENCE")],
    as_json: AsJson = False,
) -> None:
    """Compare a calibration with the truth of a simulated run, or with another calibration: TCP error over the workspace."""
    model = load_calibration(calibration)
    comparison = _compared(model, calibration, reference)
    if as_json:
        _say_json(comparison_data(comparison))
    _say_comparison(comparison)


@app.command(epilog="Example: `ballbar identifiability scenarios/irb2400.yaml --cost all --encoders 1,2,4,5`")
def identifiability(
    scenario: ScenarioFile,
    cost: Annotated[str | None, typer.Option(help=f"{', '.join(COSTS)} or all; default: the scenario's.", metavar="NAME")] = None,
    encoders: Annotated[
        str | None, typer.Option(help="Ball-bar joints with an encoder, such as 1,2,4,5, or none; default: the scenario's.", metavar="LIST")
    ] = None,
    complete: Annotated[
        bool, typer.Option("--complete", help="Ask for Hayati angles and base tilt too, which the thesis has not.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """What a cost can tell of the parameters on a scenario's path: thesis Tables 3.2 to 3.4, and what to keep (sec. 3.3).

    Judged on the nominal mechanism; nothing is simulated.
    """
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
        typer.echo(json.dumps({"scenario": settings.name, "costs": tables, "passed_over": passed_over}, indent=2))
        return
    for judged, moved in found:
        for k, line in enumerate(study_lines(judged, moved)):
            out.print(f"[bold]{escape(line)}[/]" if k == 0 else escape(line))
        out.print()
    for name, reason in passed_over.items():
        out.print(f"[yellow]passed over:[/] {name}, {escape(reason)}")
    out.print(f"[dim]{escape(LEGEND)}[/]")


@app.command(epilog="Example: `ballbar replay runs/irb2400 --web`, or `ballbar replay runs/irb2400 --against runs/nj220`")
def replay(
    run_dir: Annotated[Path, typer.Argument(help="A folder with run.rrd, or the file itself.", metavar="RUN")],
    web: Annotated[bool, typer.Option("--web", help="Serve it to a browser on this machine (loopback only).")] = False,
    save: Annotated[Path | None, typer.Option("--save", help="Write the replay file instead of opening it.", metavar="FILE")] = None,
    layout: Annotated[Layout, typer.Option(help="What to look at: the run, or how the identification converged.")] = "run",
    against: Annotated[Path | None, typer.Option(help="Another run, to compare this one with.", metavar="RUN")] = None,
) -> None:
    """Open the replay of a run in the rerun viewer; its iterations with --layout identify, two runs with --against."""
    if save is not None and save.exists():
        raise InputError(f"{save}: exists already; nothing was written. Name another file.")
    with chosen_replay(run_dir, layout, against) as file:
        if save is not None:
            write_whole(save, file.read_bytes())
            out.print(f"Saved {escape(str(save))}")
        elif web:
            serve_web(file)
        else:
            open_viewer(file)


@app.command(epilog="Example: `ballbar sweep scenarios/sweeps/noise.yaml --workers 4`, or on a cluster `--scheduler tcp://10.0.0.5:8786`")
def sweep(
    file: Annotated[Path, typer.Argument(help="A sweep, such as scenarios/sweeps/noise.yaml.", metavar="FILE")],
    out_dir: Out = None,
    workers: Annotated[int | None, typer.Option(help="Processes on this machine; default one a core.", min=1)] = None,
    scheduler: Annotated[str | None, typer.Option(help="Run on the workers of this Dask scheduler instead.", metavar="ADDRESS")] = None,
    as_json: AsJson = False,
) -> None:
    """Run a scenario many times with values and seeds that vary; one table with a row for each run.

    Writes NAME.parquet and NAME.csv to DIR (default runs/NAME-sweep). Interrupted, the same command goes on where it stopped.
    Exits with 1 when every run failed, with 130 when it was stopped.
    """
    if workers is not None and scheduler is not None:
        raise InputError("--workers counts processes on this machine; with --scheduler the cluster's own workers compute. Give one.")
    settings = load_sweep(file)
    folder = out_dir or Path("runs") / f"{settings.plan.name}-sweep"
    computing = partial(dask_cluster, address=scheduler) if scheduler else partial(processes, count=workers or os.cpu_count() or 1)
    with run_bar(err, settings.plan) as progress:
        outcome = run_sweep(settings, folder, run_trial, computing, progress=progress)
    if as_json:
        _say_json(sweep_data(outcome))
    succeeded = say_outcome(out, outcome)
    if not outcome.finished:
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(0 if succeeded else 1)


@app.command(epilog="Example: `ballbar claims --quick`, or `ballbar claims noise`")
def claims(
    names: Annotated[list[str] | None, typer.Argument(help="Of scenarios/claims, or files; default all.", metavar="NAME")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer points and seeds: less than a minute.")] = False,
    page: Annotated[Path | None, typer.Option("--out", help="Write them, with figures, as a page.", metavar="FILE.md")] = None,
    as_json: AsJson = False,
) -> None:
    """Check what the thesis says against what comes out here, by the runs behind each claim.

    Exits with 1 when a check fails.
    """
    if page is not None and names:
        raise InputError("--out: the page is of all claims; leave the names out.")
    chosen = topics(names or ())
    with TemporaryDirectory(prefix="ballbar-claims-") as work, process_pool(CLAIM_WORKERS) as computing:
        judged = judge_all(chosen, Path(work), computing, quick=quick, showing=partial(run_bar, err))
    if as_json:
        _say_json(claims_data(judged))
    passed = say_verdicts(out, judged)
    if page is not None:
        write_page(page, judged)
        out.print(f"Page {escape(str(page))}")
    raise typer.Exit(0 if passed else 1)


@app.command(
    epilog="Example: `ballbar record runs/monday --robot irb2400 --ballbar lund_600 --plc 5.12.82.20.1.1 --egm 192.168.125.10:6510`"
)
def record(
    folder: Annotated[Path, typer.Argument(help="A new folder for the recording.", metavar="DIR")],
    robot: Annotated[str, typer.Option(help="A robot of cell/robots, or a file.", metavar="NAME")],
    ballbar: Annotated[str, typer.Option(help="A ball-bar of cell/ballbars, or a file.", metavar="NAME")],
    plate: Annotated[str, typer.Option(help="An offset plate of cell/plates, or a file.", metavar="NAME")] = "plate_250",
    plc: Annotated[str | None, typer.Option(help="AMS address of the PLC that reads the encoders.", metavar="NETID[:PORT][@HOST]")] = None,
    egm: Annotated[
        str | None,
        typer.Option(help="Where to hear the robot's EGM feedback; a port alone is this machine only.", metavar="[ADDRESS:]PORT"),
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Seconds after the first record; default until Ctrl-C.", min=0.1)] = None,
    live: Annotated[bool, typer.Option("--live", help="Show the angles in a rerun window as they come.")] = False,
) -> None:
    """Record live: encoders from a TwinCAT PLC over ADS, robot axes from ABB EGM, into a recording that can be read at any moment.

    The PLC runs the program of docs/recorder.md. Waits for the devices, starts a new file when one was away, ends with Ctrl-C.
    Exits with 1 when the disk is full, or a device delivered nothing.
    """
    from ballbar.record_command import RecordOptions  # noqa: PLC0415  sockets and threads only for who records
    from ballbar.record_command import record as record_live  # noqa: PLC0415

    options = RecordOptions(plc=plc, egm=egm, robot=robot, ballbar=ballbar, plate=plate, duration=duration, live=live)
    raise typer.Exit(0 if record_live(folder, options, out) else 1)


@app.command(epilog="Example: `ballbar export runs/irb2400 --to urdf --out irb2400.urdf`, or `ballbar export runs/irb2400 --to dh`")
def export(
    result: ResultFile,
    to: Annotated[
        Format,
        typer.Option("--to", help="Robot models, tables (mdh: Craig's DH; poe: screw axes), RAPID data, or everything as JSON."),
    ],
    file: Annotated[Path | None, typer.Option("--out", help="A new file; default: print it.", metavar="FILE")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was exported as JSON.")] = False,
) -> None:
    """Write the identified robot for other programs: URDF, MJCF, DH tables, screws, RAPID, JSON.

    Each says in comments what it leaves out (elastic gears, play, ripple), every sigma, and what stayed nominal.
    """
    read = load_result(result)
    text = exported(read, to)
    if file is not None:
        write_export(file, text)
    if as_json:
        typer.echo(json.dumps(export_summary(read, to, text, file), indent=2))
    elif file is None:
        typer.echo(text, nl=False)
    else:
        out.print(f"Wrote {escape(str(file))}. Not in it: {escape('; '.join(read.left_out))}")


@app.command(epilog="Example: `ballbar correct targets.csv --with runs/irb2400 --out corrected.csv`")
def correct(
    path: Annotated[
        Path, typer.Argument(help="CSV with columns q1..q6 [rad, DH joints] or axis1_deg..axis6_deg [controller].", metavar="PATH.csv")
    ],
    result: Annotated[Path, typer.Option("--with", help="A calibration.yaml, or the folder that holds it.", metavar="RESULT")],
    file: Annotated[Path | None, typer.Option("--out", help="A new file; default PATH-corrected.csv.", metavar="FILE")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was done as JSON.")] = False,
) -> None:
    """Turn targets planned with the nominal robot into targets that reach the same poses with the identified robot.

    Geometry, and of the gears what was identified: compliance under the robot's own weight, play, ripple. Other columns are kept.
    """
    read = load_result(result)
    done = correct_file(path, read)
    written = file or path.with_name(f"{path.stem}-corrected.csv")
    write_corrected(written, done, read)
    if as_json:
        typer.echo(json.dumps(correction_data(done, read, written), indent=2))
        return
    for line in correction_lines(done):
        out.print(escape(line))
    out.print(f"Wrote {escape(str(written))}")


@app.command(epilog="Example: `ballbar plan scenarios/plans/irb2400.yaml --out plans/irb2400`")
def plan(
    request: Annotated[Path, typer.Argument(help="What is asked for, such as scenarios/plans/irb2400.yaml.", metavar="REQUEST")],
    out_dir: Out = None,
    seconds: Annotated[float, typer.Option(help="For the search; 0 takes the first path that can be run.", min=0.0)] = 110.0,
    path: Annotated[Path | None, typer.Option("--path", help="Judge, check and export this path file instead.", metavar="FILE")] = None,
    position: Annotated[str | None, typer.Option(help="Where the ball-bar stands [m], with --path.", metavar="X,Y,Z")] = None,
    what_if: Annotated[
        list[str] | None,
        typer.Option(
            "--what-if", help=f"Expected TCP error if one of {', '.join(WHAT_IF)} were another; may be repeated.", metavar="KEY=A,B"
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Plan a path for the cell: what it will tell, before anyone goes there, and programs that run it.

    Writes path.yaml, scenario.yaml, plan.yaml, plan.svg, path.csv and programs for ABB (.mod) and Comau (.pdl) to DIR (default
    runs/NAME-plan). Exits with 1 when the path violates a limit in MuJoCo. Ctrl-C stops the search and keeps the best path so far.
    """
    place = None if position is None else parse_position(position)
    folder = out_dir or default_folder(request)
    if as_json:
        silence()
    kept = plan_path(request, folder=folder, path=path, position=place, seconds=seconds, what_if=what_if or (), out=out, err=err)
    if as_json:
        _say_json(plan_data(folder, kept=kept))
    raise typer.Exit(0 if kept else 1)


def _compared(model: Calibration, calibration: Path, reference: Path) -> Comparison:
    cell = load_cell(model.file.robot, model.file.ballbar, model.file.plate, relative_to=calibration.parent)
    identified = [name for name, entry in model.file.parameters.items() if entry.identified]
    if reference.name.endswith(".truth.yaml"):
        truth = load_truth(reference)
        clock = model.file.clock
        found = (clock.offset_s, clock.skew) if clock else None
        return compare_with_truth(model.free_robot(cell), model.nominal, truth, identified, found)
    other = load_calibration(reference)
    if other.file.robot != model.file.robot:
        raise InputError(
            f"{reference}: is of robot {other.file.robot}, {calibration} of {model.file.robot}; only the same robot can be compared"
        )
    shared = [name for name in identified if other.file.parameters[name].identified]
    return compare(model.free_robot(cell), model.nominal, other.free_robot(cell), shared)


def _settings(**given: object) -> IdentifySettings:
    """Options as settings of a scenario, checked alike."""
    try:
        return IdentifySettings.model_validate(given)
    except ValidationError as error:
        raise InputError("\n".join(text for _, text in explain(error.errors(include_url=False), IdentifySettings, given))) from None


def _say_plant(simulation: Simulation) -> None:
    truth = simulation.truth
    out.print(
        f"plant: loop closed within {truth.closure_position * 1e6:.3f} um and {truth.closure_angle * 1e6:.3f} urad, "
        f"rod force {truth.rod_force_min:.0f} to {truth.rod_force_max:.0f} N"
    )


def _say_comparison(comparison: Comparison) -> None:
    tcp, before = comparison.tcp, comparison.tcp_nominal
    out.print(
        f"TCP error over the workspace: mean {tcp.mean * 1e3:.4f} mm, largest {tcp.maximum * 1e3:.4f} mm "
        f"(nominal robot {before.mean * 1e3:.3f} and {before.maximum * 1e3:.3f} mm)"
    )
    if comparison.deviations:
        name, value = comparison.largest
        out.print(
            f"parameters: Euclidean distance {comparison.distance * 1e3:.4f} mm|mrad over {len(comparison.deviations)}, "
            f"largest {name} {value * 1e3:+.4f}"
        )
    if comparison.offset is not None and comparison.skew is not None:
        out.print(f"clock error: offset {comparison.offset * 1e6:+.2f} us, skew {comparison.skew * 1e6:+.4f} ppm")


def _say_json(data: object) -> None:
    """Prints it; the words that would follow are left out."""
    typer.echo(json.dumps(data, indent=2))
    silence()


def _command() -> str:
    return shlex.join(["ballbar", *sys.argv[1:]])


def main() -> None:
    """Entry point: runs a command and turns what can go wrong into a message and an exit code."""
    fresh_terminal()
    try:
        app()
    except InputError as error:
        err.print(f"[red]error:[/] {escape(str(error))}")
        sys.exit(2)
    except (StartError, PlantError, NoEquilibriumError, UnreachableError, ViewerError, SweepError, RecorderError) as error:
        err.print(f"[red]failed:[/] {escape(str(error))}")
        sys.exit(1)
    except OSError as error:
        err.print(f"[red]error:[/] {escape(str(error.filename or ''))}: {escape(error.strerror or str(error))}")
        sys.exit(2)
