"""Commands that judge stored results: `ballbar compare`, `verify`, `performance`, `history`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from ballbar.commands.options import AsJson, ResultFile, command, command_line, say_json
from ballbar.terminal import out

commands = typer.Typer()


@command(commands)
def compare(calibration: Path, reference: Path, as_json: AsJson = False) -> None:
    """Compare a calibration with the truth of a simulated run, or with another calibration.

    Prints the TCP error over the workspace and the deviations of the parameters. Two results of
    still poses are compared over the poses that both were fitted to.

    Example: `ballbar compare runs/irb2400/calibration.yaml runs/irb2400/recording.truth.yaml`

    CALIBRATION : A calibration.yaml, or the folder that holds it.
    REFERENCE : The truth file of a simulated run, or another calibration.
    """
    from ballbar.commands.result_json import comparison_data
    from ballbar.report.terminal import say_comparison
    from ballbar.result.calibration import load
    from ballbar.result.compare import compare as compare_results

    result = load(calibration)
    if reference.name.endswith(".truth.yaml"):
        from ballbar.truth.compare import result_against_truth

        comparison = result_against_truth(result, reference)
    else:
        comparison = compare_results(result, load(reference))
    if as_json:
        say_json(comparison_data(comparison))
    say_comparison(out, comparison)


@command(commands)
def history(
    results: list[Path],
    tolerance_mm: Annotated[float | None, typer.Option(min=0.001, max=100.0)] = None,
    save: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Show what results of one robot over months say together: wear, collisions, changed gears.

    Zeros, angles between axes, backlash, compliance and ripple of each axis are compared with the
    uncertainty of a repetition, and steps and drifts beyond chance named with axis and dates.
    Results whose verdict is not acceptable are listed, and not used.

    Example: `ballbar history results/2026-* --tolerance-mm 0.1 --out history.html`

    RESULTS : Folders that `ballbar identify` wrote, or calibration.yaml files, of two days or
        more, in any order.
    --tolerance-mm MM : Mean TCP error up to which the robot may run: says when the next calibration
        is due.
    --out FILE : New page (.html), or its figure alone (.png, .svg).
    """
    from ballbar.history.history import due, read_history
    from ballbar.history.show import history_data, say_history, write_history

    read = read_history(results)
    expected = None if tolerance_mm is None else due(read, tolerance_mm * 1e-3)
    if save is not None:
        write_history(save, read, expected)
    if as_json:
        say_json(history_data(read, expected))
    say_history(out, read, expected)


@command(commands)
def verify(result: ResultFile, folder: Path, as_json: AsJson = False) -> None:
    """Does a stored calibration still hold? One short recording, or about ten new poses, tell.

    An unchanged robot fails in about 2 of 100 checks. Where something changed, a single cause is
    named if it explains the change. Of a recording: the zero of an axis, the tool, the length of
    rod or plate (of a sensed length its zero and scale), a gear; only clock, base pose and encoder
    offsets are fitted. Of still poses: the zero of a joint, a target that moved, the scale of the
    measured values, one bad pose; only the seats (and new targets) are fitted. A result of
    recordings, still poses among them or not, takes either; a result of still poses alone takes
    still poses. Exits with 1 when the calibration does not hold, and with 2 when these measurements
    cannot tell.

    Example: `ballbar verify results/ur10 recordings/ten_poses`, or `ballbar verify runs/irb2400
    recordings/monday`

    DIR : Folder with recording.yaml, one path of about a minute, or with poses.yaml, about ten
        still poses.
    """
    from ballbar.result.verification import exit_code, say_verification, verification_data
    from ballbar.result.verification import verify as verify_measured

    outcome = verify_measured(result, folder)
    if as_json:
        say_json(verification_data(outcome))
    say_verification(out, outcome)
    raise typer.Exit(exit_code(outcome))


@command(commands)
def performance(
    result: ResultFile,
    measured: Path | None = None,
    *,
    cube: float | None = None,
    radius: float | None = None,
    file: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """State the performance of a robot by the characteristics of ISO 9283 and ISO 230-4.

    Repeated poses, a path that repeats and a full circle are measured values; what was not measured
    is predicted from the result at the five poses of the test cube and over the workspace. Each
    value is marked, nominal, identified and corrected robot side by side.

    Example: `ballbar performance results/ur10 recordings/cube --out performance.html`

    DIR : Folder with poses.yaml or recording.yaml. Default: nothing measured.
    --cube MM : Edge of the test cube [mm]. Default: the largest of 1000, 630, 400 and 250 mm that
        fits.
    --radius MM : Nominal length of a telescoping ball-bar [mm].
    --out FILE : Page with all values and the polar plot; must be new.
    """
    from ballbar.cell.errors import InputError
    from ballbar.report.performance import say_performance, write_performance
    from ballbar.result.calibration import load
    from ballbar.result.performance import performance as performance_of
    from ballbar.result.performance import performance_data

    for option, value in (("--cube", cube), ("--radius", radius)):
        if value is not None and not value > 0.0:
            raise InputError(f"{option} {value:g}: expected a length above 0 mm.")
    if file is not None and file.exists():
        raise InputError(f"{file}: exists already; nothing was written. Name another file.")
    calibration = load(result)
    stated = performance_of(
        calibration,
        measured,
        side=None if cube is None else cube * 1e-3,
        radius=None if radius is None else radius * 1e-3,
    )
    if file is not None:
        title = calibration.robot.title
        write_performance(file, stated, title=title, command=command_line())
    if as_json:
        say_json(performance_data(stated))
    say_performance(out, stated)
    if file is not None:
        out.print(f"Wrote {escape(str(file))}")
