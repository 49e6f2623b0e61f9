"""The poses of one file of a table: its rows paired with joint angles, checked, in SI units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.bundle import FEWEST
from ballbar.acquisition.corners import Corners, read_corners
from ballbar.acquisition.declared_columns import (
    Part,
    TableColumns,
    TableContext,
    angle_unit,
    check_declared,
    joint_columns,
    selectors_of,
    table_columns,
    value_units,
)
from ballbar.acquisition.faults.nominal_robot import (
    check_lengths,
    check_positions,
    check_rotations,
    orientations,
    refuse_radians,
)
from ballbar.acquisition.faults.robot_angles import AngleReading
from ballbar.acquisition.faults.table_angles import angle_findings, refuse_other_unit
from ballbar.acquisition.formats.table_file import pose_text
from ballbar.acquisition.measured_values import (
    ValueConversion,
    constant_sigma,
    refuse_quaternions,
    with_sigma_of_instrument,
)
from ballbar.acquisition.report import FileSummary, Finding
from ballbar.acquisition.table.quantities import PoseRows, Quantity, read_rows
from ballbar.acquisition.times import (
    TIME_FORMS,
    TimeCells,
    checked_form,
    day_of,
    form_shown,
    stamps_ns,
)
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError
from ballbar.cell.file_units import METRES, RADIANS
from ballbar.cell.pose_file import NamedColumn, PoseTime
from ballbar.cell.poses import PoseGroup

_DIGITS = re.compile(r"(\d{4})(\d\d)(\d\d)(\d\d)(\d\d)(\d\d)(\.\d+)?")  # 20200714163904
_EXPONENT = re.compile(r"[+-]?[0-9.,]+[eE][+-]?[0-9]+")
_NEEDED: tuple[Part, ...] = ("joints", "values", "sigma")  # numbers that a row must have


@dataclass(frozen=True, eq=False)
class FilePoses:
    """The poses of one file."""

    group: PoseGroup  # as if all were of one seat and target, and without time
    seat: tuple[str, ...]
    target: tuple[str, ...]
    stamps: NDArray[np.int64] | None  # (N,) [ns]
    reference: Array  # (N, K, 3) [m] reference points; NaN where one was not read
    reference_sigma: Array  # (N, K) [m] of each coordinate
    summaries: tuple[FileSummary, ...]
    findings: tuple[Finding, ...]
    corners: Corners | None = None  # of pictures whose poses are not yet known

    def part(self, chosen: NDArray[np.bool_], group: PoseGroup) -> FilePoses:
        """The poses of the chosen rows (N,), whose group is given."""
        return replace(
            self,
            group=group,
            seat=tuple(np.array(self.seat, dtype=object)[chosen]),
            target=tuple(np.array(self.target, dtype=object)[chosen]),
            stamps=None if self.stamps is None else self.stamps[chosen],
            reference=self.reference[chosen],
            reference_sigma=self.reference_sigma[chosen],
        )


@dataclass(frozen=True, eq=False)
class _Numbers:
    """The numbers of a file in its own units; NaN where a field is empty."""

    rows: PoseRows
    reading: AngleReading  # of the joint angles
    parts: dict[Part, Array]  # (N, C) each

    def take(self, chosen: NDArray[np.bool_]) -> _Numbers:
        """The chosen rows (N,)."""
        parts = {part: numbers[chosen] for part, numbers in self.parts.items()}
        return _Numbers(self.rows.take(chosen), self.reading, parts)


def file_poses(context: TableContext, index: int) -> FilePoses:
    """The poses of the `index`-th file of a table.

    Raises LogError if the file cannot be trusted, DescriptionError if poses.yaml does not fit it.
    """
    declared = context.declared
    check_declared(context)
    file, joint_files = declared.files[index], declared.joints.files
    text, kind = pose_text(context.path.parent / file, file, declared.sheet)
    columns = table_columns(context, text, kind, with_joints=not joint_files)
    quantities = columns.parts
    needed = selectors_of(quantities["joints"] or quantities["values"])
    rows = joint_rows = read_rows(text, kind, columns.selectors, needed)
    if joint_files:
        text, kind = pose_text(context.path.parent / joint_files[index], joint_files[index])
        quantities["joints"] = joint_columns(context, text, kind)
        names = selectors_of(quantities["joints"])
        joint_rows = read_rows(text, kind, names, names)
        if rows.size != joint_rows.size:
            raise LogError(
                f"{rows.file} has {rows.size} rows, {joint_rows.file} has {joint_rows.size}: they "
                "are paired by their order. Remove what has no partner."
            )
    unit = angle_unit(context, "joints", declared.joints.unit, quantities["joints"])
    numbers = _Numbers(
        rows,
        AngleReading(declared.joints.angles, unit),
        {
            part: (joint_rows if part == "joints" else rows).numbers(quantities[part])
            for part in (*_NEEDED, "reference")
        },
    )
    missing = np.any([np.isnan(numbers.parts[part]).any(axis=1) for part in _NEEDED], axis=0)
    complete = ~missing
    corners: Corners | None = None
    read: tuple[FileSummary, ...] = ()
    entries: tuple[Finding, ...] = ()
    if declared.pictures is not None:
        images = rows.text(columns.labels["image"])
        corners, summary, entries = read_corners(context, declared.pictures, images)
        read, too_few = (summary,), complete & ~corners.enough
        sentence = f"the picture shows fewer than {FEWEST} corners of the board; left out."
        entries = (*entries, *rows.remark("picture left out", sentence, too_few))
        complete = complete & corners.enough
        corners = corners.take(complete)
    if not complete.any():
        what = f"no row has all numbers that {context.path.name} names. Are these the columns?"
        remedy = "Of a workbook, save it with the program that computes its formulas."
        raise LogError.at(file, what, remedy)
    logged = numbers.parts["joints"]
    refuse_other_unit(context.robot, declared.joints, numbers.reading, joint_rows, logged)
    poses = _poses(context, columns, numbers.take(complete))
    sources = (rows,) if joint_rows is rows else (joint_rows, rows)
    empty = [
        quantity.written
        for part in _NEEDED
        for quantity, values in zip(quantities[part], numbers.parts[part].T, strict=True)
        if np.isnan(values).any()
    ]
    shown = ", ".join(empty[:6]) + (", ..." if len(empty) > 6 else "")
    left_out = rows.remark("empty field", f"no number in {shown}; row left out.", missing)
    summaries = tuple(
        FileSummary(
            file=source.file,
            source="poses",
            dialect=source.kind,
            rows_kept=int(complete.sum()),
            time=f"time {columns.labels['time']}" if "time" in columns.labels else "no time",
            day="" if poses.stamps is None else day_of(poses.stamps),
            **asdict(source.form),
        )
        for source in sources
    )
    findings = (*(entry for source in sources for entry in source.findings), *left_out, *entries)
    return replace(
        poses, summaries=(*summaries, *read), findings=(*findings, *poses.findings), corners=corners
    )


def _poses(context: TableContext, columns: TableColumns, numbers: _Numbers) -> FilePoses:
    """The complete rows in SI units, checked against the robot and the instrument."""
    rows, robot, declared = numbers.rows, context.robot, context.declared
    logged = numbers.parts["joints"]
    q = numbers.reading.joints(robot, logged)
    findings = [*angle_findings(robot, rows, numbers.reading, logged)]
    values, sigma, entries = _measured(context, columns, numbers)
    findings += entries
    reference, reference_sigma = _reference(context, columns, numbers)
    refuse_radians(robot, rows, numbers.reading, logged, values)
    seats = _labels(rows, declared.seat, columns.labels.get("seat"))
    findings += _value_findings(context, columns, numbers, seats, q, values)
    stamps, temperature = None, None
    if declared.time is not None:
        stamps, entries = pose_stamps(declared.time, columns.labels["time"], rows)
        findings += entries
    if warmth := columns.parts["temperature"]:
        temperature = rows.numbers(warmth)[:, 0]
        sentence = f"no number in {warmth[0].written}; the temperatures of the file are not used."
        missing = np.isnan(temperature)
        findings += rows.remark("temperature not used", sentence, missing)
        temperature = None if missing.any() else temperature
    return FilePoses(
        PoseGroup(
            measured=context.instrument.measured,
            seat="",
            target="",
            q=q,
            values=values,
            sigma=sigma,
            rows=rows.line,
            file=rows.file,
            temperature=temperature,
        ),
        seat=seats,
        target=_labels(rows, declared.target, columns.labels.get("target")),
        stamps=stamps,
        reference=reference,
        reference_sigma=reference_sigma,
        summaries=(),
        findings=tuple(findings),
    )


def _conversion(context: TableContext, columns: Sequence[Quantity]) -> ValueConversion:
    """Conversion to SI of columns of measured values, or of one reference point."""
    declared = context.declared.values
    if declared is None:
        raise ValueError("a table without values")
    length, angle = value_units(context, declared, columns)
    return ValueConversion(declared, context.instrument.kind, METRES[length], RADIANS[angle])


def _measured(
    context: TableContext, columns: TableColumns, numbers: _Numbers
) -> tuple[Array, Array, tuple[Finding, ...]]:
    """Values (N, M) [m, rad] and sigma [m, rad] of rows, with findings."""
    rows, declared, instrument = numbers.rows, context.declared.values, context.instrument
    raw, constants = numbers.parts["values"], context.declared.sigma
    if context.declared.pictures is not None:  # their poses are found from all of them together
        unknown = np.zeros((rows.size, instrument.kind.columns))
        return unknown, unknown, ()
    values = raw
    if declared is not None:
        if instrument.kind.target_turns:
            refuse_quaternions(declared, rows, raw)
        conversion = _conversion(context, columns.parts["values"])
        values = conversion.values(raw)
        if constants is not None and constants.columns:
            sigma = conversion.sigma(raw, numbers.parts["sigma"])
            return values, *with_sigma_of_instrument(rows, sigma, instrument, values)
    if constants is None:
        return values, instrument.sigma(values), ()
    return values, constant_sigma(constants, instrument, rows.size), ()


def _reference(
    context: TableContext, columns: TableColumns, numbers: _Numbers
) -> tuple[Array, Array]:
    """Reference points (N, K, 3) [m], in the unit and form of the values, and sigma (N, K) [m]."""
    quantities, raw = columns.parts["reference"], numbers.parts["reference"]
    points = np.zeros((numbers.rows.size, len(quantities) // 3, 3))
    for k in range(points.shape[1]):
        xyz = slice(3 * k, 3 * k + 3)
        points[:, k] = _conversion(context, quantities[xyz]).position(raw[:, xyz])
    stated = context.declared.reference
    if stated is None or stated.sigma_m is not None:
        return points, np.full(points.shape[:2], stated.sigma_m if stated else np.nan)
    sigma = context.instrument.sigma(points.reshape(-1, 3))[:, 0]
    return points, sigma.reshape(points.shape[:2])


def _value_findings(
    context: TableContext,
    columns: TableColumns,
    numbers: _Numbers,
    seats: Sequence[str],
    q: Array,
    values: Array,
) -> tuple[Finding, ...]:
    """Findings about values (N, M) [m, rad] at joint angles q (N, J) [rad]; seats : (N,)."""
    robot, declared, rows = context.robot, context.declared.values, numbers.rows
    if declared is None:
        return ()
    unit, angle = value_units(context, declared, columns.parts["values"])
    if context.instrument.measured == "length":
        return check_lengths(rows, values, context.instrument, unit)
    if context.instrument.kind.names[:3] != ("x", "y", "z"):
        return ()
    findings, points = list[Finding](), values[:, :3]
    for seat in dict.fromkeys(seats):  # each has a frame of its own
        own = np.array([name == seat for name in seats])
        findings += check_positions(robot, rows.take(own), q[own], points[own], unit)
    if values.shape[1] == 6:
        expected, raw = orientations(robot, q, points), numbers.parts["values"][:, 3:]
        findings += check_rotations(robot, rows, expected, declared, raw, RADIANS[angle])
    return tuple(findings)


def pose_stamps(
    time: PoseTime, selector: str, rows: PoseRows
) -> tuple[NDArray[np.int64] | None, tuple[Finding, ...]]:
    """(N,) [ns] stamps of the rows of one file; None, with a finding, if they tell no time.

    Raises LogError for a stamp that is not of the form of the others.
    """
    cells = rows.text(selector)
    if not all(cells):
        empty = np.array([not cell for cell in cells])
        sentence = "empty stamps; the times are not used."
        return None, rows.remark("time not used", sentence, empty)
    # A spreadsheet that shows 14 digits as 2.02E+13 has cut date and time to the month; numbers in
    # exponent form that tell most poses apart are whole.
    cut = np.array([bool(_EXPONENT.fullmatch(cell)) for cell in cells])
    if cut.any() and len(set(cells)) <= 0.5 * len(cells):
        sentence = f"{cells[int(cut.argmax())]}: cut by a spreadsheet; the times are not used."
        return None, rows.remark("time not used", sentence, cut)
    if all(map(_DIGITS.fullmatch, cells)) and time.form is None:
        cells = [_DIGITS.sub(r"\1-\2-\3 \4:\5:\6\7", cell) for cell in cells]
    column = TimeCells(rows.file, selector, cells, rows.line)
    if time.form is not None:
        return stamps_ns(column, checked_form(time.form, "poses.yaml"))
    declare = f"in poses.yaml: `time: {{column: {time.column}, form: s}}`"
    return stamps_ns(column, form_shown(column, TIME_FORMS, declare))


def _labels(rows: PoseRows, declared: str | NamedColumn, column: str | None) -> tuple[str, ...]:
    """Seat or target of each row; raises LogError for an empty one."""
    if column is None:
        return (str(declared),) * rows.size
    labels = rows.text(column)
    if not all(labels):
        row = labels.index("")
        raise LogError(f"{rows.location(row)}: column {column} is empty. Fill in its name.")
    return tuple(labels)
