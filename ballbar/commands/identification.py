"""The command `ballbar identify`: from recordings to an identified robot."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from ballbar.cell.errors import InputError
from ballbar.commands.options import AsJson, Out, command, command_line, say_json
from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.options import DEFAULT_SAMPLES, FitOptions, ForceSource, ModelName
from ballbar.terminal import out, progress_bar

if TYPE_CHECKING:
    from ballbar.result.run_data import RunData

commands = typer.Typer()

CorrectionNames = Annotated[
    str,
    typer.Option(
        help=f"Corrections of the complete model: auto, or some of {', '.join(CORRECTIONS)}.",
        metavar="auto|NAME,NAME",
    ),
]


@command(commands)
def identify(
    recordings: list[Path],
    *,
    validate: list[Path] | None = None,
    out_dir: Out = None,
    samples: Annotated[int, typer.Option(min=50, max=100_000)] = DEFAULT_SAMPLES,
    model: ModelName = "auto",
    corrections: CorrectionNames = "auto",
    force: ForceSource = "auto",
    rod_sigma: float | None = None,
    accuracy: float | None = None,
    joint_errors: str = "auto",
    rerun: bool = False,
    as_json: AsJson = False,
) -> None:
    """Identify a robot from one or several recordings; test the result on held-out ones.

    Recordings are logs of a moving robot (recording.yaml) or tables of still poses (poses.yaml);
    both together, of one robot, make one fit. Prints the result, then writes calibration.yaml,
    import_report.json and report.html to DIR (default: the first RECORDING's folder with
    -identified appended). Exits with 1 when the fit or a held-out recording is not acceptable.

    Example: `ballbar identify runs/a/recording runs/b/recording --validate runs/c/recording --out
    runs/together`

    RECORDING : Folders with recording.yaml and the device files, or with poses.yaml, all of one
        robot.
    --validate RECORDING : Held-out recording, on which the result is tested; repeatable.
    --samples : Instants of the logs that enter the fit.
    --model : Kinematics alone (dh) or with corrections (complete); auto decides by the data.
    --force : Source of the rod's force; auto takes the best that was logged.
    --rod-sigma METRES : Standard deviation of a measured rod, whose length is bd3 in the ball-bar's
        file.
    --accuracy MM : Stated TCP uncertainty [mm] (1 sigma, rms, with the scale) up to which logs give
        an acceptable result; default: half of the nominal robot's error.
    --joint-errors auto|none|RESULT : Joint errors of still poses: search them (auto), do without
        (none), or keep those of another result.
    --rerun : Write the replay file run.rrd as well.
    """
    given = _begin_reading([*recordings, *(validate or [])])
    from ballbar.cell.files import claimed_folder
    from ballbar.cell.processes import begin_in_copy, second_process
    from ballbar.result.names import OUTPUTS, REPLAY_MODULES

    options = _options(
        corrections,
        joint_errors,
        samples=samples,
        model=model,
        force=force,
        rod_sigma_m=rod_sigma,
        accuracy_mm=accuracy,
    )
    folder = out_dir or _beside(recordings[0])
    with (
        claimed_folder(folder, OUTPUTS, "the result"),
        progress_bar() as progress,
        second_process(*REPLAY_MODULES) if rerun else nullcontext(partial) as begin,
    ):
        from ballbar.ident.options import Listener
        from ballbar.report.terminal import budget_sentence, say_identification
        from ballbar.result.identify import identified

        listener = Listener(progress, begin_in_copy)
        things, count = given(), len(recordings)
        run = identified(things[:count], things[count:], options=options, listener=listener)
        if not as_json:
            with progress.removed():
                say_identification(out, run)
        from ballbar.outputs import write_outputs

        write_outputs(
            folder, run, command=command_line(), replay=rerun, progress=progress, begin=begin
        )
    if as_json:
        _say_json(run, folder)
    elif sentence := budget_sentence(run.identification.budget):
        out.print(escape(sentence))
    out.print(f"Results in {escape(str(folder))}")
    raise typer.Exit(0 if run.acceptable else 1)


def _begin_reading(paths: list[Path]) -> Callable[[], Any]:
    """Reads what can be read while this process loads what fits."""
    from ballbar.acquisition.recording import readable
    from ballbar.cell.processes import begin_in_copy

    return begin_in_copy(readable, paths)


def _say_json(run: RunData, folder: Path) -> None:
    from ballbar.commands.result_json import run_data

    say_json(run_data(run, folder))


def _beside(recording: Path) -> Path:
    """The folder of a result where none is named."""
    from ballbar.cell.files import beside

    folder = recording.parent if recording.is_file() else recording
    return beside(folder, "-identified")


def _options(corrections: str, joint_errors: str, **options: object) -> FitOptions:
    """The options of the fit, checked by the schema of scenarios."""
    from pydantic import ValidationError

    from ballbar.cell.schema_errors import explain
    from ballbar.identify_settings import IdentifySettings

    names = [name.strip() for name in corrections.split(",")]
    options["corrections"] = "auto" if corrections == "auto" else names
    try:
        chosen = IdentifySettings.model_validate(options).options
    except ValidationError as error:
        errors = explain(error.errors(include_url=False), IdentifySettings, options)
        raise InputError("\n".join(text for _, text in errors)) from None
    if joint_errors == "auto":
        return chosen
    if joint_errors == "none":
        return replace(chosen, joint_errors="none")
    from ballbar.result.calibration import load

    return replace(chosen, joint_errors=load(joint_errors).joint_errors())
