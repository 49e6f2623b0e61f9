"""poses.yaml: how to read tables of still poses (schema `ballbar-poses/1`).

A person writes it, or `ballbar new --poses`; ballbar.acquisition.pose_tables reads it. A column is
named as in the header of its file, or counted from 1 in a file without header. A number may be the
difference or the sum of two columns: "x_t - x_dif".
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import hypot
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ballbar.cell.errors import DescriptionError
from ballbar.cell.file_units import AngleUnit, LengthUnit, Rotation
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.poses import KnownDistance
from ballbar.cell.schema import Day, Positive, Strict
from ballbar.cell.schema_errors import nearest, wrong_key
from ballbar.cell.strict_yaml import load_model
from ballbar.cell.temperature import Temperatures

Column = Annotated[int, Field(ge=1, le=9999)] | str  # name in the header, or number from 1


class NamedColumn(Strict):
    """A column that holds a name or a number of each row."""

    column: Column
    """Name in the header, or number from 1."""


class JointColumns(Strict):
    """The joint angles of each pose."""

    columns: tuple[Column, ...] = Field(default=())
    """One for each axis, in their order, or one `re:` that finds them. None for a list of
    jointtargets (RAPID) or messages of KUKA RSI.
    """
    unit: AngleUnit | None = Field(default=None)
    """Only a unit in the header, such as `[°]`, makes it unnecessary."""
    angles: Literal["axes", "joints"] = Field(default="axes")
    """Axis angles as the controller shows them, or joint angles of the DH model."""
    files: tuple[str, ...] = Field(default=())
    """Files that hold the angles alone, as many as the table has: their rows are paired by order.
    """


class ValueColumns(Strict):
    """Measured values of each pose: a length, x y z, azimuth and elevation, or x y z
    and a rotation."""

    columns: tuple[Column, ...] = Field(min_length=1, max_length=7)
    """A difference is written as "x_t - x_dif"."""
    unit: LengthUnit | None = Field(default=None)
    """Unit of lengths; unnecessary where the header states one, as for joints."""
    angle_unit: AngleUnit | None = Field(default=None)
    """Unit of rotations, azimuth and elevation."""
    rotation: Rotation | None = Field(default=None)
    """Form of the last columns of a pose: angles about moving axes (`XYZ`) or fixed ones (`xyz`),
    in the order of scipy's `Rotation.from_euler`; `rotvec`; `quat_wxyz`; `quat_xyzw`.
    """
    spherical: Literal["elevation", "zenith"] | None = Field(default=None)
    """The first three columns are azimuth, elevation above the horizontal (or angle from the
    zenith) and distance.
    """
    offset_m: float = Field(default=0.0)
    """Added to every measured length."""

    @property
    def quaternions(self) -> bool:
        """Whether the rotation is a quaternion, of four columns without unit."""
        return self.rotation is not None and self.rotation.startswith("quat")


class Sigma(Strict):
    """Standard deviation of what was measured: columns beside the values, or constants."""

    columns: tuple[Column, ...] = Field(default=())
    """One for each of the values, in their units."""
    length_m: Positive | None = Field(default=None)
    """Standard deviation of lengths and positions."""
    rotation_rad: Positive | None = Field(default=None)
    """Standard deviation of the rotation of a pose, about each axis."""

    @model_validator(mode="after")
    def _either(self) -> Self:
        if bool(self.columns) == (self.length_m is not None):
            raise wrong_key("columns", message="give either columns or length_m")
        return self


class ReferencePoints(Strict):
    """Points on the floor or the robot's base that the instrument reads beside the poses."""

    columns: tuple[Column, ...] = Field(max_length=300)
    """x y z of each point in turn, three points or more, in the unit and form (`spherical`) of the
    values. A point was not read where a field is empty.
    """
    sigma_m: Positive | None = Field(default=None)
    """Standard deviation of each coordinate; default that of the instrument."""

    @model_validator(mode="after")
    def _points(self) -> Self:
        points, rest = divmod(len(self.columns), 3)
        if rest:
            message = f"{len(self.columns)} columns; expected x y z of each point"
            raise wrong_key("columns", message=message)
        if points < 3:
            message = f"{points} points; expected 3 or more, which show how the seat turns"
            raise wrong_key("columns", message=message)
        return self


class PictureColumns(Strict):
    """Corners of a board in pictures, in place of values: pixels u to the right and v down."""

    corners: str = Field(min_length=1)
    """File of the corners, a row each: image, corner, u, v. Corners count from 0 as in the board's
    file; the middle of the first pixel is at 0, 0.
    """
    columns: tuple[Column, Column, Column, Column] = ("image", "corner", "u", "v")
    """Their columns."""
    image: Column = "image"
    """Column of the table that names the picture of each row, as in the file of the corners."""
    board: str = Field(min_length=1)
    """File of the board (schema `ballbar-board/1`), from the folder of poses.yaml."""
    camera: Literal["cell", "flange"] = "cell"
    """Where the camera stands: in the cell, with the board on the flange, or on the flange."""


class PoseTime(Strict):
    """When each pose was taken."""

    column: Column
    """Name in the header, or number from 1."""
    form: str | None = Field(default=None)
    """Form of the stamps where they do not show it: `s`, `ms`, `unix-s`, ... Dates, and digits such
    as 20200714163904, show it.
    """


class PoseTableFile(Strict):
    """Files with the same columns, and what these hold."""

    files: tuple[str, ...] = Field(min_length=1)
    """Paths from the folder of poses.yaml; .gz, .bz2 and .xz too."""
    sheet: str | None = Field(default=None)
    """Sheet of a workbook; default the first."""
    joints: JointColumns
    values: ValueColumns | None = Field(default=None)
    """None for a socket."""
    pictures: PictureColumns | None = Field(default=None)
    """In place of values: corners that a camera saw."""
    sigma: Sigma | None = Field(default=None)
    """Default: that of the instrument."""
    instrument: str | None = Field(default=None)
    """Another instrument than that of the other tables."""
    seat: str | NamedColumn = Field(default="seat")
    """Placement of the instrument: a name, or a column."""
    target: str | NamedColumn = Field(default="target")
    """Ball or reflector on the flange: a name, or a column."""
    reference: ReferencePoints | None = Field(default=None)
    """Their motion, that of the seat, is taken off the values."""
    time: PoseTime | None = None
    temperature: NamedColumn | None = Field(default=None)
    """Column in deg C."""

    @model_validator(mode="after")
    def _pictures_are_all(self) -> Self:
        if self.pictures is not None and (self.values or self.sigma or self.reference):
            raise wrong_key("pictures", message="leave out values, sigma and reference beside it")
        if self.pictures is not None and len(self.files) > 1:
            raise wrong_key("files", message="one file for each file of corners")
        return self

    @model_validator(mode="after")
    def _joint_files_pair(self) -> Self:
        count, expected = len(self.joints.files), len(self.files)
        if count not in (0, expected):
            message = f"{count} files of joints for {expected} files of the table; give as many"
            raise wrong_key("joints", "files", message=message)
        return self


class KnownDistances(Strict):
    """Distances between seats that something else states, such as the drawing of a fixture."""

    pairs: tuple[tuple[str, str], ...] = Field(min_length=1)
    """Names of two seats each."""
    length_m: Positive | None = Field(default=None)
    """Else the distance that the instrument's file states."""
    sigma_m: Positive | None = None

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.length_m is None) != (self.sigma_m is None):
            raise wrong_key("pairs", message="give length_m and sigma_m, or none of them")
        for i, (first, second) in enumerate(self.pairs):
            if first == second:
                raise wrong_key("pairs", i, message="expected two different seats")
        return self


def known_distances(
    declared: Sequence[KnownDistances],
    instrument: Instrument,
    seats: Iterable[str],
    *,
    growth: tuple[float, float] = (0.0, 0.0),
) -> tuple[KnownDistance, ...]:
    """Each declared distance, by default the instrument's own; seats : those that there are.

    growth : share by which distances are longer than stated, and its standard uncertainty.

    Raises DescriptionError naming the key.
    """
    names, out = set(seats), list[KnownDistance]()
    for k, entry in enumerate(declared):
        stated = (entry.length_m, entry.sigma_m)
        length, sigma = stated if None not in stated else instrument.distance or (None, None)
        if length is None or sigma is None:
            what = f"length_m is missing, and {instrument.name} states no distance of its own."
            raise DescriptionError.at(f"distances[{k}]", what, "Add length_m and sigma_m.")
        for seat in (seat for pair in entry.pairs for seat in pair):
            if seat not in names:
                raise DescriptionError(
                    f"distances[{k}]: nothing is measured at seat {seat!r}."
                    f"{nearest(seat, names, noun='seat')}"
                )
        sigma = hypot(sigma, length * growth[1])
        out += [KnownDistance(pair, length * (1.0 + growth[0]), sigma) for pair in entry.pairs]
    return tuple(out)


class PosesFile(Temperatures):
    """Still poses of one robot."""

    schema_: Annotated[Literal["ballbar-poses/1"], Field(alias="schema")]
    kind: Literal["simulated", "real"]
    """Where the values come from."""
    robot: str
    """A file of cell/robots, or a path from this file."""
    instrument: str
    """A file of cell/instruments, or a path from this file."""
    tables: tuple[PoseTableFile, ...] = Field(min_length=1, max_length=500)
    distances: tuple[KnownDistances, ...] = ()
    measured_on: Day | None = None
    """Day of the measurement, such as 2026-03-31; by default as a column of times shows it."""
    notes: str = ""


def pose_file_path(path: Path) -> Path:
    """The file that is meant: a folder's poses.yaml, or the file itself."""
    return path / "poses.yaml" if path.is_dir() else path


def load_poses_file(path: Path) -> PosesFile:
    """The checked content of a poses.yaml.

    Raises DescriptionError naming file, line and key.
    """
    return load_model(path, PosesFile)
