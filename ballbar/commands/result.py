"""Commands for a result: `ballbar replay`, `compare`, `export` and `correct`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from ballbar.commands.options import RESULT, AsJson, ResultFile, say_json
from ballbar.export.formats import Format
from ballbar.replay.show import Layout, chosen_replay
from ballbar.result.calibration import Calibration
from ballbar.result.compare import Comparison
from ballbar.terminal import out, progress_bar
from cell.errors import InputError
from cell.files import write_new, write_whole

commands = typer.Typer()


@commands.command(
    rich_help_panel=RESULT,
    epilog="Example: `ballbar replay runs/irb2400 --web`, or `ballbar replay runs/irb2400 "
    "--against runs/nj220`",
)
def replay(
    run_dir: Annotated[
        Path, typer.Argument(help="Folder with run.rrd, or the file itself.", metavar="RUN")
    ],
    web: Annotated[
        bool,
        typer.Option(
            "--web", help="Serve the replay to a browser on this machine (loopback only)."
        ),
    ] = False,
    save: Annotated[
        Path | None,
        typer.Option("--save", help="Write the replay file instead of opening it.", metavar="FILE"),
    ] = None,
    layout: Annotated[
        Layout, typer.Option(help="Show the run, or how the identification converged.")
    ] = "run",
    against: Annotated[
        Path | None, typer.Option(help="Another run, shown beside this one.", metavar="RUN")
    ] = None,
) -> None:
    """Open the replay of a run, or of two runs, in the rerun viewer."""
    from ballbar.replay.write import open_viewer, serve_web

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


@commands.command(
    rich_help_panel=RESULT,
    name="compare",
    epilog="Example: `ballbar compare runs/irb2400/calibration.yaml "
    "runs/irb2400/recording.truth.yaml`",
)
def compare_files(
    calibration: Annotated[
        Path,
        typer.Argument(
            help="A calibration.yaml, or the folder that holds it.", metavar="CALIBRATION"
        ),
    ],
    reference: Annotated[
        Path,
        typer.Argument(
            help="The truth file of a simulated run, or another calibration.", metavar="REFERENCE"
        ),
    ],
    as_json: AsJson = False,
) -> None:
    """Compare a calibration with the truth of a simulated run, or with another calibration.

    Prints the TCP error over the workspace and the deviations of the parameters.
    """
    from ballbar.commands.result_json import comparison_data
    from ballbar.report.terminal import say_comparison
    from ballbar.result.calibration import calibration_file, load_calibration

    calibration, reference = calibration_file(calibration), calibration_file(reference)
    comparison = _compared(load_calibration(calibration), calibration, reference)
    if as_json:
        say_json(comparison_data(comparison))
    say_comparison(out, comparison)


def _compared(model: Calibration, calibration: Path, reference: Path) -> Comparison:
    from ballbar.result.calibration import load_calibration
    from ballbar.result.compare import compare, compare_with_truth
    from cell.load import load_measured_cell
    from sim.truth import load_truth

    file = model.file
    cell = load_measured_cell(
        file.robot, file.instrument, file.plate, relative_to=calibration.parent
    )
    identified = list(file.identified)
    if reference.name.endswith(".truth.yaml"):
        truth = load_truth(reference)
        clock = file.recordings[0].clock
        at = (clock.offset_s, clock.skew) if clock else None
        return compare_with_truth(model.unloaded_robot(cell), model.nominal, truth, identified, at)
    other = load_calibration(reference)
    if other.file.robot != file.robot:
        raise InputError(
            f"{reference}: is of robot {other.file.robot}, {calibration} of {file.robot}. "
            "Compare calibrations of the same robot."
        )
    shared = [name for name in identified if name in other.file.identified]
    return compare(model.unloaded_robot(cell), model.nominal, other.unloaded_robot(cell), shared)


@commands.command(
    rich_help_panel=RESULT,
    epilog="Example: `ballbar export runs/irb2400 --to urdf --out irb2400.urdf`, or "
    "`ballbar export runs/irb2400 --to dh`",
)
def export(
    result: ResultFile,
    to: Annotated[
        Format,
        typer.Option(
            "--to",
            help="Robot model (urdf, mjcf), table (dh; mdh: Craig's DH; hayati; poe: screw axes), "
            "RAPID data (abb), or everything (json).",
        ),
    ],
    file: Annotated[
        Path | None,
        typer.Option("--out", help="New file. Default: print to the terminal.", metavar="FILE"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write the identified robot for other programs: URDF, MJCF, DH tables, screws, RAPID, JSON.

    Comments in each format state what it leaves out (gear compliance, backlash, ripple), the
    standard deviation of every parameter, and which parameters are nominal.
    """
    from ballbar.export.formats import export_summary, exported
    from ballbar.export.result import load_result

    robot = load_result(result)
    text = exported(robot, to)
    if file is not None:
        write_new(file, text.encode())
    if as_json:
        say_json(export_summary(robot, to, text, file))
    elif file is None:
        typer.echo(text, nl=False)
    else:
        out.print(f"Wrote {escape(str(file))}. Not in it: {escape('; '.join(robot.left_out))}")


@commands.command(
    rich_help_panel=RESULT,
    epilog="Example: `ballbar correct targets.csv --with runs/irb2400 --out corrected.csv`",
)
def correct(
    path: Annotated[
        Path,
        typer.Argument(
            help="CSV file with columns q1, q2, ... [rad, DH joints] or axis1_deg, axis2_deg, ... "
            "[controller].",
            metavar="PATH.csv",
        ),
    ],
    result: Annotated[
        Path,
        typer.Option(
            "--with", help="A calibration.yaml, or the folder that holds it.", metavar="RESULT"
        ),
    ],
    file: Annotated[
        Path | None,
        typer.Option("--out", help="New file. Default: PATH-corrected.csv.", metavar="FILE"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Correct targets planned with the nominal robot so that the identified robot reaches them.

    The correction accounts for geometry, and for what was identified of the gears: compliance under
    the robot's own weight, backlash, ripple. Other columns of the file are copied.
    """
    from ballbar.compensation.targets_file import (
        correct_file,
        correction_data,
        correction_lines,
        write_corrected,
    )
    from ballbar.export.result import load_result

    robot = load_result(result)
    with progress_bar() as progress:
        progress("correcting the targets")
        correction = correct_file(path, robot)
    written = file or path.with_name(f"{path.stem}-corrected.csv")
    write_corrected(written, correction, robot)
    if as_json:
        say_json(correction_data(correction, robot, written))
    for line in correction_lines(correction):
        out.print(escape(line))
    out.print(f"Wrote {escape(str(written))}")
