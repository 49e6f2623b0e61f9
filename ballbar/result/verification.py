"""`ballbar verify`: a stored result against a few still poses or one recording of today."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from ballbar.recordings.read_with_causes import read_with_causes
from ballbar.result.calibration import CalibrationFile, calibration_file, load_calibration
from ballbar.result.pose_calibration import load_pose_calibration
from ballbar.result.run_recordings import description_identity, distinct_names, logs_of
from cell.errors import InputError
from cell.poses import PoseTable
from cell.recording import RecordingFile
from ident.options import SILENT, Listener
from ident.poses.verification import Verification, verify
from ident.verification import RecordingVerification, verify_recording

# [K] from which a difference of temperature is named: a length of 1 m of steel grows by 24 um.
WARMER = 2.0


def verify_poses(result: Path, table: PoseTable) -> Verification:
    """Whether the calibration.yaml of still poses holds for a table.

    Raises InputError for a result of logs, a table of another robot, or one with too few poses.
    """
    file = _existing(result)
    calibration = load_pose_calibration(file)
    if table.robot.title != calibration.robot.title:
        raise InputError(
            f"{table.name}: is of robot {table.robot.title}, {file} of {calibration.robot.title}."
        )
    mean = calibration.file.cross_validation.mean_m
    return verify(calibration.arm(), calibration.targets, mean, table)


def verify_folder(
    result: Path, folder: Path, *, listener: Listener = SILENT
) -> tuple[RecordingVerification, tuple[str, ...]]:
    """Whether the calibration.yaml of recordings holds for the recording in a folder.

    Returns also what is to be said of the temperatures. Raises InputError for a result of still
    poses or one without covariance, for a recording of a sensed length, and for one that cannot be
    read or is of another robot, ball-bar or plate; StartError when its logs do not fit together.
    """
    file = _existing(result)
    calibration = load_calibration(file)
    content = calibration.file
    recording = read_with_causes(folder)
    _check_same_cell(content, file, recording.description, folder)
    if recording.length_log is not None:
        raise InputError(
            f"{folder}: a length hardly tells its own clock, so one short recording of it cannot "
            f"be held against a result. Take `ballbar identify --validate {folder} ...`, or ten "
            "still poses."
        )
    logs = logs_of(distinct_names([folder])[0], recording)
    outcome = verify_recording(calibration.machine(calibration.cell()), logs, listener=listener)
    return outcome, temperature_remarks(content, recording.description.temperature_C)


def temperature_remarks(content: CalibrationFile, now: float | None) -> tuple[str, ...]:
    """A sentence where a recording was taken at another temperature [deg C] than the result."""
    before = [r.temperature_C for r in content.recordings if r.temperature_C is not None]
    if now is None or not before:
        return ()
    mean = sum(before) / len(before)
    if abs(now - mean) < WARMER:
        return ()
    return (
        f"identified at {mean:.1f} deg C, this recording is of {now:.1f} deg C: arm, rod and plate "
        f"of steel are longer by {12 * (now - mean):+.0f} um/m, of aluminium by "
        f"{23 * (now - mean):+.0f} um/m",
    )


def _existing(result: Path) -> Path:
    file = calibration_file(result)
    if not file.is_file():
        raise InputError(f"{file}: no such file. Name a calibration.yaml, or its folder.")
    return file


def _check_same_cell(
    content: CalibrationFile, file: Path, recorded: RecordingFile, folder: Path
) -> None:
    pairs = (
        ("robot", content.robot, recorded.robot),
        ("instrument", content.instrument, recorded.measured_by),
        ("plate", content.plate, recorded.plate),
    )
    for what, name, here in pairs:
        if description_identity(here, folder) != description_identity(name, file.parent):
            raise InputError(
                f"{folder}: is of {what} {here}, {file} of {name}. A result is tried on recordings "
                "of the same robot, ball-bar and plate."
            )


def say_verification(
    out: Console, verification: Verification | RecordingVerification, remarks: Sequence[str] = ()
) -> None:
    """Print the sentence, green or red, then what does not count, and further remarks."""
    colour = "green" if verification.holds else "red"
    out.print(f"[bold {colour}]{escape(verification.sentence)}[/]")
    for warning in (*verification.warnings, *remarks):
        out.print(f"[yellow]warning:[/] {escape(warning)}")


def verification_data(verification: Verification) -> dict[str, object]:
    """JSON of `verify`, SI units."""
    return {
        "holds": verification.holds,
        "sentence": verification.sentence,
        "warnings": verification.warnings,
        "poses": int(verification.error.size),
        "poses_outside_fitted_ranges": verification.outside,
        "mean_error_m": float(verification.error.mean()),
        "expected_mean_error_m": float(verification.predicted),
        "largest_mean_error_m": float(verification.largest_mean),
        "sum_of_squares": float(verification.square),
        "degrees_of_freedom": verification.freedom,
        "limit": float(verification.limit),
        "causes": [
            {
                "kind": cause.kind,
                "name": cause.name,
                "size": cause.size.tolist(),
                "sigma": cause.sigma.tolist(),
                "sum_of_squares_left": float(cause.square),
                "named": cause is verification.cause,
            }
            for cause in verification.causes[:5]
        ],
    }


def recording_verification_data(
    outcome: RecordingVerification, remarks: Sequence[str]
) -> dict[str, object]:
    """JSON of `verify` with a recording, SI units."""
    return {
        "holds": outcome.holds,
        "sentence": outcome.sentence,
        "warnings": [*outcome.warnings, *remarks],
        "position_rms_m": outcome.identified.position_rms,
        "angle_rms_rad": outcome.identified.angle_rms,
        "normalised_innovation": outcome.innovation,
        "chi2_per_dof_with_free_machine": outcome.misfit,
        "log_bayes_factor": outcome.statistic,
        "limit": outcome.limit,
        "causes": [
            {
                "kind": e.cause.kind,
                "axis": e.cause.axis or None,
                "size": e.size.tolist(),
                "sigma": e.sigma.tolist(),
                "log_bayes_factor": e.evidence,
                "named": e in outcome.named,
            }
            for e in outcome.explanations[:5]
        ],
    }
