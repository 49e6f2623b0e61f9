"""The poses of one file of a table: its rows paired with joint angles, checked, in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acquisition.declared_columns import (
    TableColumns,
    TableContext,
    angle_unit,
    check_declared,
    joint_columns,
    table_columns,
    value_units,
)
from acquisition.faults.nominal_robot import (
    better_as_rad,
    check_lengths,
    check_positions,
    check_rotations,
    orientations,
)
from acquisition.faults.table_angles import (
    joint_angles,
    limit_findings,
    may_be_rad,
    refuse_other_unit,
)
from acquisition.faults.table_remarks import angle_findings, repeated
from acquisition.formats.table_file import pose_text
from acquisition.measured_values import (
    METRES,
    RADIANS,
    column_sigma,
    constant_sigma,
    position,
    refuse_quaternions,
    si_values,
    with_sigma_of_instrument,
)
from acquisition.pose_times import pose_stamps
from acquisition.report import FileSummary, Finding, finding
from acquisition.table.quantities import PoseRows, Quantity, read_rows
from cell.arrays import Array
from cell.errors import LogError
from cell.pose_file import AngleUnit, NamedColumn
from cell.poses import Measured


@dataclass(frozen=True, eq=False)
class FilePoses:
    """The poses of one file."""

    measured: Measured
    rows: PoseRows
    q: Array  # (N, J) [rad]
    values: Array  # (N, M) [m, rad]
    sigma: Array  # (N, M) [m, rad]; (N, 3) [m] of a socket
    reference: Array  # (N, K, 3) [m] reference points; NaN where one was not read
    reference_sigma: Array  # (N, K) [m] of each coordinate
    seat: tuple[str, ...]
    target: tuple[str, ...]
    stamps: NDArray[np.int64] | None  # (N,) [ns]
    temperature: Array | None  # (N,) [deg C]
    summaries: tuple[FileSummary, ...]
    findings: tuple[Finding, ...]


@dataclass(frozen=True, eq=False)
class _Numbers:
    """The numbers of a file in its own units."""

    rows: PoseRows
    logged: Array  # (N, J) joint angles
    values: Array  # (N, K)
    sigma: Array  # (N, K), or (N, 0)
    reference: Array  # (N, 3 K), or (N, 0); NaN where a field is empty

    def take(self, chosen: NDArray[np.bool_]) -> _Numbers:
        """Those of the chosen rows (N,)."""
        return _Numbers(
            self.rows.take(chosen),
            self.logged[chosen],
            self.values[chosen],
            self.sigma[chosen],
            self.reference[chosen],
        )


def file_poses(context: TableContext, index: int) -> FilePoses:
    """The poses of the `index`-th file of a table.

    Raises LogError if the file cannot be trusted, DescriptionError if poses.yaml does not fit it.
    """
    declared = context.declared
    check_declared(context)
    file = declared.files[index]
    text, kind = pose_text(context.path.parent / file, file, declared.sheet)
    apart = bool(declared.joints.files)
    columns = table_columns(context, text, kind, with_joints=not apart)
    rows = read_rows(text, kind, columns.selectors, columns.measured)
    joint_rows, joints = rows, columns.joints
    if apart:
        joint_rows, joints = _joint_file(context, declared.joints.files[index])
        _refuse_unpaired(rows, joint_rows)
    unit = angle_unit(context, "joints", declared.joints.unit, joints)
    logged = _stacked(joint_rows, joints)
    parts = (columns.values, columns.sigma, columns.reference)
    every = _Numbers(rows, logged, *(_stacked(rows, part) for part in parts))
    complete = _complete(context, every)
    refuse_other_unit(context.robot, declared.joints, joint_rows, logged, unit)
    poses = _poses(context, columns, every.take(complete), unit)
    read = (rows,) if joint_rows is rows else (joint_rows, rows)
    summaries = tuple(_summary(each, int(complete.sum()), columns) for each in read)
    own = tuple(entry for each in read for entry in each.findings)
    left_out = _left_out(rows, every, columns, joints, complete)
    return replace(poses, summaries=summaries, findings=(*own, *left_out, *poses.findings))


def _joint_file(context: TableContext, file: str) -> tuple[PoseRows, tuple[Quantity, ...]]:
    """The rows of a file that holds the joint angles alone."""
    text, kind = pose_text(context.path.parent / file, file)
    joints = joint_columns(context, text, kind)
    selectors = [term.selector for joint in joints for term in joint.terms]
    return read_rows(text, kind, selectors, selectors), joints


def _refuse_unpaired(rows: PoseRows, joint_rows: PoseRows) -> None:
    if rows.size != joint_rows.size:
        raise LogError(
            f"{rows.file} has {rows.size} rows, {joint_rows.file} has {joint_rows.size}: they are "
            "paired by their order. Remove what has no partner."
        )


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
    columns: TableColumns,
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
    context: TableContext, columns: TableColumns, numbers: _Numbers, unit: AngleUnit
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
    reference = _reference(context, columns, numbers)
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
        reference=reference,
        reference_sigma=_reference_sigma(context, reference),
        seat=_labels(rows, declared.seat, columns.labels.get("seat")),
        target=_labels(rows, declared.target, columns.labels.get("target")),
        stamps=stamps,
        temperature=temperature,
        summaries=(),
        findings=tuple(findings),
    )


def _measured(
    context: TableContext, columns: TableColumns, numbers: _Numbers
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
    length_unit, angle_unit = value_units(context, declared, columns.values)
    length, angle = METRES[length_unit], RADIANS[angle_unit]
    values = si_values(declared, numbers.values, length, angle)
    if constants is None:
        return values, instrument.sigma(values), ()
    if not constants.columns:
        return values, constant_sigma(constants, instrument.measured, rows.size), ()
    sigma = column_sigma(declared, numbers.values, numbers.sigma, length, angle)
    return values, *with_sigma_of_instrument(rows, sigma, instrument, values)


def _reference(context: TableContext, columns: TableColumns, numbers: _Numbers) -> Array:
    """(N, K, 3) [m] the reference points, in the unit and the form of the values."""
    declared, points = context.declared.values, list[Array]()
    if declared is None or not columns.reference:
        return np.zeros((numbers.rows.size, 0, 3))
    for first in range(0, len(columns.reference), 3):
        units = value_units(context, declared, columns.reference[first : first + 3])
        raw = numbers.reference[:, first : first + 3]
        points.append(position(declared, raw, METRES[units[0]], RADIANS[units[1]]))
    return np.stack(points, axis=1)


def _reference_sigma(context: TableContext, reference: Array) -> Array:
    """(N, K) [m] of each coordinate of reference points (N, K, 3) [m]."""
    stated = context.declared.reference
    if stated is None or stated.sigma_m is not None:
        return np.full(reference.shape[:2], stated.sigma_m if stated else np.nan)
    return context.instrument.sigma(reference.reshape(-1, 3))[:, 0].reshape(reference.shape[:2])


def _value_findings(
    context: TableContext, columns: TableColumns, numbers: _Numbers, q: Array, values: Array
) -> tuple[Finding, ...]:
    """Findings about values (N, M) [m, rad] at joint angles q (N, J) [rad]."""
    robot, declared, rows = context.robot, context.declared.values, numbers.rows
    if declared is None:
        return ()
    unit, angle = value_units(context, declared, columns.values)
    if context.instrument.measured == "length":
        return check_lengths(rows, values, context.instrument, unit)
    findings = _position_findings(context, columns, rows, q, values[:, :3], unit)
    if values.shape[1] == 3:
        return findings
    expected = orientations(robot, q, values[:, :3])
    raw = numbers.values[:, 3:]
    return (*findings, *check_rotations(robot, rows, expected, declared, raw, RADIANS[angle]))


def _position_findings(
    context: TableContext, columns: TableColumns, rows: PoseRows, q: Array, points: Array, unit: str
) -> tuple[Finding, ...]:
    """Findings about points (N, 3) [m], seat by seat: each has a frame of its own."""
    seats = np.array(_labels(rows, context.declared.seat, columns.labels.get("seat")))
    return tuple(
        entry
        for seat in dict.fromkeys(seats.tolist())
        for own in [seats == seat]
        for entry in check_positions(context.robot, rows.take(own), q[own], points[own], unit)
    )


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


def _summary(rows: PoseRows, used: int, columns: TableColumns) -> FileSummary:
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
