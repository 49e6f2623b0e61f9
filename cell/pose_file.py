"""poses.yaml: how to read tables of still poses (schema `ballbar-poses/1`).

A person writes it, or `ballbar new --poses`; acquisition.poses reads it. A column is named as in
the header of its file, or counted from 1 in a file without header. A number may be the difference
or the sum of two columns: "x_t - x_dif".
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from cell.description_files import Positive
from cell.schema import Strict
from cell.schema_errors import wrong_key
from cell.strict_yaml import load_model

LengthUnit = Literal["m", "cm", "mm", "um", "inch"]
AngleUnit = Literal["rad", "deg"]
Column = Annotated[int, Field(ge=1, le=9999)] | str  # name in the header, or number from 1
# Angles turned about moving axes (XYZ) or fixed ones (xyz), as scipy's Rotation.from_euler has it.
Rotation = Annotated[
    str,
    Field(
        pattern=r"^(rotvec|quat_wxyz|quat_xyzw"
        r"|XYZ|XZY|YXZ|YZX|ZXY|ZYX|XYX|XZX|YXY|YZY|ZXZ|ZYZ"
        r"|xyz|xzy|yxz|yzx|zxy|zyx|xyx|xzx|yxy|yzy|zxz|zyz)$"
    ),
]


class NamedColumn(Strict):
    """A text or number that stands in each row."""

    column: Column


class JointColumns(Strict):
    """The joint angles of each pose."""

    columns: tuple[Column, ...] = ()  # one an axis, or one `re:`; none for a list of jointtargets
    unit: AngleUnit | None = None
    # what they are: those that the controller shows, or those of the DH model
    angles: Literal["axes", "joints"] = "axes"
    # own files, as many as the table has, paired with its rows by their order
    files: tuple[str, ...] = ()


class ValueColumns(Strict):
    """What the instrument measured of each pose."""

    columns: Annotated[tuple[Column, ...], Field(min_length=1, max_length=7)]
    unit: LengthUnit | None = None  # of lengths
    angle_unit: AngleUnit | None = None  # of rotations, and of azimuth and elevation
    rotation: Rotation | None = None  # of the last three or four columns of a pose
    # the first three are azimuth, elevation (or angle from the zenith) and distance
    spherical: Literal["elevation", "zenith"] | None = None
    offset_m: float = 0.0  # added to every measured length


class Sigma(Strict):
    """Standard deviation of what was measured: columns beside the values, or constants."""

    columns: tuple[Column, ...] = ()  # in the units of the values, one for each of them
    length_m: Positive | None = None
    rotation_rad: Positive | None = None  # of a pose, about each axis

    @model_validator(mode="after")
    def _either(self) -> Self:
        if bool(self.columns) == (self.length_m is not None):
            raise wrong_key("columns", message="give either columns or length_m")
        return self


class PoseTime(Strict):
    """When each pose was taken."""

    column: Column
    form: str | None = None  # of acquisition.times, where the stamps do not show it


class PoseTableFile(Strict):
    """Files of one kind, and what their columns hold."""

    files: Annotated[tuple[str, ...], Field(min_length=1)]
    sheet: str | None = None  # of a workbook; the first one
    joints: JointColumns
    values: ValueColumns | None = None  # none for a socket
    sigma: Sigma | None = None  # the instrument's
    instrument: str | None = None  # another one than that of the whole file
    seat: str | NamedColumn = "seat"  # placement of the instrument
    target: str | NamedColumn = "target"  # ball or reflector on the flange
    time: PoseTime | None = None
    temperature: NamedColumn | None = None  # [deg C]

    @model_validator(mode="after")
    def _joint_files_pair(self) -> Self:
        count, expected = len(self.joints.files), len(self.files)
        if count not in (0, expected):
            message = f"{count} files of joints for {expected} files of the table; give as many"
            raise wrong_key("joints", "files", message=message)
        return self


class KnownDistances(Strict):
    """Distance between two seats, of one pair or several, that something else tells."""

    pairs: Annotated[tuple[Annotated[tuple[str, str], Field()], ...], Field(min_length=1)]
    length_m: Positive | None = None  # that of the instrument's two seats
    sigma_m: Positive | None = None

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.length_m is None) != (self.sigma_m is None):
            raise wrong_key("pairs", message="give length_m and sigma_m, or none of them")
        for i, (first, second) in enumerate(self.pairs):
            if first == second:
                raise wrong_key("pairs", i, message="expected two different seats")
        return self


class PosesFile(Strict):
    """poses.yaml"""

    schema_: Annotated[Literal["ballbar-poses/1"], Field(alias="schema")]
    kind: Literal["simulated", "real"]
    robot: str  # a file of cell/robots, or a path relative to this file
    instrument: str  # a file of cell/instruments, or a path
    tables: Annotated[tuple[PoseTableFile, ...], Field(min_length=1)]
    distances: tuple[KnownDistances, ...] = ()
    notes: str = ""


def pose_file_path(path: Path) -> Path:
    """The file that is meant: a folder's poses.yaml, or the file itself."""
    return path / "poses.yaml" if path.is_dir() else path


def load_poses_file(path: Path) -> PosesFile:
    """The checked content of a poses.yaml.

    Raises DescriptionError naming file, line and key.
    """
    return load_model(path, PosesFile)
