"""What is done with a result: look at it, compare it, hand it on, use it."""

from __future__ import annotations

import json
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
from cell.files import write_whole

commands = typer.Typer()


@commands.command(
    rich_help_panel=RESULT,
    epilog="Example: `ballbar replay runs/irb2400 --web`, or `ballbar replay runs/irb2400 --against runs/nj220`",
)
def replay(
    run_dir: Annotated[
        Path, typer.Argument(help="A folder with run.rrd, or the file itself.", metavar="RUN")
    ],
    web: Annotated[
        bool, typer.Option("--web", help="Serve it to a browser on this machine (loopback only).")
    ] = False,
    save: Annotated[
        Path | None,
        typer.Option("--save", help="Write the replay file instead of opening it.", metavar="FILE"),
    ] = None,
    layout: Annotated[
        Layout, typer.Option(help="What to look at: the run, or how the identification converged.")
    ] = "run",
    against: Annotated[
        Path | None, typer.Option(help="Another run, to compare this one with.", metavar="RUN")
    ] = None,
) -> None:
    """Open the replay of a run in the rerun viewer; its iterations with --layout identify, two runs with --against."""
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
    epilog="Example: `ballbar compare runs/irb2400/calibration.yaml runs/irb2400/recording.truth.yaml`",
)
def compare_files(
    calibration: Annotated[
        Path,
        typer.Argument(
            help="A calibration.yaml, or the folder that holds it.", metavar="CALIBRATION"
        ),
    ],
    reference: Annotated[
        Path, typer.Argument(help="A truth file, or another calibration.", metavar="REFERENCE")
    ],
    as_json: AsJson = False,
) -> None:
    """Compare a calibration with the truth of a simulated run, or with another calibration: TCP error over the workspace."""
    from ballbar.commands.result_json import comparison_data
    from ballbar.report.terminal import say_comparison
    from ballbar.result.calibration import calibration_file, load_calibration

    calibration, reference = calibration_file(calibration), calibration_file(reference)
    model = load_calibration(calibration)
    comparison = _compared(model, calibration, reference)
    if as_json:
        say_json(comparison_data(comparison))
    say_comparison(out, comparison)


def _compared(model: Calibration, calibration: Path, reference: Path) -> Comparison:
    from ballbar.result.calibration import load_calibration
    from ballbar.result.compare import compare, compare_with_truth
    from cell.load import load_cell
    from sim.truth import load_truth

    file = model.file
    cell = load_cell(file.robot, file.instrument, file.plate, relative_to=calibration.parent)
    identified = list(file.identified)
    if reference.name.endswith(".truth.yaml"):
        truth = load_truth(reference)
        clock = file.recordings[0].clock
        at = (clock.offset_s, clock.skew) if clock else None
        return compare_with_truth(model.unloaded_robot(cell), model.nominal, truth, identified, at)
    other = load_calibration(reference)
    if other.file.robot != file.robot:
        raise InputError(
            f"{reference}: is of robot {other.file.robot}, {calibration} of {file.robot}; only the same robot can be compared"
        )
    shared = [name for name in identified if name in other.file.identified]
    return compare(model.unloaded_robot(cell), model.nominal, other.unloaded_robot(cell), shared)


@commands.command(
    rich_help_panel=RESULT,
    epilog="Example: `ballbar export runs/irb2400 --to urdf --out irb2400.urdf`, or `ballbar export runs/irb2400 --to dh`",
)
def export(
    result: ResultFile,
    to: Annotated[
        Format,
        typer.Option(
            "--to",
            help="Robot models, tables (mdh: Craig's DH; poe: screw axes), RAPID data, or everything as JSON.",
        ),
    ],
    file: Annotated[
        Path | None, typer.Option("--out", help="A new file; default: print it.", metavar="FILE")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print what was exported as JSON.")
    ] = False,
) -> None:
    """Write the identified robot for other programs: URDF, MJCF, DH tables, screws, RAPID, JSON.

    Each says in comments what it leaves out (elastic gears, play, ripple), every sigma, and what stayed nominal.
    """
    from ballbar.export.formats import export_summary, exported, write_export
    from ballbar.export.result import load_result

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


@commands.command(
    rich_help_panel=RESULT,
    epilog="Example: `ballbar correct targets.csv --with runs/irb2400 --out corrected.csv`",
)
def correct(
    path: Annotated[
        Path,
        typer.Argument(
            help="CSV with columns q1..q6 [rad, DH joints] or axis1_deg..axis6_deg [controller].",
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
        typer.Option("--out", help="A new file; default PATH-corrected.csv.", metavar="FILE"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was done as JSON.")] = False,
) -> None:
    """Turn targets planned with the nominal robot into targets that reach the same poses with the identified robot.

    Geometry, and of the gears what was identified: compliance under the robot's own weight, play, ripple. Other columns are kept.
    """
    from ballbar.compensation.targets_file import (
        correct_file,
        correction_data,
        correction_lines,
        write_corrected,
    )
    from ballbar.export.result import load_result

    read = load_result(result)
    with progress_bar() as progress:
        progress("correcting the targets")
        done = correct_file(path, read)
    written = file or path.with_name(f"{path.stem}-corrected.csv")
    write_corrected(written, done, read)
    if as_json:
        typer.echo(json.dumps(correction_data(done, read, written), indent=2))
        return
    for line in correction_lines(done):
        out.print(escape(line))
    out.print(f"Wrote {escape(str(written))}")
