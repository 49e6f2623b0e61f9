"""`ballbar verify`: a stored result against a few still poses or one recording of today."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from acquisition.pose_tables import import_poses
from acquisition.report import ImportReport, finding_line
from ballbar.recordings.read_with_causes import read_with_causes
from ballbar.result.calibration import Calibration
from ballbar.result.calibration_file import CalibrationFile
from ballbar.result.inputs import distinct_names
from ballbar.result.run_recordings import description_identity, logs_of
from cell.errors import InputError
from cell.pose_file import load_poses_file, pose_file_path
from cell.recording import RecordingFile
from ident.options import SILENT, Listener
from ident.pose_verification import Verification, verify
from ident.start.automatic import StartError
from ident.start.placements import PoseStartError
from ident.verdict import Status
from ident.verification import RecordingVerification, verify_recording

# [K] from which a difference of temperature is named: a length of 1 m of steel grows by 24 um.
WARMER = 2.0


def verify_poses(result: Path, folder: Path) -> tuple[Verification, tuple[str, ...]]:
    """Whether the calibration.yaml of still poses holds for the poses.yaml in a folder.

    Returns also what the reader found in its tables. Raises InputError for a result of logs, and
    for a table of another robot, with too few poses, or that fits no place of the instrument.
    """
    calibration = Calibration.load(result)
    file, content, path = calibration.path, calibration.file, pose_file_path(folder)
    mean = calibration.cross_validated
    _check_same("robot", (load_poses_file(path).robot, path.parent), (content.robot, file))
    read = import_poses(path)
    try:
        outcome = verify(calibration.arm(), calibration.targets, mean, read.table)
    except PoseStartError as error:
        raise InputError(f"{folder}: cannot be held against {file}: {error}") from None
    return replace(outcome, doubt=_doubt(content.fit.status)), reading_remarks(read.report)


def verify_folder(
    result: Path, folder: Path, *, listener: Listener = SILENT
) -> tuple[RecordingVerification, tuple[str, ...]]:
    """Whether the calibration.yaml of recordings holds for the recording in a folder.

    Returns also what is to be said of the temperatures and of the reading. Raises InputError for a
    result of still poses or one without covariance, for a recording of a sensed length, and for one
    that cannot be read, is of another robot, ball-bar or plate, or whose logs do not fit together.
    """
    calibration = Calibration.load(result)
    file, content = calibration.path, calibration.file_of_logs()
    recording = read_with_causes(folder)
    _check_same_cell(content, file, recording.description, folder)
    if recording.length_log is not None:
        raise InputError(
            f"{folder}: a length hardly tells its own clock, so one short recording of it cannot "
            f"be held against a result. Take `ballbar identify --validate {folder} ...`, or ten "
            "still poses."
        )
    logs = logs_of(distinct_names([folder])[0], recording)
    try:
        outcome = verify_recording(calibration.machine(calibration.cell()), logs, listener=listener)
    except StartError as error:
        raise InputError(f"{folder}: cannot be held against {file}: {error}") from None
    outcome = replace(outcome, doubt=_doubt(content.fit.status))
    warmth = temperature_remarks(content, recording.description.temperature_C)
    return outcome, (*warmth, *reading_remarks(recording.report))


def _doubt(status: str) -> str:
    """What to say of a result whose own verdict was a misfit or worse; empty otherwise."""
    if status not in [s for s in Status if s.severity >= Status.MISFIT.severity]:
        return ""
    return f'the stored result\'s own verdict is "{status}", so identify the robot again'


def temperature_remarks(content: CalibrationFile, now: float | None) -> tuple[str, ...]:
    """A sentence where a recording was taken at another temperature [deg C] than the result."""
    before = [r.temperature_C for r in content.logs if r.temperature_C is not None]
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


def _check_same_cell(
    content: CalibrationFile, file: Path, recorded: RecordingFile, folder: Path
) -> None:
    _check_same("robot", (recorded.robot, folder), (content.robot, file))
    _check_same("instrument", (recorded.measured_by, folder), (content.instrument, file))
    _check_same("plate", (recorded.plate, folder), (content.plate, file))


def _check_same(what: str, measured: tuple[str, Path], stored: tuple[str, Path]) -> None:
    """measured : name of a description, and its folder. stored : name, and calibration.yaml."""
    (here, folder), (name, file) = measured, stored
    if description_identity(here, folder) != description_identity(name, file.parent):
        raise InputError(
            f"{folder}: is of {what} {here}, {file} of {name}, or their files differ. A result is "
            "tried on measurements of the same robot, instrument and plate."
        )


def reading_remarks(report: ImportReport) -> tuple[str, ...]:
    """What the reader left out or changed, and its warnings that ask for something."""
    return tuple(finding_line(entry) for entry in report.findings if entry.notable)


def say_verification(
    out: Console, verification: Verification | RecordingVerification, remarks: Sequence[str] = ()
) -> None:
    """Print the sentence, then what does not count, and further remarks.

    Green where it holds, red where something changed, yellow where nothing can be said.
    """
    sound = verification.comparable
    colour = "green" if verification.holds else "red" if sound else "yellow"
    out.print(f"[bold {colour}]{escape(verification.sentence)}[/]")
    for warning in (*verification.warnings, *remarks):
        out.print(f"[yellow]warning:[/] {escape(warning)}")


def exit_code(verification: Verification | RecordingVerification) -> int:
    """0 where it holds, 1 where something changed, 2 where nothing can be said."""
    if not verification.comparable:
        return 2
    return 0 if verification.holds else 1


def verification_data(verification: Verification, remarks: Sequence[str]) -> dict[str, object]:
    """JSON of `verify` with still poses, SI units."""
    return {
        "holds": verification.holds,
        "comparable": verification.comparable,
        "sentence": verification.sentence,
        "warnings": [*verification.warnings, *remarks],
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
                "named": cause in verification.named,
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
        "comparable": outcome.comparable,
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
                "parameters": list(e.cause.names),
                "size": e.size.tolist(),
                "sigma": e.sigma.tolist(),
                "log_bayes_factor": e.evidence,
                "named": e in outcome.named,
            }
            for e in outcome.explanations[:5]
        ],
    }
