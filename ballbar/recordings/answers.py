"""Answers that the options of `ballbar new` give: one field and one option for each question."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Literal

import typer

from ballbar.acquisition.times import TIME_FORMS
from ballbar.cell.errors import InputError
from ballbar.cell.file_units import LogLengthUnit

Text = str | None
Number = int | None
_POSES = typer.Option(rich_help_panel="Options of still poses")
OfColumns = Annotated[
    Text, typer.Option(rich_help_panel="Columns of still poses, and of the logs of a tracker")
]
OfEachTable = Annotated[list[str] | None, _POSES]
_OF_COLUMNS = ("joints", "joint_unit", "values", "value_unit", "rotation", "angle_unit")
_SHARED = "robot", "instrument", *_OF_COLUMNS
_OF_POSES = "seat", "target", "corners", "board", "camera"
OfPoses = Annotated[Text, _POSES]


@dataclass(frozen=True, kw_only=True)
class Answers:
    """Answers that the user gave as options; None where a question will be asked.

    --robot : Robot, by name or .yaml file.
    --ballbar : Ball-bar, by name or .yaml file.
    --robot-dialect : Dialect of the robot's log, or a .yaml file of your own.
    --ballbar-dialect : Dialect of the second log, or a .yaml file.
    --ballbar-time : Form of the second log's time stamps, if they do not show it.
    --encoder b1=COLUMN[:-1] : Counter column of an encoder, with :-1 if it counts in the other
        direction; repeatable.
    --lines : Lines of the encoders per turn.
    --bits : Bits of the encoders' interpolation.
    --instrument : Instrument of cell/instruments, or a .yaml file: of poses, or in place of a
        ball-bar of a log of lengths or of a tracker that followed the tool.
    --column : Column of a log of lengths that holds the length.
    --unit : Unit of that column.
    --zero : Length where that column shows zero, in m.
    --damaged-rows : Leave out up to so many rows of each log in which a cell is no number; else
        such a log is refused.
    --joints COLUMN,... : Columns of the joint angles, in the order of the axes, by name or number.
    --joint-unit : rad or deg.
    --values COLUMN,... : Columns of what was measured: a length, x y z, azimuth and elevation, or
        x y z and a rotation; 'x_t - x_dif' is a difference.
    --value-unit : m, cm, mm, um or inch.
    --rotation : Convention of rotations: XYZ and the like about moving axes, xyz about fixed ones,
        rotvec, quat_wxyz, quat_xyzw.
    --angle-unit : Of rotations, or of azimuth and elevation: rad or deg.
    --seat NAME : Name of the instrument's placement: once for all files of poses, or for each in
        their order; else the files show it, or it is asked for.
    --target NAME : Name of the ball or reflector on the flange, once or for each file as well.
    --corners FILE : Corners that a camera saw, as `ballbar camera detect` writes them: image,
        corner, u, v; in place of columns of values.
    --board FILE : Description of their board.
    --camera : Where the camera is: in the cell, with the board on the flange, or on the flange.
    """

    robot: Text = None
    ballbar: Text = None
    robot_dialect: Text = None
    ballbar_dialect: Text = None
    robot_time: Annotated[
        Text,
        typer.Option(
            help="Form of the robot log's time stamps, if they do not show it: "
            f"{', '.join(TIME_FORMS)}."
        ),
    ] = None
    ballbar_time: Text = None
    encoder: list[str] | None = None
    lines: Annotated[Number, typer.Option(min=1)] = None
    bits: Annotated[Number, typer.Option(min=8, max=13)] = None
    instrument: Text = None
    column: Text = None
    unit: LogLengthUnit | None = None
    zero: float | None = None
    damaged_rows: Annotated[Number, typer.Option(min=1)] = None
    joints: OfColumns = None
    joint_unit: OfColumns = None
    values: OfColumns = None
    value_unit: OfColumns = None
    rotation: OfColumns = None
    angle_unit: OfColumns = None
    seat: OfEachTable = None
    target: OfEachTable = None
    corners: OfPoses = None
    board: OfPoses = None
    camera: Annotated[Literal["cell", "flange"] | None, _POSES] = None

    def refuse_others(self, *, poses: bool) -> None:
        """Raises InputError for options of logs beside still poses, and the other way round."""
        stated = [field.name for field in fields(self) if getattr(self, field.name) is not None]
        others = [name for name in stated if name not in _SHARED and (name in _OF_POSES) != poses]
        if others:
            options = ", ".join("--" + name.replace("_", "-") for name in others)
            here = "still poses" if poses else "logs"
            raise InputError.at(options, f"not for {here}.", "Leave it out.")
