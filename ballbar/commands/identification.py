"""The command `ballbar identify`: from recordings to an identified robot."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from ballbar.commands.options import AsJson, Out, command_line, say_json
from ballbar.terminal import out, progress_bar
from cell.errors import InputError
from ident.corrections import CORRECTIONS
from ident.options import DEFAULT_SAMPLES, ForceSource, ModelName

if TYPE_CHECKING:
    from ballbar.identify_settings import IdentifySettings

commands = typer.Typer()


Recordings = Annotated[
    list[Path],
    typer.Argument(
        help="Folders with recording.yaml and the device files, or with poses.yaml, all of one "
        "robot.",
        metavar="RECORDING",
    ),
]
Validate = Annotated[
    list[Path] | None,
    typer.Option(
        "--validate",
        help="Held-out recording: the result is tested on it, not fitted; may be repeated.",
        metavar="RECORDING",
    ),
]
Model = Annotated[
    ModelName,
    typer.Option(
        help="Kinematics alone (dh) or with corrections (complete); auto decides by the data."
    ),
]
CorrectionNames = Annotated[
    str,
    typer.Option(
        help=f"Corrections of the complete model: auto, or some of {', '.join(CORRECTIONS)}.",
        metavar="auto|NAME,NAME",
    ),
]
RodSigma = Annotated[
    float | None,
    typer.Option(
        help="Standard deviation [m] of a rod that was measured; its length is bd3 in the "
        "ball-bar's file.",
        metavar="METRES",
    ),
]
Accuracy = Annotated[
    float | None,
    typer.Option(
        help="Stated TCP uncertainty [mm] (1 sigma, rms, with the scale) up to which logs give "
        "an acceptable result; default: half of the nominal robot's error.",
        metavar="MM",
    ),
]
JointErrorSource = Annotated[
    str,
    typer.Option(
        help="Joint errors of still poses: search them (auto), do without (none), or keep "
        "those of another result.",
        metavar="auto|none|RESULT",
    ),
]


@commands.command(
    epilog="Example: `ballbar identify runs/a/recording runs/b/recording "
    "--validate runs/c/recording --out runs/together`"
)
def identify(
    recordings: Recordings,
    validate: Validate = None,
    out_dir: Out = None,
    samples: Annotated[
        int, typer.Option(help="Instants of the logs that enter the fit.", min=50, max=100_000)
    ] = DEFAULT_SAMPLES,
    model: Model = "auto",
    corrections: CorrectionNames = "auto",
    force: Annotated[
        ForceSource,
        typer.Option(help="Source of the rod's force; auto takes the best that was logged."),
    ] = "auto",
    rod_sigma: RodSigma = None,
    accuracy: Accuracy = None,
    joint_errors: JointErrorSource = "auto",
    rerun: Annotated[
        bool, typer.Option("--rerun", help="Write the replay file run.rrd as well.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Identify a robot from one or several recordings; test the result on held-out ones.

    Recordings are logs of a moving robot (recording.yaml) or tables of still poses (poses.yaml);
    both together, of one robot, make one fit. Writes calibration.yaml, import_report.json and
    report.html to DIR (default: the first RECORDING's folder with -identified appended). Exits with
    1 when the fit or a held-out recording is not acceptable.
    """
    from ballbar.report.process import reporting_process
    from ballbar.result.names import OUTPUTS, POSE_OUTPUTS
    from cell.files import claimed_folder
    from cell.pose_file import pose_file_path

    names = [name.strip() for name in corrections.split(",")]
    settings = _settings(
        samples=samples,
        model=model,
        corrections="auto" if corrections == "auto" else names,
        force=force,
        rod_sigma_m=rod_sigma,
        accuracy_mm=accuracy,
    )
    moving = not all(pose_file_path(recording).is_file() for recording in recordings)
    first = recordings[0].parent if recordings[0].is_file() else recordings[0]
    folder = out_dir or first.with_name(first.resolve().name + "-identified")
    with (
        claimed_folder(folder, OUTPUTS if moving else POSE_OUTPUTS, "the result"),
        progress_bar() as progress,
        reporting_process(replay=rerun) if moving else nullcontext(partial) as begin,
    ):
        from ballbar.commands.result_json import run_data
        from ballbar.outputs import write_outputs
        from ballbar.report.terminal import say_identification
        from ballbar.result.iterations import IterationLog
        from ballbar.result.run_recordings import identify_files
        from ident.options import Listener

        log = IterationLog(progress)
        run = identify_files(
            recordings,
            validate or [],
            settings=settings,
            joint_errors=joint_errors,
            listener=log.listener if rerun else Listener(log.listener.progress),
        )
        run = replace(run, iterations=tuple(log.steps))
        write_outputs(
            folder, run, command=command_line(), replay=rerun, progress=progress, begin=begin
        )
    if as_json:
        say_json(run_data(run, folder))
    say_identification(out, run)
    out.print(f"Results in {escape(str(folder))}")
    raise typer.Exit(0 if run.acceptable else 1)


def _settings(**options: object) -> IdentifySettings:
    """The options as settings, checked by the schema of scenarios."""
    from pydantic import ValidationError

    from ballbar.identify_settings import IdentifySettings
    from cell.schema_errors import explain

    try:
        return IdentifySettings.model_validate(options)
    except ValidationError as error:
        errors = explain(error.errors(include_url=False), IdentifySettings, options)
        raise InputError("\n".join(text for _, text in errors)) from None
