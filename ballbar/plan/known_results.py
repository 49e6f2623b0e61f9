"""`ballbar plan --after`: results of the machine of a request, and whether they can be planned on.

What `identify` would not combine with the new recording is refused: another robot, ball-bar or
plate. So is a recording that stands in two results, whose information would count twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.ident.verdict import Status
from ballbar.planning.known import Known, known_of
from ballbar.planning.request import PlanRequest
from ballbar.result.calibration import Calibration, load
from ballbar.result.calibration_schema import CalibrationFile
from ballbar.result.identify import description_identity
from ballbar.result.recording_entries import RecordingEntry

# Relative difference of the noise of a log, which every fit of a recording states, by rounding.
SAME_NOISE = 1e-9


def known_from(results: Sequence[Path], request: PlanRequest, err: Console) -> Known:
    """The information of results about the machine of a request; warns of a fit that is not good.

    Raises InputError for a result of still poses, of model dh with a ball-bar, without covariance,
    or of another robot, ball-bar or plate than the request's, and for results that share a
    recording.
    """
    calibrations = [load(result) for result in results]
    machines = []
    for calibration in calibrations:
        file, cell, content = calibration.path, calibration.cell(), calibration.file
        if content.model == "dh" and cell.ballbar.stroke is None:
            raise InputError(
                f"{file}: is of model dh, and a path is predicted with the complete model, of "
                "which it states no uncertainty. Identify the recordings with --model complete."
            )
        _check_same_cell(file, content, request)
        machines.append(calibration.machine(cell))
    _check_shared_recordings(calibrations)
    for calibration in calibrations:
        _warn_of_poor(calibration, err)
    return known_of(machines)


def _warn_of_poor(calibration: Calibration, err: Console) -> None:
    if (status := calibration.file.fit.status) != Status.GOOD:
        file = escape(str(calibration.path))
        err.print(
            f"[yellow]warning:[/] {file}: its fit is called {escape(status)!r}; what is predicted "
            "after it is no surer than its report"
        )


def _check_same_cell(file: Path, content: CalibrationFile, request: PlanRequest) -> None:
    """Own descriptions are compared by their content, as `identify` does."""
    pairs = [
        ("robot", content.robot, request.cell.robot),
        *(("ball-bar", content.instrument, rod) for rod in request.cell.rods),
        ("plate", content.plate, request.cell.plate),
    ]
    for what, name, here in pairs:
        if description_identity(name, file.parent) != description_identity(here, Path()):
            raise InputError(
                f"{file}: is of {what} {name}, the request of {here}"
                f"{', whose content differs' * (Path(name).name == Path(here).name)}. "
                "Recordings that belong together must be of the same robot, ball-bar and plate."
            )


def _check_shared_recordings(calibrations: Sequence[Calibration]) -> None:
    """Two results are of one recording by its noise: folders may have any name."""
    entries = [
        (calibration.path, recording.name, _noise(recording))
        for calibration in calibrations
        for recording in calibration.file.logs
    ]
    for k, (file, name, noise) in enumerate(entries):
        for before, _, other in entries[:k]:
            if noise.shape != other.shape or not noise.any():
                continue
            if np.allclose(noise, other, rtol=SAME_NOISE, atol=0.0):
                raise InputError(
                    f"{file}: holds recording {name}, which {before} holds too, so it would count "
                    "twice. Leave one of them out: a joint result holds all that its recordings "
                    "say."
                )


def _noise(entry: RecordingEntry) -> Array:
    noise = entry.noise
    return np.array([*noise.joint_rad, *noise.encoder_rad.values(), noise.length_m or 0.0])
