"""`ballbar verify`: a stored result against a few still poses or one recording of today."""

from __future__ import annotations

import math
from dataclasses import replace
from os import PathLike
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from ballbar.acquisition.pose_tables import PoseImport
from ballbar.acquisition.recording import Recording
from ballbar.acquisition.report import ImportReport, finding_line
from ballbar.cell.descriptions import Cell, Robot, same_contents
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import nominal_chain
from ballbar.ident.machine_at_rest import arm_at_rest, table_at_rest
from ballbar.ident.options import SILENT, Listener
from ballbar.ident.single_causes import Explanation
from ballbar.ident.start.automatic import StartError
from ballbar.ident.start.placements import PoseStartError
from ballbar.ident.verdict import Status
from ballbar.ident.verification import Verification
from ballbar.ident.verify_recording import verify_recording
from ballbar.ident.verify_table import verify as verify_table
from ballbar.recordings.read import Thing, measured
from ballbar.result.calibration import Calibration, load
from ballbar.result.calibration_schema import CalibrationFile
from ballbar.result.identify import description_identity, distinct_names, logs_of

MEAN_LENGTH = math.sqrt(8.0 / math.pi)  # of a normal error of unit deviation along three axes
# [K] from which a difference of temperature is named: a length of 1 m of steel grows by 24 um.
WARMER = 2.0


def verify(
    calibration: Calibration | str | PathLike[str],
    thing: Thing,
    *,
    cell: Cell | None = None,
    listener: Listener = SILENT,
) -> Verification:
    """Whether a calibration holds for one recording, or some still poses, of today.

    calibration : or the path of one. thing : as of `identify`, with the `cell` of arrays.

    Raises InputError for a recording where still poses alone were identified; for measurements of
    another robot, instrument or plate, and those that cannot be read, are too few, or do not fit
    together; and for a result of recordings without covariance.
    """
    stored = calibration if isinstance(calibration, Calibration) else load(calibration)
    try:
        read = measured(thing, cell)
        if isinstance(read, PoseImport):
            outcome = _verify_poses(stored, read)
        else:
            outcome = _verify_recording(stored, read, cell, listener)
    except (PoseStartError, StartError) as error:
        place = thing if isinstance(thing, str | PathLike) else "what was measured"
        raise InputError(f"{place}: cannot be held against {stored.path}: {error}") from None
    return replace(outcome, doubt=_doubt(stored) or outcome.doubt)


def _verify_poses(calibration: Calibration, read: PoseImport) -> Verification:
    """Still poses; a machine that recordings identified is held at rest."""
    folder = None if read.file is None else read.file.parent
    check_same(calibration, folder, {"robot": read.description.robot}, read.table.robot)
    table, targets = read.table, calibration.targets
    if calibration.of_logs:
        machine = calibration.machine(calibration.cell())
        arm = arm_at_rest(machine, targets, _spread_of_groups(calibration.file))
        mean, table = MEAN_LENGTH * arm.discrepancy, table_at_rest(machine.robot, table)
    else:
        arm, mean = calibration.identified_robot(), calibration.cross_validated
    return replace(verify_table(arm, targets, mean, table), remarks=reading_remarks(read.report))


def _spread_of_groups(file: CalibrationFile) -> float:
    """[m] along each axis, how far still poses lie from the machine that was identified with them;
    0 where there were none.
    """
    squares = [(g.poses, g.position_rms_m**2) for g in file.groups]
    count = sum(poses for poses, _ in squares)
    return math.sqrt(sum(n * s for n, s in squares) / (3 * count)) if count else 0.0


def _verify_recording(
    calibration: Calibration, recording: Recording, cell: Cell | None, listener: Listener
) -> Verification:
    content, recorded = calibration.file_of_logs(), recording.description
    names = {"robot": recorded.robot, "instrument": recorded.measured_by, "plate": recorded.plate}
    check_same(calibration, recording.folder, names, None if cell is None else cell.robot)
    logs = logs_of(distinct_names([recording])[0], recording)
    outcome = verify_recording(calibration.machine(calibration.cell()), logs, listener=listener)
    warmth = temperature_remarks(content, recorded.temperature_C)
    return replace(outcome, remarks=(*warmth, *reading_remarks(recording.report)))


def _doubt(calibration: Calibration) -> str:
    """Sentence on a result whose own verdict was a misfit or worse; empty otherwise."""
    status = calibration.file.fit.status
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


def check_same(
    calibration: Calibration, folder: Path | None, names: dict[str, str], robot: Robot | None
) -> None:
    """Raise InputError where what was measured is of another machine than a result.

    names : of the descriptions in a folder, by the keys of its file. robot : of arrays.
    """
    for key, here in names.items():
        name, file = getattr(calibration.file, key), calibration.path
        if description_identity(here, folder) != description_identity(name, file.parent):
            raise InputError(
                f"{folder or 'what was measured'}: is of {key} {here}, {file} of {name}, or their "
                "files differ. A result is tried on measurements of the same robot, instrument and "
                "plate."
            )
    known = nominal_chain(calibration.robot)
    if robot is not None and not same_contents(nominal_chain(robot), known):
        what = f"has other nominal DH parameters than that of {calibration.path}."
        raise InputError.at(f"robot {robot.name}", what, "A result is tried on the same robot.")


def reading_remarks(report: ImportReport) -> tuple[str, ...]:
    """Lines on what the reader left out or changed, and its warnings that ask for something."""
    return tuple(finding_line(entry) for entry in report.findings if entry.notable)


def say_verification(out: Console, verification: Verification) -> None:
    """Print the sentence, then what does not count, and further remarks.

    Green where it holds, red where something changed, yellow where nothing can be said.
    """
    sound = verification.comparable
    colour = "green" if verification.holds else "red" if sound else "yellow"
    out.print(f"[bold {colour}]{escape(verification.sentence)}[/]")
    for warning in verification.warnings:
        out.print(f"[yellow]warning:[/] {escape(warning)}")


def exit_code(verification: Verification) -> int:
    """0 where it holds, 1 where something changed, 2 where nothing can be said."""
    if not verification.comparable:
        return 2
    return 0 if verification.holds else 1


def verification_data(outcome: Verification) -> dict[str, object]:
    """JSON of `verify`, SI units."""
    return {
        "holds": outcome.holds,
        "comparable": outcome.comparable,
        "sentence": outcome.sentence,
        "warnings": outcome.warnings,
        **outcome.figures,
        "sum_of_squares": outcome.square,
        "limit": outcome.limit,
        "causes": [_cause_data(outcome, e) for e in outcome.explanations[:5]],
    }


def _cause_data(outcome: Verification, e: Explanation) -> dict[str, object]:
    return {
        "kind": e.cause.kind,
        "name": e.cause.name,
        "axis": e.cause.axis or None,
        "parameters": list(e.cause.names),
        "size": e.size.tolist(),
        "sigma": e.sigma.tolist(),
        "log_bayes_factor": e.evidence,
        "sum_of_squares_left": outcome.square - e.gain,
        "named": e in outcome.named,
    }
