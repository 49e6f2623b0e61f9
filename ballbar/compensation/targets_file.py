"""What `ballbar correct` does: nominal targets in, targets for the identified robot out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbar.compensation.joint_targets import TargetFile, read_targets, targets_text
from ballbar.export.result import EFFECTS, Result
from cell.arrays import Array
from cell.errors import InputError
from cell.files import write_whole
from cell.robot_angles import joints_to_axes
from ident.robot.inverse_calibration import CorrectedTargets, TargetError, corrected_targets

_NAMED = 3  # faults that a message names


@dataclass(frozen=True, eq=False)
class Correction:
    """Targets as they were, as they become, and the model's word on both."""

    targets: TargetFile
    corrected: CorrectedTargets
    moved: Array  # (N, 6) [rad] corrected less given, axis angles
    included: tuple[str, ...]  # what beyond geometry was taken into account
    warnings: tuple[str, ...]


def correct_file(path: Path, result: Result) -> Correction:
    """Corrected targets of a CSV file. Raises InputError naming file and line."""
    robot = result.cell.robot
    targets = read_targets(path, robot)
    try:
        corrected = corrected_targets(
            result.calibration.unloaded_robot(result.cell), result.calibration.nominal, targets.q
        )
    except TargetError as error:
        said = [f"{path}:{targets.lines[row]}: {why}" for row, why in sorted(error.faults.items())]
        more = [f"and {len(said) - _NAMED} more targets"] if len(said) > _NAMED else []
        raise InputError("\n".join(["nothing was written.", *said[:_NAMED], *more])) from None
    found = result.calibration.file.corrections
    status = result.calibration.file.fit.status
    return Correction(
        targets=targets,
        corrected=corrected,
        moved=joints_to_axes(robot, corrected.q) - joints_to_axes(robot, targets.q),
        included=tuple(what for name, what in EFFECTS.items() if name in found),
        warnings=tuple(_warnings(status, [name for name in EFFECTS if name not in found])),
    )


def write_corrected(out: Path, correction: Correction, result: Result) -> None:
    """Writes the corrected targets whole or not at all. Raises InputError rather than write over a file."""
    if out.exists():
        raise InputError(
            f"{out}: exists already; nothing was written. Name another file with --out."
        )
    write_whole(
        out, targets_text(correction.targets, result.cell.robot, correction.corrected.q).encode()
    )


def correction_data(correction: Correction, result: Result, out: Path) -> dict[str, object]:
    """Everything for --json, SI units."""
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
        "largest_axis_correction_rad": np.abs(correction.moved).max(axis=0).tolist(),
    }


def correction_lines(correction: Correction) -> list[str]:
    """What was done, for people."""
    c = correction.corrected
    largest = ", ".join(f"{v:.3f}" for v in np.degrees(np.abs(correction.moved).max(axis=0)))
    return [
        f"{len(c.q)} targets corrected for {', '.join(['geometry', *correction.included])}",
        f"pose error that the identified robot has at the given targets: mean {c.position_before.mean() * 1e3:.3f} mm, "
        f"largest {c.position_before.max() * 1e3:.3f} mm; mean {c.angle_before.mean() * 1e3:.3f} mrad",
        f"largest correction of axes 1 to 6: {largest} deg",
        *(f"care: {warning}" for warning in correction.warnings),
    ]


def _warnings(status: str, missing: list[str]) -> list[str]:
    out = []
    if status != "good":
        out.append(f"the fit is called {status!r}; read its report before a robot moves by it")
    if missing:
        out.append(
            f"not identified, so not corrected: {', '.join(EFFECTS[name] for name in missing)}"
        )
    return out
