"""The poses of one file of a table: its rows paired with joint angles, checked, in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquisition.formats.rapid import COLUMNS as JOINTTARGET
from acquisition.poses.columns import (
    PoseRows,
    Quantity,
    header_names,
    quantities,
    read_rows,
    selector,
    unit_stated,
)
from acquisition.poses.joints import joint_angles, limit_findings, may_be_rad, refuse_other_unit
from acquisition.poses.nominal import (
    better_as_rad,
    check_lengths,
    check_positions,
    check_rotations,
    orientations,
)
from acquisition.poses.remarks import angle_findings, repeated
from acquisition.poses.text import FileKind, pose_text
from acquisition.poses.times import pose_stamps
from acquisition.poses.values import (
    METRES,
    RADIANS,
    column_sigma,
    constant_sigma,
    refuse_quaternions,
    si_values,
    with_sigma_of_instrument,
)
from acquisition.report import FileSummary, Finding, finding
from acquisition.table.selectors import spread
from acquisition.table.text import LogText
from cell.arrays import Array
from cell.descriptions import Robot
from cell.errors import DescriptionError, LogError
from cell.instrument import Instrument
from cell.pose_file import AngleUnit, Column, NamedColumn, PoseTableFile, ValueColumns
from cell.poses import COLUMNS, Measured

# Columns of the joint angles of files that have names of their own for them.
_AXES_OF: dict[FileKind, tuple[str, ...]] = {
    "rapid": JOINTTARGET,
    "kuka-rsi": tuple(f"AIPos.A{k}" for k in range(1, 7)),
}


@dataclass(frozen=True, eq=False)
class TableContext:
    """A table of a poses.yaml with the robot and the instrument that it is about."""

    path: Path  # of poses.yaml
    robot: Robot
    instrument: Instrument
    key: str  # of the table in the file, such as `tables[0]`
    declared: PoseTableFile

    @property
    def axes(self) -> int:
        return int(self.robot.a.size)

    def wrong(self, key: str, message: str) -> DescriptionError:
        """Error about a key of the table."""
        return DescriptionError(f"{self.path}: {self.key}.{key}: {message}")


@dataclass(frozen=True, eq=False)
class FilePoses:
    """The poses of one file."""

    measured: Measured
    rows: PoseRows
    q: Array  # (N, J) [rad]
    values: Array  # (N, M) [m, rad]
    sigma: Array  # (N, M) [m, rad]; (N, 3) [m] of a socket
    seat: tuple[str, ...]
    target: tuple[str, ...]
    stamps: NDArray[np.int64] | None  # (N,) [ns]
    temperature: Array | None  # (N,) [deg C]
    summaries: tuple[FileSummary, ...]
    findings: tuple[Finding, ...]


@dataclass(frozen=True, eq=False)
class _Columns:
    """What the rows of a file hold, as poses.yaml declares it."""

    joints: tuple[Quantity, ...]  # empty where they stand in a file of their own
    values: tuple[Quantity, ...]
    sigma: tuple[Quantity, ...]
    temperature: tuple[Quantity, ...]  # none or one
    labels: dict[str, str]  # selectors of seat, target and time, as far as they are columns

    @property
    def selectors(self) -> list[str]:
        """Of all columns, each once."""
        numbers = (*self.joints, *self.values, *self.sigma, *self.temperature)
        selected = [term.selector for quantity in numbers for term in quantity.terms]
        return list(dict.fromkeys((*selected, *self.labels.values())))

    @property
    def measured(self) -> list[str]:
        """Of the columns that every row has as numbers."""
        needed = self.joints or self.values
        return [term.selector for quantity in needed for term in quantity.terms]


@dataclass(frozen=True, eq=False)
class _Numbers:
    """The numbers of a file in its own units."""

    rows: PoseRows
    logged: Array  # (N, J) joint angles
    values: Array  # (N, K)
    sigma: Array  # (N, K), or (N, 0)

    def take(self, chosen: NDArray[np.bool_]) -> _Numbers:
        """Those of the chosen rows (N,)."""
        return _Numbers(
            self.rows.take(chosen), self.logged[chosen], self.values[chosen], self.sigma[chosen]
        )


def file_poses(context: TableContext, index: int) -> FilePoses:
    """The poses of the `index`-th file of a table.

    Raises LogError if the file cannot be trusted, DescriptionError if poses.yaml does not fit it.
    """
    declared = context.declared
    _check_declared(context)
    text, kind = _text(context, declared.files[index])
    apart = bool(declared.joints.files)
    columns = _columns(context, text, kind, with_joints=not apart)
    rows = read_rows(text, kind, columns.selectors, columns.measured)
    joint_rows, joints = rows, columns.joints
    if apart:
        joint_rows, joints = _joint_file(context, declared.joints.files[index])
        _refuse_unpaired(rows, joint_rows)
    unit = _angle_unit(context, "joints", declared.joints.unit, joints)
    logged = _stacked(joint_rows, joints)
    every = _Numbers(rows, logged, _stacked(rows, columns.values), _stacked(rows, columns.sigma))
    complete = _complete(context, every)
    refuse_other_unit(context.robot, declared.joints, joint_rows, logged, unit)
    poses = _poses(context, columns, every.take(complete), unit)
    read = (rows,) if joint_rows is rows else (joint_rows, rows)
    summaries = tuple(_summary(each, int(complete.sum()), columns) for each in read)
    own = tuple(entry for each in read for entry in each.findings)
    left_out = _left_out(rows, every, columns, joints, complete)
    return replace(poses, summaries=summaries, findings=(*own, *left_out, *poses.findings))


def _check_declared(context: TableContext) -> None:
    """Raises DescriptionError where the keys of a table do not fit its instrument."""
    declared, measured = context.declared, context.instrument.measured
    words = f"{context.instrument.name} measures a {measured}"
    if measured != "socket":
        if declared.values is None:
            raise context.wrong("values", f"missing; {words}. Add the columns that hold it.")
        _check_values(context, declared.values, measured, words)
        _check_sigma(context, len(declared.values.columns))
        return
    if declared.values is not None:
        raise context.wrong("values", f"{words}: leave values out.")
    if declared.sigma is not None and declared.sigma.columns:
        raise context.wrong("sigma", "a socket has no columns of sigma; give length_m.")


def _check_values(
    context: TableContext, values: ValueColumns, measured: Measured, words: str
) -> None:
    expected = COLUMNS[measured]
    if measured == "pose" and values.rotation is None:
        raise context.wrong(
            "values",
            f"rotation is missing; {words}. Add its convention, such as XYZ, rotvec or quat_wxyz.",
        )
    if measured != "pose" and values.rotation is not None:
        raise context.wrong("values.rotation", f"{words}, without rotation: leave it out.")
    expected += bool(values.rotation and values.rotation.startswith("quat"))
    count = len(values.columns)
    if count != expected:
        raise context.wrong("values.columns", f"{count} columns; {words}: expected {expected}.")
    if values.spherical is not None and measured == "length":
        raise context.wrong("values.spherical", f"{words}: leave it out.")
    if values.offset_m and measured != "length" and values.spherical is None:
        raise context.wrong("values.offset_m", f"{words}: an offset belongs to lengths only.")


def _check_sigma(context: TableContext, count: int) -> None:
    """count : of the columns of the values."""
    sigma = context.declared.sigma
    if sigma is None:
        return
    if not sigma.columns:
        if context.instrument.measured == "pose" and sigma.rotation_rad is None:
            raise context.wrong("sigma", "rotation_rad is missing beside length_m.")
        return
    if count == 7:
        message = "not for quaternions. Give length_m and rotation_rad."
        raise context.wrong("sigma.columns", message)
    if len(sigma.columns) != count:
        message = f"{len(sigma.columns)} columns, expected {count}, one for each of the values."
        raise context.wrong("sigma.columns", message)


def _text(context: TableContext, file: str) -> tuple[LogText, FileKind]:
    return pose_text(context.path.parent / file, file, context.declared.sheet)


def _columns(
    context: TableContext, text: LogText, kind: FileKind, *, with_joints: bool
) -> _Columns:
    declared, names = context.declared, header_names(text)
    sigma = declared.sigma.columns if declared.sigma is not None else ()
    temperature = () if declared.temperature is None else (declared.temperature.column,)
    labels: dict[str, Column] = {}
    for key in ("seat", "target"):
        if isinstance(named := getattr(declared, key), NamedColumn):
            labels[key] = named.column
    if declared.time is not None:
        labels["time"] = declared.time.column
    return _Columns(
        joints=_joints(context, text, kind) if with_joints else (),
        values=quantities(declared.values.columns if declared.values else (), names),
        sigma=quantities(sigma, names),
        temperature=quantities(temperature, names),
        labels={key: selector(column, names) for key, column in labels.items()},
    )


def _joints(context: TableContext, text: LogText, kind: FileKind) -> tuple[Quantity, ...]:
    """The columns of the joint angles, one an axis."""
    axes, columns = context.axes, context.declared.joints.columns
    if not columns and kind in _AXES_OF:
        columns = _AXES_OF[kind]
    named = spread([str(c) for c in columns], axes) if len(columns) == 1 else columns
    if len(named) != axes:
        raise context.wrong(
            "joints.columns",
            f"{len(named)} columns, but {context.robot.name} has {axes} axes. Name one column for "
            "each, in their order.",
        )
    joints = quantities(named, header_names(text))
    selected = [joint.terms for joint in joints]
    for terms in selected:
        if selected.count(terms) > 1:
            column = terms[0].selector
            raise context.wrong("joints.columns", f"{column} stands there twice.")
    return joints


def _joint_file(context: TableContext, file: str) -> tuple[PoseRows, tuple[Quantity, ...]]:
    """The rows of a file that holds the joint angles alone."""
    text, kind = pose_text(context.path.parent / file, file)
    joints = _joints(context, text, kind)
    selectors = [term.selector for joint in joints for term in joint.terms]
    return read_rows(text, kind, selectors, selectors), joints


def _refuse_unpaired(rows: PoseRows, joint_rows: PoseRows) -> None:
    if rows.size != joint_rows.size:
        raise LogError(
            f"{rows.file} has {rows.size} rows, {joint_rows.file} has {joint_rows.size}: they are "
            "paired by their order. Remove what has no partner."
        )


def _angle_unit(
    context: TableContext, key: str, declared: AngleUnit | None, columns: Sequence[Quantity]
) -> AngleUnit:
    unit = _unit(context, key, "unit" if key == "joints" else "angle_unit", declared, columns)
    if unit not in RADIANS:
        raise context.wrong(key, f"the header says {unit}; expected rad or deg.")
    return "deg" if unit == "deg" else "rad"


def _length_unit(context: TableContext, declared: ValueColumns, columns: Sequence[Quantity]) -> str:
    unit = _unit(context, "values", "unit", declared.unit, columns)
    if unit not in METRES:
        raise context.wrong("values", f"the header says {unit}; expected {', '.join(METRES)}.")
    return unit


def _unit(
    context: TableContext, key: str, name: str, declared: str | None, columns: Sequence[Quantity]
) -> str:
    """The unit that poses.yaml or the header states.

    Raises DescriptionError if neither does, or they contradict each other.
    """
    stated = {unit for column in columns if (unit := unit_stated(column)) is not None}
    if declared is None and len(stated) == 1:
        return stated.pop()
    if declared is None:
        written = ", ".join(column.written for column in columns)
        choices = "rad or deg" if name == "angle_unit" or key == "joints" else ", ".join(METRES)
        raise context.wrong(
            f"{key}.{name}",
            f"missing: the header does not state the unit of {written}. Add it: {choices}.",
        )
    if stated - {declared}:
        raise context.wrong(
            f"{key}.{name}",
            f"{declared}, but the header says {', '.join(sorted(stated))}. Correct one of them.",
        )
    return declared


def _stacked(rows: PoseRows, columns: Sequence[Quantity]) -> Array:
    """(N, C) numbers of columns."""
    if not columns:
        return np.zeros((rows.size, 0))
    return np.stack([rows.numbers(column) for column in columns], axis=1)


def _complete(context: TableContext, every: _Numbers) -> NDArray[np.bool_]:
    """(N,) whether a row has all numbers; raises LogError if none has."""
    missing = np.isnan(every.logged).any(axis=1) | np.isnan(every.values).any(axis=1)
    missing |= np.isnan(every.sigma).any(axis=1)
    if missing.all():
        raise LogError(
            f"{every.rows.file}: no row has all numbers that {context.path.name} names. Are these "
            "the columns? A workbook stores results of formulas only once it was saved by the "
            "program that computes them."
        )
    return np.asarray(~missing)


def _left_out(
    rows: PoseRows,
    every: _Numbers,
    columns: _Columns,
    joints: Sequence[Quantity],
    complete: NDArray[np.bool_],
) -> tuple[Finding, ...]:
    """A finding about the rows that have empty fields."""
    if complete.all():
        return ()
    parts = ((joints, every.logged), (columns.values, every.values), (columns.sigma, every.sigma))
    empty = [
        column.written
        for written, numbers in parts
        for column, values in zip(written, numbers.T, strict=True)
        if np.isnan(values).any()
    ]
    shown = ", ".join(empty[:6]) + (", ..." if len(empty) > 6 else "")
    sentence = f"no number in {shown}; row left out."
    return (finding("empty field", "repaired", rows.file, sentence, lines=rows.line[~complete]),)


def _poses(
    context: TableContext, columns: _Columns, numbers: _Numbers, unit: AngleUnit
) -> FilePoses:
    """The complete rows in SI units, checked against the robot and the instrument."""
    rows, robot, declared = numbers.rows, context.robot, context.declared
    q = joint_angles(robot, declared.joints, numbers.logged, unit)
    findings = [
        *limit_findings(robot, rows, q),
        *angle_findings(rows, numbers.logged, unit),
        *repeated(rows, q),
    ]
    values, sigma, entries = _measured(context, columns, numbers)
    findings += entries
    _refuse_radians(context, numbers, q, values, unit)
    findings += _value_findings(context, columns, numbers, q, values)
    stamps, temperature = None, None
    if declared.time is not None:
        stamps, entries = pose_stamps(declared.time, columns.labels["time"], rows)
        findings += entries
    if columns.temperature:
        temperature, entries = _temperature(rows, columns.temperature[0])
        findings += entries
    return FilePoses(
        measured=context.instrument.measured,
        rows=rows,
        q=q,
        values=values,
        sigma=sigma,
        seat=_labels(rows, declared.seat, columns.labels.get("seat")),
        target=_labels(rows, declared.target, columns.labels.get("target")),
        stamps=stamps,
        temperature=temperature,
        summaries=(),
        findings=tuple(findings),
    )


def _measured(
    context: TableContext, columns: _Columns, numbers: _Numbers
) -> tuple[Array, Array, tuple[Finding, ...]]:
    """Values (N, M) [m, rad] and sigma [m, rad] of rows, with findings."""
    rows, declared, instrument = numbers.rows, context.declared.values, context.instrument
    constants = context.declared.sigma
    if declared is None:
        values = np.zeros((rows.size, 0))
        if constants is None:
            return values, instrument.sigma(values), ()
        return values, constant_sigma(constants, "socket", rows.size), ()
    if instrument.measured == "pose":
        refuse_quaternions(declared, rows, numbers.values[:, 3:])
    length_unit, angle_unit = _value_units(context, declared, columns.values)
    length, angle = METRES[length_unit], RADIANS[angle_unit]
    values = si_values(declared, numbers.values, length, angle)
    if constants is None:
        return values, instrument.sigma(values), ()
    if not constants.columns:
        return values, constant_sigma(constants, instrument.measured, rows.size), ()
    sigma = column_sigma(declared, numbers.values, numbers.sigma, length, angle)
    return values, *with_sigma_of_instrument(rows, sigma, instrument, values)


def _value_units(
    context: TableContext, declared: ValueColumns, columns: Sequence[Quantity]
) -> tuple[str, AngleUnit]:
    """Units of the lengths and of the angles among the values; rad where there are none."""
    lengths, angles = list(columns[:3]), list(columns[3:])
    if declared.spherical is not None:
        lengths, angles = lengths[2:], [*lengths[:2], *angles]
    if declared.rotation is not None and declared.rotation.startswith("quat"):
        angles = angles[:-4]
    unit = _length_unit(context, declared, lengths)
    return unit, _angle_unit(context, "values", declared.angle_unit, angles) if angles else "rad"


def _value_findings(
    context: TableContext, columns: _Columns, numbers: _Numbers, q: Array, values: Array
) -> tuple[Finding, ...]:
    """Findings about values (N, M) [m, rad] at joint angles q (N, J) [rad]."""
    robot, declared, rows = context.robot, context.declared.values, numbers.rows
    if declared is None:
        return ()
    unit, angle = _value_units(context, declared, columns.values)
    if context.instrument.measured == "length":
        return check_lengths(rows, values, context.instrument, unit)
    findings = check_positions(robot, rows, q, values[:, :3], unit)
    if values.shape[1] == 3:
        return findings
    expected = orientations(robot, q, values[:, :3])
    raw = numbers.values[:, 3:]
    return (*findings, *check_rotations(robot, rows, expected, declared, raw, RADIANS[angle]))


def _refuse_radians(
    context: TableContext, numbers: _Numbers, q: Array, values: Array, unit: AngleUnit
) -> None:
    """Raises LogError if angles declared as degrees, q (N, J) [rad], are radians by all that shows.

    values : (N, M) [m, rad].
    """
    robot, joints, logged = context.robot, context.declared.joints, numbers.logged
    if unit == "rad" or not may_be_rad(robot, joints, logged):
        return
    as_rad = joint_angles(robot, joints, logged, "rad")
    if values.shape[1] >= 3 and not better_as_rad(robot, q, as_rad, values[:, :3]):
        return
    raise LogError(
        f"{numbers.rows.file}: no joint angle exceeds {np.abs(logged).max():.4g}, so that as "
        "degrees the robot would hardly move. Radians? Write `unit: rad` under joints in "
        "poses.yaml."
    )


def _temperature(rows: PoseRows, column: Quantity) -> tuple[Array | None, tuple[Finding, ...]]:
    """(N,) [deg C] of each row; None, with a finding, if some have none."""
    values = rows.numbers(column)
    missing = np.isnan(values)
    if not missing.any():
        return values, ()
    sentence = f"no number in {column.written}; the temperatures of the file are not used."
    lines = rows.line[missing]
    entry = finding("temperature not used", "repaired", rows.file, sentence, lines=lines)
    return None, (entry,)


def _labels(rows: PoseRows, declared: str | NamedColumn, column: str | None) -> tuple[str, ...]:
    """Seat or target of each row; raises LogError for an empty one."""
    if column is None:
        return (str(declared),) * rows.size
    labels = rows.text(column)
    if not all(labels):
        row = labels.index("")
        raise LogError(f"{rows.location(row)}: column {column} is empty. Fill in its name.")
    return tuple(labels)


def _summary(rows: PoseRows, used: int, columns: _Columns) -> FileSummary:
    return FileSummary(
        file=rows.file,
        source="poses",
        dialect=rows.kind,
        encoding=rows.form.encoding,
        separator=rows.form.separator,
        decimal=rows.form.decimal,
        rows_read=rows.form.rows_read,
        rows_kept=used,
        time=f"time {columns.labels['time']}" if "time" in columns.labels else "no time",
    )
