"""Declarations of poses.yaml about one table: checked, and turned into columns and units."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Literal

from ballbar.acquisition.formats.table_file import COLUMNS as JOINTTARGET
from ballbar.acquisition.formats.table_file import FileKind
from ballbar.acquisition.table.quantities import (
    Quantity,
    header_names,
    quantities,
    selector,
    unit_stated,
)
from ballbar.acquisition.table.text import LogText
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import DescriptionError
from ballbar.cell.file_units import METRES, RADIANS, AngleUnit
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.pose_file import PoseTableFile, Sigma, ValueColumns
from ballbar.cell.selectors import spread

# Columns of the joint angles of files that have names of their own for them.
AXES_OF: dict[FileKind, tuple[str, ...]] = {
    "rapid": JOINTTARGET,
    "kuka-rsi": tuple(f"AIPos.A{k}" for k in range(1, 7)),
}
Part = Literal["joints", "values", "sigma", "reference", "temperature"]


@dataclass(frozen=True, eq=False)
class TableContext:
    """A table of a poses.yaml with the robot and the instrument that it is about."""

    path: Path  # of poses.yaml
    robot: Robot
    instrument: Instrument
    key: str  # of the table in the file, such as `tables[0]`
    declared: PoseTableFile

    def wrong(self, key: str, message: str) -> DescriptionError:
        """Error about a key of the table."""
        return DescriptionError(f"{self.path}: {self.key}.{key}: {message}")


@dataclass(frozen=True, eq=False)
class TableColumns:
    """The columns of a file that poses.yaml declares, by what they hold."""

    parts: dict[Part, tuple[Quantity, ...]]  # no joints where they stand in a file of their own
    labels: dict[str, str]  # selectors of seat, target and time, as far as they are columns

    @property
    def selectors(self) -> list[str]:
        """All columns, each once."""
        numbers = selectors_of(chain.from_iterable(self.parts.values()))
        return list(dict.fromkeys((*numbers, *self.labels.values())))


def selectors_of(columns: Iterable[Quantity]) -> list[str]:
    """The columns of which quantities are formed."""
    return [selector for quantity in columns for _, selector in quantity.terms]


def check_declared(context: TableContext) -> None:
    """Raises DescriptionError where the keys of a table do not fit its instrument."""
    declared, measured = context.declared, context.instrument.measured
    values = declared.values
    words = f"{context.instrument.name} measures a {measured}"
    kind = context.instrument.kind
    if declared.reference is not None and kind.names[:3] != ("x", "y", "z"):
        message = f"{words}; only a measured position can be corrected. Leave reference out."
        raise context.wrong("reference", message)
    if not kind.columns:
        if values is not None:
            raise context.wrong("values", f"{words}: leave values out.")
        if declared.sigma is not None and declared.sigma.columns:
            raise context.wrong("sigma", "a socket has no columns of sigma; give length_m.")
        return
    if declared.pictures is not None:
        if context.instrument.camera is None:
            message = f"{context.instrument.name} is no camera: its file has no `camera`."
            raise context.wrong("pictures", message)
        return
    if values is None:
        raise context.wrong("values", f"missing; {words}. Add the columns that hold it.")
    _check_values(context, values, words)
    if declared.sigma is not None:
        _check_sigma(context, declared.sigma, values)


def _check_values(context: TableContext, values: ValueColumns, words: str) -> None:
    """Raises as `check_declared`; words : what the instrument measures."""
    kind = context.instrument.kind
    if kind.target_turns and values.rotation is None:
        message = f"rotation is missing; {words}. Add its convention, such as XYZ, rotvec or"
        raise context.wrong("values", f"{message} quat_wxyz.")
    if not kind.target_turns and values.rotation is not None:
        raise context.wrong("values.rotation", f"{words}, without rotation: leave it out.")
    count, expected = len(values.columns), kind.columns + values.quaternions
    if count != expected:
        raise context.wrong("values.columns", f"{count} columns; {words}: expected {expected}.")
    if values.spherical is not None and kind.names[:3] != ("x", "y", "z"):
        raise context.wrong("values.spherical", f"{words}: leave it out.")
    if values.offset_m and kind.units != ("m",) and values.spherical is None:
        raise context.wrong("values.offset_m", f"{words}: an offset belongs to lengths only.")


def _check_sigma(context: TableContext, sigma: Sigma, values: ValueColumns) -> None:
    if not sigma.columns:
        kind = context.instrument.kind
        if kind.units and "m" not in kind.units:
            message = "the values are angles. Name their columns of sigma, or leave it out."
            raise context.wrong("sigma", message)
        if kind.target_turns and sigma.rotation_rad is None:
            raise context.wrong("sigma", "rotation_rad is missing beside length_m.")
        return
    if values.quaternions:
        message = "not for quaternions. Give length_m and rotation_rad."
        raise context.wrong("sigma.columns", message)
    given, count = len(sigma.columns), len(values.columns)
    if given != count:
        message = f"{given} columns, expected {count}, one for each of the values."
        raise context.wrong("sigma.columns", message)


def table_columns(
    context: TableContext, text: LogText, kind: FileKind, *, with_joints: bool
) -> TableColumns:
    """The columns of a file; with_joints : whether it holds the joint angles too.

    Raises DescriptionError for a column that is named twice.
    """
    declared, names = context.declared, header_names(text)
    single = {
        key: named.column
        for key in ("seat", "target", "time", "temperature")
        if (named := getattr(declared, key)) is not None and not isinstance(named, str)
    }
    if declared.pictures is not None:
        single["image"] = declared.pictures.image
    temperature = [single.pop("temperature")] if "temperature" in single else []
    joints = joint_columns(context, text, kind) if with_joints else ()
    values = quantities(declared.values.columns if declared.values else (), names)
    reference = quantities(declared.reference.columns if declared.reference else (), names)
    for key, columns, others, what in (
        ("values", values, joints, "joints"),
        ("reference", reference, (*joints, *values), "joints or values"),
    ):
        used = [quantity.terms for quantity in (*columns, *others)]
        for quantity in columns:
            if used.count(quantity.terms) > 1:
                message = f"{quantity.written} stands there, or among the {what}, too."
                raise context.wrong(f"{key}.columns", message)
    parts: dict[Part, tuple[Quantity, ...]] = {
        "joints": joints,
        "values": values,
        "sigma": quantities(declared.sigma.columns if declared.sigma else (), names),
        "reference": reference,
        "temperature": quantities(temperature, names),
    }
    labels = {key: selector(column, names) for key, column in single.items()}
    return TableColumns(parts, labels)


def joint_columns(context: TableContext, text: LogText, kind: FileKind) -> tuple[Quantity, ...]:
    """The columns of the joint angles, one an axis."""
    axes = context.robot.joints
    columns = context.declared.joints.columns or AXES_OF.get(kind, ())
    named = spread([str(c) for c in columns], axes) if len(columns) == 1 else columns
    if len(named) != axes:
        what = f"{len(named)} columns, but {context.robot.name} has {axes} axes."
        raise context.wrong("joints.columns", f"{what} Name one column for each, in their order.")
    joints = quantities(named, header_names(text))
    selected = [joint.terms for joint in joints]
    if twice := [terms[0][1] for terms in selected if selected.count(terms) > 1]:
        raise context.wrong("joints.columns", f"{twice[0]} stands there twice.")
    return joints


def angle_unit(
    context: TableContext, key: str, declared: AngleUnit | None, columns: Sequence[Quantity]
) -> AngleUnit:
    """Unit of columns of angles: declared below a key of the table, or stated by the header."""
    unit = _unit(context, key, "unit" if key == "joints" else "angle_unit", declared, columns)
    for angle in RADIANS:
        if unit == angle:
            return angle
    raise context.wrong(key, f"the header says {unit}; expected rad or deg.")


def value_units(
    context: TableContext, declared: ValueColumns, columns: Sequence[Quantity]
) -> tuple[str, AngleUnit]:
    """Units of the lengths and of the angles among the values; rad where there are none."""
    first = context.instrument.kind.units.count("m")
    lengths, angles = list(columns[:first]), list(columns[first:])
    if declared.spherical is not None:
        lengths, angles = lengths[2:], [*lengths[:2], *angles]
    if declared.quaternions:
        angles = angles[:-4]
    unit = _unit(context, "values", "unit", declared.unit, lengths) if lengths else "m"
    if unit not in METRES:
        raise context.wrong("values", f"the header says {unit}; expected {', '.join(METRES)}.")
    return unit, angle_unit(context, "values", declared.angle_unit, angles) if angles else "rad"


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
        message = f"missing: the header does not state the unit of {written}. Add it: {choices}."
        raise context.wrong(f"{key}.{name}", message)
    if stated - {declared}:
        header = ", ".join(sorted(stated))
        message = f"{declared}, but the header says {header}. Correct one of them."
        raise context.wrong(f"{key}.{name}", message)
    return declared
