"""What poses.yaml declares of one table: checked against its instrument, as columns and units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from acquisition.formats.rapid import COLUMNS as JOINTTARGET
from acquisition.formats.table_file import FileKind
from acquisition.measured_values import METRES, RADIANS
from acquisition.table.quantities import Quantity, header_names, quantities, selector, unit_stated
from acquisition.table.text import LogText
from cell.descriptions import Robot
from cell.errors import DescriptionError
from cell.instrument import Instrument
from cell.pose_file import AngleUnit, Column, NamedColumn, PoseTableFile, ValueColumns
from cell.poses import COLUMNS, Measured
from cell.selectors import spread

# Columns of the joint angles of files that have names of their own for them.
AXES_OF: dict[FileKind, tuple[str, ...]] = {
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
class TableColumns:
    """What the rows of a file hold, as poses.yaml declares it."""

    joints: tuple[Quantity, ...]  # empty where they stand in a file of their own
    values: tuple[Quantity, ...]
    sigma: tuple[Quantity, ...]
    reference: tuple[Quantity, ...]  # x y z of each reference point
    temperature: tuple[Quantity, ...]  # none or one
    labels: dict[str, str]  # selectors of seat, target and time, as far as they are columns

    @property
    def selectors(self) -> list[str]:
        """Of all columns, each once."""
        numbers = (*self.joints, *self.values, *self.sigma, *self.reference, *self.temperature)
        selected = [term.selector for quantity in numbers for term in quantity.terms]
        return list(dict.fromkeys((*selected, *self.labels.values())))

    @property
    def measured(self) -> list[str]:
        """Of the columns that every row has as numbers."""
        needed = self.joints or self.values
        return [term.selector for quantity in needed for term in quantity.terms]


def check_declared(context: TableContext) -> None:
    """Raises DescriptionError where the keys of a table do not fit its instrument."""
    declared, measured = context.declared, context.instrument.measured
    words = f"{context.instrument.name} measures a {measured}"
    if declared.reference is not None and measured in ("length", "socket"):
        raise context.wrong(
            "reference", f"{words}; only a measured position can be corrected. Leave reference out."
        )
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


def table_columns(
    context: TableContext, text: LogText, kind: FileKind, *, with_joints: bool
) -> TableColumns:
    """The columns of a file; with_joints : whether it holds the joint angles too.

    Raises DescriptionError for a column that is named twice.
    """
    declared, names = context.declared, header_names(text)
    sigma = declared.sigma.columns if declared.sigma is not None else ()
    temperature = () if declared.temperature is None else (declared.temperature.column,)
    labels: dict[str, Column] = {}
    for key in ("seat", "target"):
        if isinstance(named := getattr(declared, key), NamedColumn):
            labels[key] = named.column
    if declared.time is not None:
        labels["time"] = declared.time.column
    joints = joint_columns(context, text, kind) if with_joints else ()
    values = quantities(declared.values.columns if declared.values else (), names)
    reference = quantities(declared.reference.columns if declared.reference else (), names)
    _refuse_twice(context, "values", values, joints, "joints")
    _refuse_twice(context, "reference", reference, (*joints, *values), "joints or values")
    return TableColumns(
        joints=joints,
        values=values,
        sigma=quantities(sigma, names),
        reference=reference,
        temperature=quantities(temperature, names),
        labels={key: selector(column, names) for key, column in labels.items()},
    )


def _refuse_twice(
    context: TableContext, key: str, own: Sequence[Quantity], others: Sequence[Quantity], what: str
) -> None:
    """Raises DescriptionError for a column that is named twice, or among the others too."""
    used = [quantity.terms for quantity in (*own, *others)]
    for quantity in own:
        if used.count(quantity.terms) > 1:
            message = f"{quantity.written} stands there, or among the {what}, too."
            raise context.wrong(f"{key}.columns", message)


def joint_columns(context: TableContext, text: LogText, kind: FileKind) -> tuple[Quantity, ...]:
    """The columns of the joint angles, one an axis."""
    axes, columns = context.axes, context.declared.joints.columns
    if not columns and kind in AXES_OF:
        columns = AXES_OF[kind]
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


def angle_unit(
    context: TableContext, key: str, declared: AngleUnit | None, columns: Sequence[Quantity]
) -> AngleUnit:
    """Unit of columns of angles: declared below a key of the table, or stated by the header."""
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


def value_units(
    context: TableContext, declared: ValueColumns, columns: Sequence[Quantity]
) -> tuple[str, AngleUnit]:
    """Units of the lengths and of the angles among the values; rad where there are none."""
    lengths, angles = list(columns[:3]), list(columns[3:])
    if declared.spherical is not None:
        lengths, angles = lengths[2:], [*lengths[:2], *angles]
    if declared.rotation is not None and declared.rotation.startswith("quat"):
        angles = angles[:-4]
    unit = _length_unit(context, declared, lengths)
    return unit, angle_unit(context, "values", declared.angle_unit, angles) if angles else "rad"
