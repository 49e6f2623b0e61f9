"""Files of joint targets: CSV with a header, one target a row, in joint angles or in the controller's axis angles.

    q1,q2,q3,q4,q5,q6                 rad, joint angles of the DH model
    axis1_deg,...,axis6_deg           deg, axis angles as the controller shows and takes them

Other columns (names, speeds, times) are carried through as they are.
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
from cell.robot_angles import controller_to_joints, joints_to_axes

JOINTS = tuple(f"q{i + 1}" for i in range(6))
AXES = tuple(f"axis{i + 1}_deg" for i in range(6))


@dataclass(frozen=True, eq=False)
class TargetFile:
    """Targets as read, with what stood around them."""

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]  # of each row in the file, from 1
    columns: tuple[str, ...]  # JOINTS or AXES
    q: Array  # (N, 6) [rad] DH joint angles


def read_targets(path: Path, robot: Robot) -> TargetFile:
    """Targets of a CSV file. Raises InputError naming file, line and column."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is not UTF-8; save the file as plain CSV"
        ) from None
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        table = [(reader.line_num, tuple(row)) for row in reader if row]
    except csv.Error as error:
        raise InputError(f"{path}:{reader.line_num}: {error}") from None
    if not table:
        raise InputError(
            f"{path}: is empty; expected a header with {', '.join(JOINTS)} or {', '.join(AXES)}"
        )
    header = tuple(name.strip() for name in table[0][1])
    columns = _columns(path, header)
    if len(table) == 1:
        raise InputError(f"{path}: has a header and no target below it")
    places = [header.index(name) for name in columns]
    values = np.array(
        [[_number(path, line, header, row, k) for k in places] for line, row in table[1:]]
    )
    q = values if columns == JOINTS else controller_to_joints(robot, np.radians(values))
    return TargetFile(
        path,
        header,
        tuple(row for _, row in table[1:]),
        tuple(line for line, _ in table[1:]),
        columns,
        q,
    )


def targets_text(targets: TargetFile, robot: Robot, q: Array) -> str:
    """The same file with targets q (N, 6) [rad] in it, all digits."""
    values = q if targets.columns == JOINTS else np.degrees(joints_to_axes(robot, q))
    places = [targets.header.index(name) for name in targets.columns]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(targets.header)
    for row, new in zip(targets.rows, values, strict=True):
        cells = list(row)
        for k, value in zip(places, new, strict=True):
            cells[k] = repr(float(value))
        writer.writerow(cells)
    return out.getvalue()


def _columns(path: Path, header: tuple[str, ...]) -> tuple[str, ...]:
    found = [names for names in (JOINTS, AXES) if any(name in header for name in names)]
    if len(found) != 1:
        what = "both kinds of angles" if found else "no angles"
        hint = " Columns are separated by commas." if ";" in "".join(header) else ""
        raise InputError(
            f"{path}:1: {what} in the header; expected {', '.join(JOINTS)} [rad] or {', '.join(AXES)} [deg].{hint}"
        )
    missing = [name for name in found[0] if header.count(name) != 1]
    if missing:
        raise InputError(
            f"{path}:1: column {missing[0]} stands {header.count(missing[0])} times in the header; it must be there once"
        )
    return found[0]


def _number(
    path: Path, line: int, header: tuple[str, ...], row: tuple[str, ...], column: int
) -> float:
    if len(row) != len(header):
        raise InputError(f"{path}:{line}: {len(row)} cells, the header has {len(header)}")
    try:
        value = float(row[column])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            f"{path}:{line}: {header[column]} = {row[column]!r} is not a finite number"
        )
    return value
