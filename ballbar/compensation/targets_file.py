"""`ballbar correct`: targets of the nominal robot in, targets for the identified robot out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbar.compensation.joint_targets import TargetFile, read_targets, targets_text
from ballbar.export.result import EFFECTS, AnyResult, PoseResult
from ballbar.units import MM, MRAD
from cell.arrays import Array
from cell.errors import InputError
from cell.files import write_new
from cell.robot_angles import joints_to_axes
from ident.robot.identified_arm import range_sentence
from ident.robot.inverse_calibration import (
    CorrectedTargets,
    TargetError,
    corrected_arm_targets,
    corrected_targets,
)

_FAULTS_SHOWN = 3  # targets that cannot be corrected, in one message
_LINES_SHOWN = 5  # of targets outside the fitted ranges
_OF_LOGS = ("joint_compliance", "gear_backlash", "gear_ripple")  # effects that they may identify
_OF_POSES = ("unit_weights",)


@dataclass(frozen=True, eq=False)
class Correction:
    """Given and corrected targets, with the pose errors that the model predicts."""

    targets: TargetFile
    corrected: CorrectedTargets
    axis_changes: Array  # (N, J) [rad] corrected minus given axis angles
    included: tuple[str, ...]  # effects beyond geometry that were taken into account
    warnings: tuple[str, ...]


def correct_file(path: Path, result: AnyResult) -> Correction:
    """Corrected targets of a CSV file. Raises InputError naming file and line."""
    robot = result.robot
    targets = read_targets(path, robot)
    try:
        corrected = _corrected(result, targets.q)
    except TargetError as error:
        faults = [f"{path}:{targets.lines[k]}: {why}" for k, why in sorted(error.faults.items())]
        shown, more = faults[:_FAULTS_SHOWN], len(faults) - _FAULTS_SHOWN
        rest = [f"and {more} more targets"] if more > 0 else []
        raise InputError("\n".join(["nothing was written.", *shown, *rest])) from None
    identified = result.calibration.file.corrections
    expected = _OF_POSES if isinstance(result, PoseResult) else _OF_LOGS
    missing = [name for name in expected if name not in identified]
    return Correction(
        targets=targets,
        corrected=corrected,
        axis_changes=joints_to_axes(robot, corrected.q) - joints_to_axes(robot, targets.q),
        included=tuple(effect for name, effect in EFFECTS.items() if name in identified),
        warnings=(*_warnings(result.status, missing), *_outside(result, targets)),
    )


def _corrected(result: AnyResult, q: Array) -> CorrectedTargets:
    """Corrected targets (N, J) [rad]; raises TargetError, and InputError for five axes."""
    if isinstance(result, PoseResult):
        return corrected_arm_targets(result.calibration.arm(), q)
    robot = result.calibration.unloaded_robot(result.cell)
    return corrected_targets(robot, result.calibration.nominal, q)


def _outside(result: AnyResult, targets: TargetFile) -> list[str]:
    """Targets beyond the fitted range of an axis, with their lines and the range."""
    if not isinstance(result, PoseResult):
        return []
    arm = result.calibration.arm()
    inside = arm.covered(targets.q)
    if inside.all():
        return []
    lines = [str(line) for line, counts in zip(targets.lines, inside, strict=True) if not counts]
    more = f" and {len(lines) - _LINES_SHOWN} more" if len(lines) > _LINES_SHOWN else ""
    return [
        f"targets of line {', '.join(lines[:_LINES_SHOWN])}{more} are "
        f"{range_sentence(arm.out_of_range(targets.q))}"
    ]


def write_corrected(out: Path, correction: Correction, result: AnyResult) -> None:
    """Writes the corrected targets to a new file, completely or not at all.

    Raises InputError if the file exists.
    """
    text = targets_text(correction.targets, result.robot, correction.corrected.q)
    write_new(out, text.encode())


def correction_data(correction: Correction, result: AnyResult, out: Path) -> dict[str, object]:
    """JSON of `correct`, SI units."""
    c = correction.corrected
    return {
        "file": str(out),
        "source_sha256": result.sha256,
        "targets": len(c.q),
        "included": ["geometry", *correction.included],
        "warnings": list(correction.warnings),
        "predicted_position_error_m": {
            "mean": float(c.position_before.mean()),
            "max": float(c.position_before.max()),
        },
        "predicted_angle_error_rad": {
            "mean": float(c.angle_before.mean()),
            "max": float(c.angle_before.max()),
        },
        "left_in_the_model_m": float(c.position_after.max()),
        "largest_axis_correction_rad": np.abs(correction.axis_changes).max(axis=0).tolist(),
    }


def correction_lines(correction: Correction) -> list[str]:
    """Lines of text: effects, predicted pose error, largest corrections, warnings."""
    c = correction.corrected
    position, angle = c.position_before * MM, c.angle_before * MRAD
    largest = np.degrees(np.abs(correction.axis_changes).max(axis=0))
    degrees = ", ".join(f"{v:.3f}" for v in largest)
    return [
        f"{len(c.q)} targets corrected for {', '.join(['geometry', *correction.included])}",
        "pose error that the identified robot has at the given targets: "
        f"mean {position.mean():.3f} mm, largest {position.max():.3f} mm; "
        f"mean {angle.mean():.3f} mrad",
        f"largest correction of axes 1 to {len(largest)}: {degrees} deg",
        *(f"care: {warning}" for warning in correction.warnings),
    ]


def _warnings(status: str, missing: list[str]) -> list[str]:
    warnings = []
    if status != "good":
        warnings.append(f"the fit is called {status!r}; read its report before a robot moves by it")
    if missing:
        effects = ", ".join(EFFECTS[name] for name in missing)
        warnings.append(f"not identified, so not corrected: {effects}")
    return warnings
