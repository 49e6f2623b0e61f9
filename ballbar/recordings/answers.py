"""Answers that the options of `ballbar new` give: one field and one option for each question."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import typer

from acquisition.times import TIME_FORMS
from cell.file_units import LogLengthUnit

Text = str | None
Number = int | None
_log = typer.Option
_poses = partial(typer.Option, rich_help_panel="Options of still poses")


@dataclass(frozen=True, kw_only=True)
class Answers:
    """Answers that the user gave as options; None where a question will be asked."""

    robot: Annotated[Text, _log(help="Robot, by name or .yaml file.")] = None
    ballbar: Annotated[Text, _log(help="Ball-bar, by name or .yaml file.")] = None
    robot_dialect: Annotated[
        Text, _log(help="Dialect of the robot's log, or a .yaml file of your own.")
    ] = None
    ballbar_dialect: Annotated[Text, _log(help="Dialect of the second log, or a .yaml file.")] = (
        None
    )
    robot_time: Annotated[
        Text,
        _log(
            help="Form of the robot log's time stamps, if they do not show it: "
            f"{', '.join(TIME_FORMS)}."
        ),
    ] = None
    ballbar_time: Annotated[
        Text, _log(help="Form of the second log's time stamps, if they do not show it.")
    ] = None
    encoder: Annotated[
        list[str] | None,
        _log(
            help="Counter column of an encoder, with :-1 if it counts in the other direction; may "
            "be repeated.",
            metavar="b1=COLUMN[:-1]",
        ),
    ] = None
    lines: Annotated[Number, _log(help="Lines of the encoders per turn.", min=1)] = None
    bits: Annotated[Number, _log(help="Bits of the encoders' interpolation.", min=8, max=13)] = None
    instrument: Annotated[
        Text,
        _log(
            help="Instrument of cell/instruments, or a .yaml file: of poses, or of a log of "
            "lengths in place of a ball-bar's."
        ),
    ] = None
    column: Annotated[Text, _log(help="Column of a log of lengths that holds the length.")] = None
    unit: Annotated[LogLengthUnit | None, _log(help="Unit of that column.")] = None
    zero: Annotated[float | None, _log(help="Length where that column shows zero, in m.")] = None
    damaged_rows: Annotated[
        Number,
        _log(
            help="Leave out up to so many rows of each log in which a cell is no number, and "
            "report them; without it such a log is refused.",
            min=1,
        ),
    ] = None
    joints: Annotated[
        Text,
        _poses(
            help="Columns of the joint angles, in the order of the axes, by name or number.",
            metavar="COLUMN,...",
        ),
    ] = None
    joint_unit: Annotated[Text, _poses(help="rad or deg.")] = None
    values: Annotated[
        Text,
        _poses(
            help="Columns of what was measured: a length, x y z, or x y z and a rotation; "
            "'x_t - x_dif' is a difference.",
            metavar="COLUMN,...",
        ),
    ] = None
    value_unit: Annotated[Text, _poses(help="m, cm, mm, um or inch.")] = None
    rotation: Annotated[
        Text,
        _poses(
            help="Convention of rotations: XYZ and the like about moving axes, xyz about fixed "
            "ones, rotvec, quat_wxyz, quat_xyzw."
        ),
    ] = None
    angle_unit: Annotated[Text, _poses(help="Of rotations: rad or deg.")] = None
    seat: Annotated[
        list[str] | None,
        _poses(
            help="Name of the instrument's placement: once for all files of poses, or once for "
            "each in their order; without it the files show it, or it is asked for.",
            metavar="NAME",
        ),
    ] = None
    target: Annotated[
        list[str] | None,
        _poses(
            help="Name of the ball or reflector on the flange, once or for each file as well.",
            metavar="NAME",
        ),
    ] = None
