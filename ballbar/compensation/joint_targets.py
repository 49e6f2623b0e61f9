"""Files of joint targets: CSV with a header, a target in each row, as joint or axis angles.

    q1,q2,...,qJ                      rad, joint angles of the DH model
    axis1_deg,...,axisJ_deg           deg, axis angles as the controller shows and takes them

Other columns (names, speeds, times) are carried through as they are, but for an apostrophe before
what a spreadsheet would run.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cell.arrays import Array
from cell.descriptions import Robot
from cell.errors import InputError
from cell.foreign_text import csv_text
from cell.robot_angles import controller_to_joints, joints_to_axes


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
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(map(csv_text, targets.header))
    for row, angles in zip(targets.rows, values, strict=True):
        fields = [csv_text(field) for field in row]
        for k, angle in zip(places, angles, strict=True):
            fields[k] = repr(float(angle))
        writer.writerow(fields)
    return out.getvalue()


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
