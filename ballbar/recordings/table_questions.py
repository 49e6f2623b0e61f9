"""Questions of `ballbar new` about a table of still poses: the content of poses.yaml.

What names and numbers of the table show is taken and printed: columns of the joint angles, of the
measured values and of their deviations, units, the convention of rotations. What they do not show
is a question.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

from ballbar.acquisition.declared_columns import AXES_OF
from ballbar.acquisition.faults.nominal_robot import orientations
from ballbar.acquisition.faults.robot_angles import AngleReading
from ballbar.acquisition.formats.table_file import FileKind, pose_text
from ballbar.acquisition.pose_rows import pose_stamps
from ballbar.acquisition.table.quantities import read_rows
from ballbar.acquisition.table.text import LogText
from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError, LogError
from ballbar.cell.file_units import METRES, AngleUnit
from ballbar.cell.instruments.base import Instrument, Kind
from ballbar.cell.load import instrument_names, load_instrument, load_robot, robot_names
from ballbar.cell.pose_file import PoseTime
from ballbar.recordings.answers import Answers
from ballbar.recordings.proposals import (
    ColumnNames,
    angle_unit,
    column_names,
    column_values,
    joint_columns,
    length_unit,
    named_column,
    sigma_columns,
    stated_unit,
    value_columns,
)
from ballbar.recordings.questions import Ask, answer, loaded, one_of
from ballbar.recordings.seat_questions import KEYS
from ballbar.report.numbers import listed

T = TypeVar("T")
Columns = list[int | str]


@dataclass(frozen=True, eq=False)
class _Table:
    """A table, what the user answered by options, and who answers other questions about it."""

    text: LogText
    kind: FileKind
    columns: ColumnNames
    answers: Answers
    ask: Ask

    def answer(
        self, given: str | None, question: str, proposal: str | None, check: Callable[[str], T]
    ) -> T:
        """The checked answer to a question about the table, as `questions.answer`."""
        return answer(given, f"{self.text.file}: {question}", proposal, check, self.ask)

    def named_columns(
        self, given: str | None, question: str, seen: list[tuple[str, ...]], counts: tuple[int, ...]
    ) -> Columns:
        """Columns, one of `counts` many, that the user names; seen : those that are proposed.

        The only ones that are seen are taken without a question.
        """

        def check(reply: str) -> Columns:
            count = next((n for n in counts if reply.count(",") == n - 1), counts[0])
            written = [part.strip() for part in reply.split(",") if part.strip()]
            chosen: Columns = [int(p) if p.isdigit() else p for p in written]
            if len(chosen) != count and not reply.startswith("re:"):
                what = f"{len(chosen)} columns, expected {count}, separated by commas."
                raise InputError(f"{reply!r}: {what}")
            if len(chosen) == count:
                self.values(chosen)
            return chosen

        proposal = ", ".join(seen[0]) if seen else None
        given = given or (proposal if len(seen) == 1 else None)
        question = f"{question} Columns: {self.columns.words}."
        return self.answer(given, question, proposal, check)

    def values(self, columns: Columns) -> Array:
        """(N, C) numbers of columns in their own units, rows with empty fields left out."""
        return column_values(self.text, self.kind, columns)


def table_description(
    file: Path, answers: Answers, ask: Ask
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The head of poses.yaml, and what it says of a table beside its files."""
    text, kind = pose_text(file, file.name)
    table = _Table(text, kind, column_names(text), answers, ask)
    question = f"which robot? ({', '.join(robot_names())}, or a .yaml file)"
    name, robot = table.answer(answers.robot, question, None, loaded(load_robot))
    question = f"which instrument? ({', '.join(instrument_names())}, or a .yaml file)"
    known = loaded(load_instrument)
    measured_by, instrument = table.answer(answers.instrument, question, None, known)
    joints = _joints(table, robot)
    declared = {"joints": joints, **_values(table, robot, instrument, joints)}
    for key, pattern in zip(KEYS, (r"^(seat|station|setup)$", r"^(target|smr|ball)$"), strict=True):
        if column := named_column(table.columns, pattern):
            declared[key] = {"column": column}
    if (time := named_column(table.columns, r"time|stamp|date")) and _tells_time(table, time):
        declared["time"] = {"column": time}
    if temperature := named_column(table.columns, r"temp"):
        declared["temperature"] = {"column": temperature}
    head = {"schema": "ballbar-poses/1", "kind": "real", "robot": name, "instrument": measured_by}
    return head, declared


def _tells_time(table: _Table, column: str) -> bool:
    """Whether the stamps of a column show their form; a spreadsheet may have cut them."""
    try:
        rows = read_rows(table.text, table.kind, [column], [column])
        return pose_stamps(PoseTime(column=column), column, rows)[0] is not None
    except LogError:
        return False


def _joints(table: _Table, robot: Robot) -> dict[str, Any]:
    """The joints of a table: columns and unit."""
    axes, answers = robot.joints, table.answers
    seen, columns = joint_columns(table.columns, axes), Columns()
    if table.kind not in AXES_OF or answers.joints is not None or seen:
        question = f"which {axes} columns hold the joint angles, in the order of the axes?"
        columns = table.named_columns(answers.joints, question, seen, (axes,))
    unit, certain = stated_unit([str(column) for column in columns]), None
    if columns and not str(columns[0]).startswith("re:"):
        guess, sure = angle_unit(table.values(columns))
        certain = unit if unit in get_args(AngleUnit) else guess if sure else None
        unit = certain or guess
    question = "unit of the joint angles? (rad or deg)"
    check = one_of(*get_args(AngleUnit))
    chosen = table.answer(answers.joint_unit or certain, question, unit, check)
    return {"columns": columns, "unit": chosen}


def _values(
    table: _Table, robot: Robot, instrument: Instrument, joints: dict[str, Any]
) -> dict[str, Any]:
    """The values and sigma of a table; nothing of a socket."""
    if instrument.camera is not None:
        return {"pictures": _pictures(table)}
    kind, answers = instrument.kind, table.answers
    if not kind.columns:
        return {}
    seen = value_columns(table.columns, kind, [str(column) for column in joints["columns"]])
    question = f"which columns hold {_held(kind)}? A difference is written as `x_t - x_dif`."
    counts = (kind.columns, *((kind.columns + 1,) if kind.target_turns else ()))
    columns = table.named_columns(answers.values, question, seen, counts)
    logged = table.values(joints["columns"] or [f"rax_{k + 1}" for k in range(robot.joints)])
    q = AngleReading("axes", joints["unit"]).joints(robot, logged)
    values: dict[str, Any] = {"columns": columns}
    of_unit: dict[str, Columns] = {"m": [], "rad": []}
    for column, unit in zip(columns, kind.units, strict=False):  # a quaternion has one more
        of_unit[unit].append(column)
    if of_unit["m"]:
        values["unit"] = _length_unit(table, robot, q, of_unit["m"])
    if kind.target_turns:
        values |= _rotation(table, robot, q, columns, METRES[values["unit"]])
    elif of_unit["rad"]:
        values["angle_unit"] = _angle_unit(table, of_unit["rad"])
    sigma = sigma_columns(table.columns, [str(column) for column in columns])
    return {"values": values, **({"sigma": {"columns": list(sigma)}} if sigma else {})}


def _pictures(table: _Table) -> dict[str, Any]:
    """The corners of pictures: files of them and of their board, and where the camera is."""
    answers, known = table.answers, table.columns.names

    def existing(reply: str) -> str:
        if not Path(reply).is_file():
            raise InputError(f"{reply}: there is no such file.")
        return reply

    def named(reply: str) -> str:
        if reply not in known:
            raise InputError(f"{reply}: no column has this name.")
        return reply

    question = "which file holds the corners (image, corner, u, v)?"
    corners = table.answer(answers.corners, question, None, existing)
    board = table.answer(answers.board, "which file describes the board?", None, existing)
    image = named_column(table.columns, r"^(image|picture|photo)")
    question = f"which column names the picture? Columns: {table.columns.words}."
    place = "where is the camera, in the cell or on the flange? (cell or flange)"
    return {
        "corners": corners,
        "image": table.answer(image, question, None, named),
        "board": board,
        "camera": table.answer(answers.camera, place, None, one_of("cell", "flange")),
    }


def _held(kind: Kind) -> str:
    """Content of the columns of a kind's values, as a part of a question."""
    if kind.target_turns:
        return listed((*kind.names[:3], "the rotation"))
    return listed(kind.names) if kind.columns > 1 else f"the {kind.names[0]}"


def _length_unit(table: _Table, robot: Robot, q: Array, columns: Columns) -> str:
    """Unit of measured lengths; that of x, y and z is proposed by how far the robot moves."""
    names = [str(column) for column in columns]
    certain, proposal = stated_unit(names), None
    if certain not in METRES:
        certain = None
        if len(columns) == 3:
            points = table.values(columns)
            proposal = length_unit(robot, q, points) if len(points) == len(q) else None
    question = f"unit of {', '.join(names)}? ({', '.join(METRES)})"
    given = table.answers.value_unit or certain or proposal
    return table.answer(given, question, proposal, one_of(*METRES))


def _angle_unit(table: _Table, columns: Columns) -> str:
    """Unit of measured angles, which their range may tell as that of joint angles."""
    names = [str(column) for column in columns]
    stated, (guess, sure) = stated_unit(names), angle_unit(table.values(columns))
    check = one_of(*get_args(AngleUnit))
    certain = stated if stated in get_args(AngleUnit) else guess if sure else None
    question = f"unit of {', '.join(names)}? ({' or '.join(get_args(AngleUnit))})"
    return table.answer(table.answers.angle_unit or certain, question, certain or guess, check)


def _rotation(
    table: _Table, robot: Robot, q: Array, columns: Columns, length: float
) -> dict[str, Any]:
    """Convention and unit of rotations: those with which they turn as the flange does.

    length : [m] unit of the positions.
    """
    answers, raw = table.answers, table.values(columns)
    expected = orientations(robot, q, length * raw[:, :3]) if len(raw) == len(q) else None
    seen = None if expected is None else expected.fitting(raw[:, 3:])
    convention, unit = (seen[0], seen[1]) if seen else (None, None)
    question = (
        "convention of the rotation? (XYZ and the like about moving axes, xyz about fixed ones, "
        "rotvec, quat_wxyz, quat_xyzw)"
    )
    chosen = table.answer(answers.rotation or convention, question, None, str)
    if chosen.startswith("quat"):
        return {"rotation": chosen}
    question, check = "unit of the rotation's angles? (rad or deg)", one_of(*get_args(AngleUnit))
    turned = table.answer(answers.angle_unit or unit, question, None, check)
    return {"angle_unit": turned, "rotation": chosen}
