"""`ballbar verify`: a stored result of still poses against a few poses of today."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.markup import escape

from ballbar.result.calibration import calibration_file
from ballbar.result.pose_calibration import load_pose_calibration
from cell.errors import InputError
from cell.poses import PoseTable
from ident.poses.verification import Verification, verify


def verify_poses(result: Path, table: PoseTable) -> Verification:
    """Whether the calibration.yaml of still poses holds for a table.

    Raises InputError for a result of logs, a table of another robot, or one with too few poses.
    """
    file = calibration_file(result)
    if not file.is_file():
        raise InputError(f"{file}: no such file. Name a calibration.yaml, or its folder.")
    calibration = load_pose_calibration(file)
    if table.robot.title != calibration.robot.title:
        raise InputError(
            f"{table.name}: is of robot {table.robot.title}, {file} of {calibration.robot.title}."
        )
    mean = calibration.file.cross_validation.mean_m
    return verify(calibration.arm(), calibration.targets, mean, table)


def say_verification(out: Console, verification: Verification) -> None:
    """Print the sentence, green or red, then what does not count."""
    colour = "green" if verification.holds else "red"
    out.print(f"[bold {colour}]{escape(verification.sentence)}[/]")
    for warning in verification.warnings:
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
