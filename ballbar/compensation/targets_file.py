"""`ballbar correct` for tables: targets of the nominal robot in, of the identified robot out.

A table is CSV with a header, a target in each row, as joint or axis angles:

    q1,q2,...,qJ                      rad, joint angles of the DH model
    axis1_deg,...,axisJ_deg           deg, axis angles as the controller shows and takes them

Other columns (names, speeds, times) are carried through as they are, but for an apostrophe before
what a spreadsheet would run.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.files import write_new
from ballbar.cell.foreign_text import csv_text
from ballbar.cell.payload import Payload, with_payload
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes
from ballbar.export.result import EFFECTS, Result
from ballbar.ident.robot.identified import range_sentence
from ballbar.ident.robot.inverse_calibration import CorrectedTargets, TargetError, corrected_targets
from ballbar.units import MM, MRAD

_FAULTS_SHOWN = 3  # targets that cannot be corrected, in one message
_LINES_SHOWN = 5  # of targets outside the fitted ranges
_OF_LOGS = ("joint_compliance", "gear_backlash", "gear_ripple")  # effects that they may identify
_OF_POSES = ("unit_weights",)


def joint_columns(robot: Robot) -> tuple[str, ...]:
    """Names of the columns of joint angles."""
    return tuple(f"q{i + 1}" for i in range(robot.joints))


def axis_columns(robot: Robot) -> tuple[str, ...]:
    """Names of the columns of axis angles."""
    return tuple(f"axis{i + 1}_deg" for i in range(robot.joints))


@dataclass(frozen=True, eq=False)
class TargetFile:
    """Targets as read, with the other columns of their file."""

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]  # line number of each row in the file, from 1
    columns: tuple[str, ...]  # of joint or axis angles
    q: Array  # (N, J) [rad] DH joint angles


def read_targets(path: Path, robot: Robot) -> TargetFile:
    """Targets of a CSV file. Raises InputError naming file, line and column."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is not UTF-8; save the file as CSV in UTF-8"
        ) from None
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        table = [(reader.line_num, tuple(row)) for row in reader if row]
    except csv.Error as error:
        raise InputError(
            f'{path}:{reader.line_num}: {error}; save the file as CSV with comma and " as quote'
        ) from None
    if not table:
        either = " or ".join(", ".join(f(robot)) for f in (joint_columns, axis_columns))
        raise InputError(f"{path}: is empty; expected a header with {either}")
    header = tuple(name.strip() for name in table[0][1])
    columns = _columns(path, header, robot)
    if len(table) == 1:
        raise InputError(f"{path}: has a header and no target; add a row for each target")
    lines, rows = zip(*table[1:], strict=True)
    places = [header.index(name) for name in columns]
    values = np.array(
        [
            [_number(f"{path}:{line}", header, row, k) for k in places]
            for line, row in zip(lines, rows, strict=True)
        ]
    )
    q = (
        values
        if columns == joint_columns(robot)
        else controller_to_joints(robot, np.radians(values))
    )
    return TargetFile(path=path, header=header, rows=rows, lines=lines, columns=columns, q=q)


def targets_text(targets: TargetFile, robot: Robot, q: Array) -> str:
    """Text of the file with new targets, all digits of each number.

    q : (N, J) [rad] joint angles of the DH model.
    """
    values = q if targets.columns == joint_columns(robot) else np.degrees(joints_to_axes(robot, q))
    places = [targets.header.index(name) for name in targets.columns]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(map(csv_text, targets.header))
    for row, angles in zip(targets.rows, values, strict=True):
        fields = [csv_text(field) for field in row]
        for k, angle in zip(places, angles, strict=True):
            fields[k] = repr(float(angle))
        writer.writerow(fields)
    return text.getvalue()


def _columns(path: Path, header: tuple[str, ...], robot: Robot) -> tuple[str, ...]:
    """The columns of the targets, of one kind. Raises InputError if the header has not one."""
    joints, axes = joint_columns(robot), axis_columns(robot)
    kinds = [names for names in (joints, axes) if any(name in header for name in names)]
    if len(kinds) != 1:
        content = "both kinds of angles" if kinds else "no angles"
        hint = " Separate columns by commas." if ";" in "".join(header) else ""
        raise InputError(
            f"{path}:1: {content} in the header; expected {', '.join(joints)} [rad] or "
            f"{', '.join(axes)} [deg].{hint}"
        )
    for name in kinds[0]:
        if (count := header.count(name)) != 1:
            raise InputError(
                f"{path}:1: column {name} stands {count} times in the header; it must be there once"
            )
    return kinds[0]


def _number(place: str, header: tuple[str, ...], row: tuple[str, ...], column: int) -> float:
    """The number in a column of a row. place : file and line, for messages."""
    if len(row) != len(header):
        raise InputError(
            f"{place}: {len(row)} fields, the header has {len(header)}; give each row as many"
        )
    try:
        value = float(row[column])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            f"{place}: {header[column]} = {row[column]!r} is not a finite number; write one with a "
            "decimal point"
        )
    return value


@dataclass(frozen=True, eq=False)
class CorrectedTable:
    """Given and corrected targets, with the pose errors that the model predicts."""

    targets: TargetFile
    corrected: CorrectedTargets
    axis_changes: Array  # (N, J) [rad] corrected minus given axis angles
    included: tuple[str, ...]  # effects beyond geometry that were taken into account
    warnings: tuple[str, ...]


def _refused(path: Path, targets: TargetFile, error: TargetError) -> InputError:
    """The error that names the first faults by file and line."""
    lines = [f"{path}:{targets.lines[k]}: {why}" for k, why in sorted(error.faults.items())]
    shown, more = lines[:_FAULTS_SHOWN], len(lines) - _FAULTS_SHOWN
    others = [f"and {more} more targets"] if more > 0 else []
    return InputError("\n".join(["nothing was written.", *shown, *others]))


def correct_file(path: Path, result: Result) -> CorrectedTable:
    """Corrected targets of a CSV file. Raises InputError naming file and line."""
    robot = result.robot
    targets = read_targets(path, robot)
    try:
        corrected = corrected_joints(result, targets.q)
    except TargetError as error:
        raise _refused(path, targets, error) from None
    identified, of_logs = result.calibration.file.corrections, result.calibration.of_logs
    expected = _OF_LOGS if of_logs else _OF_POSES
    missing = [EFFECTS[name] for name in expected if name not in identified]
    poor = f"the fit is called {result.status!r}; read its report before a robot moves by it"
    warnings = [poor] if result.status != "good" else []
    if missing:
        warnings.append(f"not identified, so not corrected: {', '.join(missing)}")
    return CorrectedTable(
        targets=targets,
        corrected=corrected,
        axis_changes=joints_to_axes(robot, corrected.q) - joints_to_axes(robot, targets.q),
        included=tuple(effect for name, effect in EFFECTS.items() if name in identified),
        warnings=(*warnings, *([] if of_logs else _outside(result, targets))),
    )


def corrected_joints(result: Result, q: Array, payload: Payload | None = None) -> CorrectedTargets:
    """Corrected targets (N, J) [rad]; raises TargetError, and InputError for five axes.

    payload : of logs, what the robot carries; by default what it carried in the recording.
    """
    robot = result.calibration.identified_robot(cell=result.cell)
    if payload is not None and result.cell is not None and result.robot.links is not None:
        robot = replace(robot, description=with_payload(robot.cell, payload))
    return corrected_targets(robot, result.nominal, q)


def _outside(result: Result, targets: TargetFile) -> list[str]:
    """Targets beyond the fitted range of an axis, with their lines and the range."""
    robot = result.calibration.identified_robot()
    inside = robot.covered(targets.q)
    if inside.all():
        return []
    lines = [str(line) for line, counts in zip(targets.lines, inside, strict=True) if not counts]
    more = f" and {len(lines) - _LINES_SHOWN} more" if len(lines) > _LINES_SHOWN else ""
    return [
        f"targets of line {', '.join(lines[:_LINES_SHOWN])}{more} are "
        f"{range_sentence(robot.out_of_range(targets.q))}"
    ]


def write_corrected(out: Path, correction: CorrectedTable, result: Result) -> None:
    """Writes the corrected targets to a new file, completely or not at all.

    Raises InputError if the file exists.
    """
    text = targets_text(correction.targets, result.robot, correction.corrected.q)
    write_new(out, text.encode())


def correct_and_write_table(
    path: Path, result: Result, out: Path
) -> tuple[dict[str, object], list[str]]:
    """Corrects a table and writes it to a new file.

    Returns the JSON of `correct`, in SI units, and lines of text: effects, predicted pose error,
    largest corrections, warnings. Raises InputError as the functions above.
    """
    correction = correct_file(path, result)
    write_corrected(out, correction, result)
    c = correction.corrected
    largest = np.abs(correction.axis_changes).max(axis=0)
    data: dict[str, object] = {
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
        "largest_axis_correction_rad": largest.tolist(),
    }
    position, angle = c.position_before * MM, c.angle_before * MRAD
    degrees = ", ".join(f"{v:.3f}" for v in np.degrees(largest))
    return data, [
        f"{len(c.q)} targets corrected for {', '.join(['geometry', *correction.included])}",
        "pose error that the identified robot has at the given targets: "
        f"mean {position.mean():.3f} mm, largest {position.max():.3f} mm; "
        f"mean {angle.mean():.3f} mrad",
        f"largest correction of axes 1 to {len(largest)}: {degrees} deg",
        *(f"care: {warning}" for warning in correction.warnings),
        f"Wrote {out}",
    ]
