"""`ballbar new --poses`: makes a folder with poses.yaml from a table of still poses.

What names and numbers of the table show is taken and printed: columns of the joint angles, of the
measured values and of their deviations, units, the convention of rotations. What they do not show
is a question, and so is which seat and which target each of several files belongs to. An answer is
checked at once, and all files are read once before the folder is made.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml

from acquisition.declared_columns import AXES_OF
from acquisition.faults.nominal_robot import orientations
from acquisition.faults.table_angles import joint_angles
from acquisition.formats.table_file import FileKind, pose_text
from acquisition.measured_values import METRES
from acquisition.pose_tables import PoseImport, import_poses
from acquisition.pose_times import pose_stamps
from acquisition.table.quantities import read_rows
from acquisition.table.text import LogText
from ballbar.recordings.new_seats import KEYS, RAW, Name, checked_name, named_places
from ballbar.recordings.proposals import (
    ColumnNames,
    angle_unit,
    column_names,
    column_values,
    joint_columns,
    length_columns,
    length_unit,
    named_column,
    position_columns,
    rotation_columns,
    sigma_columns,
    stated_unit,
)
from ballbar.recordings.questions import Ask, answer
from cell.arrays import Array
from cell.descriptions import Robot
from cell.errors import InputError, LogError
from cell.files import copied_description, new_folder, write_whole
from cell.instrument import Instrument
from cell.load import instrument_names, load_instrument, load_robot, robot_names
from cell.pose_file import AngleUnit, JointColumns, LengthUnit, PoseTime
from cell.poses import COLUMNS

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class PoseAnswers:
    """Answers that the user gave as options; None where the table shows it, or a question is."""

    robot: str | None = None
    instrument: str | None = None
    joints: str | None = None  # columns, separated by commas
    joint_unit: str | None = None
    values: str | None = None  # columns, separated by commas
    value_unit: str | None = None
    rotation: str | None = None
    angle_unit: str | None = None
    seat: Sequence[str] = ()  # one for all files, or one for each
    target: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class _Table:
    """A table, and who answers questions about it."""

    text: LogText
    kind: FileKind
    columns: ColumnNames
    ask: Ask

    def answer(
        self, given: str | None, question: str, proposal: str | None, check: Callable[[str], T]
    ) -> T:
        """The checked answer to a question about the table, as `questions.answer`."""
        return answer(given, f"{self.text.file}: {question}", proposal, check, self.ask)

    def names(self, count: int) -> Callable[[str], list[int | str]]:
        """A check of an answer that names `count` columns."""

        def check(reply: str) -> list[int | str]:
            written = [part.strip() for part in reply.split(",") if part.strip()]
            chosen: list[int | str] = [int(p) if p.isdigit() else p for p in written]
            if len(chosen) != count and not reply.startswith("re:"):
                raise InputError(
                    f"{reply!r}: {len(chosen)} columns, expected {count}, separated by commas."
                )
            if len(chosen) == count:
                column_values(self.text, self.kind, chosen)
            return chosen

        return check


def new_poses(
    folder: Path, tables: Sequence[Path], answers: PoseAnswers, ask: Ask
) -> tuple[PoseImport, str]:
    """Makes the folder with poses.yaml and copies of the tables; gives its poses and its text.

    tables : files, and folders of files. The first file answers for the others, which have the
    same columns; which seat and which target each of them belongs to is a question of its own.
    Raises InputError if the folder holds something, an answer is missing, or the tables cannot be
    read in the way that was answered; then nothing is left behind.
    """
    sources = _sources(tables)
    files = list(sources)
    with new_folder(folder) as aside:
        description, table = _description(sources[files[0]], answers, ask)
        given = (
            _given("seat", answers.seat, table, files),
            _given("target", answers.target, table, files),
        )
        for file, source in sources.items():
            (aside / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, aside / file)
        for key in ("robot", "instrument"):
            if description[key].endswith(".yaml"):
                description[key] = copied_description(aside, key, Path(description[key]))
        own: Sequence[Name | None] = files if len(files) > 1 else [None]
        places = zip(given[0] or own, given[1] or own, strict=True)
        text = _written(aside, description, table, dict(zip(files, places, strict=True)))
        read = import_poses(aside)
        if len(files) > 1 and None in given:
            named = named_places(read.table, files, given, ask)
            text = _written(aside, description, table, dict(zip(files, named, strict=True)))
            import_poses(aside)
    return import_poses(folder), text


def _sources(tables: Sequence[Path]) -> dict[str, Path]:
    """The files of tables and folders, by the name of their copy: as much of the path as differs.

    Raises InputError for an empty folder, and for a file that is named twice.
    """
    files = list[Path]()
    for table in tables:
        if not table.is_dir():
            files.append(table)
            continue
        content = sorted(file for file in table.rglob("[!.]*") if file.is_file())
        if not content:
            raise InputError(f"{table}: this folder holds no files. Name that of the tables.")
        files += content
    twice = [file for k, file in enumerate(files) if any(map(file.samefile, files[:k]))]
    if twice:
        raise InputError(f"{twice[0]} is named twice; name it once.")
    parts = [(file.parent.resolve() / file.name).parts for file in files]
    depth = next(k for k in count(1) if len({part[-k:] for part in parts}) == len(parts))
    return {RAW + "/".join(part[-depth:]): file for part, file in zip(parts, files, strict=True)}


def _given(
    key: str, names: Sequence[str], table: dict[str, Any], files: Sequence[str]
) -> Sequence[Name] | None:
    """Seats or targets of files: by the options, or by a column; None where neither says them.

    Raises InputError unless there is one name for all files, or one for each.
    """
    if len(names) not in (0, 1, len(files)):
        listed = ", ".join(file.removeprefix(RAW) for file in files)
        raise InputError(
            f"{len(names)} times --{key} for {len(files)} files: give it once for all, or once for "
            f"each in this order: {listed}."
        )
    if names:
        return [checked_name(name) for name in names] * (len(files) if len(names) == 1 else 1)
    return [table[key]] * len(files) if key in table else None


def _written(
    folder: Path,
    description: dict[str, Any],
    table: dict[str, Any],
    places: Mapping[str, tuple[Name | None, Name | None]],
) -> str:
    """Writes poses.yaml and gives its text; files of one seat and one target are in one table.

    places : seat and target by file; None is left out.
    """
    tables = list[dict[str, Any]]()
    for file, place in places.items():
        own = {key: name for key, name in zip(KEYS, place, strict=True) if name is not None}
        alike = [each for each in tables if all(each.get(key) == own.get(key) for key in KEYS)]
        if alike:
            alike[0]["files"].append(file)
        else:
            tables.append({"files": [file], **deepcopy(table), **deepcopy(own)})
    # Lists of columns on one line.
    text = yaml.safe_dump(
        {**description, "tables": tables, "notes": ""},
        sort_keys=False,
        allow_unicode=True,
        width=98,
        default_flow_style=None,
    )
    write_whole(folder / "poses.yaml", text.encode())
    return text


def _description(
    file: Path, answers: PoseAnswers, ask: Ask
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The head of poses.yaml, and what it says of a table beside its files."""
    text, kind = pose_text(file, file.name)
    table = _Table(text, kind, column_names(text), ask)
    robots, instruments = ", ".join(robot_names()), ", ".join(instrument_names())
    name, robot = table.answer(
        answers.robot, f"which robot? ({robots}, or a .yaml file)", None, _robot
    )
    measured_by, instrument = table.answer(
        answers.instrument, f"which instrument? ({instruments}, or a .yaml file)", None, _instrument
    )
    joints = _joints(table, robot, answers)
    declared = {"joints": joints, **_values(table, robot, instrument, joints, answers)}
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
        stamps, _ = pose_stamps(PoseTime(column=column), column, rows)
    except LogError:
        return False
    return stamps is not None


def _robot(reply: str) -> tuple[str, Robot]:
    return reply, load_robot(reply)


def _instrument(reply: str) -> tuple[str, Instrument]:
    return reply, load_instrument(reply)


def _joints(table: _Table, robot: Robot, answers: PoseAnswers) -> dict[str, Any]:
    """The joints of a table: columns and unit."""
    axes = int(robot.a.size)
    seen = joint_columns(table.columns, axes)
    if table.kind in AXES_OF and answers.joints is None and not seen:
        columns: list[int | str] = []
    else:
        given = answers.joints or (", ".join(seen[0]) if len(seen) == 1 else None)
        columns = table.answer(
            given,
            f"which {axes} columns hold the joint angles, in the order of the axes? Columns: "
            f"{table.columns.words}.",
            ", ".join(seen[0]) if seen else None,
            table.names(axes),
        )
    unit = stated_unit([str(column) for column in columns])
    if not columns or (columns[0] != "" and str(columns[0]).startswith("re:")):
        certain = None
    else:
        guess, sure = angle_unit(column_values(table.text, table.kind, columns))
        certain = unit if unit in get_args(AngleUnit) else guess if sure else None
        unit = certain or guess
    chosen = table.answer(
        answers.joint_unit or certain,
        "unit of the joint angles? (rad or deg)",
        unit,
        _one_of(get_args(AngleUnit)),
    )
    return {"columns": columns, "unit": chosen}


def _values(
    table: _Table,
    robot: Robot,
    instrument: Instrument,
    joints: dict[str, Any],
    answers: PoseAnswers,
) -> dict[str, Any]:
    """The values and sigma of a table; nothing of a socket."""
    measured = instrument.measured
    if measured == "socket":
        return {}
    used = [str(column) for column in joints["columns"]]
    if measured == "length":
        seen = length_columns(table.columns, used)
        what = "the length"
    else:
        seen = position_columns(table.columns, used)
        what = "x, y and z" if measured == "point" else "x, y, z and the rotation"
    if measured == "pose":
        seen = [(*xyz, *turn) for xyz in seen if (turn := rotation_columns(table.columns, xyz))]
    count = COLUMNS[measured]
    columns = table.answer(
        answers.values or (", ".join(seen[0]) if len(seen) == 1 else None),
        f"which columns hold {what}? A difference is written as `x_t - x_dif`. Columns: "
        f"{table.columns.words}.",
        ", ".join(seen[0]) if seen else None,
        _either(table.names(count), table.names(7)) if measured == "pose" else table.names(count),
    )
    q = joint_angles(robot, JointColumns(), *_joint_values(table, robot, joints))
    values: dict[str, Any] = {"columns": columns}
    values["unit"] = _length_unit(table, robot, q, columns, answers)
    if measured == "pose":
        values |= _rotation(table, robot, q, columns, values["unit"], answers)
    names = [str(column) for column in columns]
    sigma = sigma_columns(table.columns, names)
    return {"values": values, **({"sigma": {"columns": list(sigma)}} if sigma else {})}


def _joint_values(table: _Table, robot: Robot, joints: dict[str, Any]) -> tuple[Array, AngleUnit]:
    columns = joints["columns"] or [f"rax_{k + 1}" for k in range(int(robot.a.size))]
    return column_values(table.text, table.kind, columns), joints["unit"]


def _length_unit(
    table: _Table, robot: Robot, q: Array, columns: list[int | str], answers: PoseAnswers
) -> str:
    """The unit of lengths: stated by the names, or that in which points spread as the flange."""
    units = get_args(LengthUnit)
    names = [str(column) for column in columns]
    certain = stated_unit(names[:3])
    proposal = None
    if certain not in units:
        certain = None
        if len(columns) >= 3:
            points = column_values(table.text, table.kind, columns[:3])
            proposal = length_unit(robot, q, points) if len(points) == len(q) else None
    return table.answer(
        answers.value_unit or certain or proposal,
        f"unit of {', '.join(names[:3])}? ({', '.join(units)})",
        proposal,
        _one_of(units),
    )


def _rotation(
    table: _Table, robot: Robot, q: Array, columns: list[int | str], unit: str, answers: PoseAnswers
) -> dict[str, Any]:
    """Convention and unit of rotations: those with which they turn as the flange does.

    unit : of the positions.
    """
    raw = column_values(table.text, table.kind, columns)
    expected = None
    if len(raw) == len(q):
        expected = orientations(robot, q, METRES[unit] * raw[:, :3])
    seen = None if expected is None else expected.fitting(raw[:, 3:])
    convention = table.answer(
        answers.rotation or (seen[0] if seen else None),
        "convention of the rotation? (XYZ and the like about moving axes, xyz about fixed ones, "
        "rotvec, quat_wxyz, quat_xyzw)",
        None,
        str,
    )
    if convention.startswith("quat"):
        return {"rotation": convention}
    turned = table.answer(
        answers.angle_unit or (seen[1] if seen else None),
        "unit of the rotation's angles? (rad or deg)",
        None,
        _one_of(get_args(AngleUnit)),
    )
    return {"angle_unit": turned, "rotation": convention}


def _one_of(choices: Sequence[str]) -> Callable[[str], str]:
    """A check of an answer that is one of several words."""

    def check(reply: str) -> str:
        if reply.strip() not in choices:
            raise InputError(f"{reply!r} is none of {', '.join(choices)}.")
        return reply.strip()

    return check


def _either(first: Callable[[str], T], second: Callable[[str], T]) -> Callable[[str], T]:
    def check(reply: str) -> T:
        return (second if reply.count(",") == 6 else first)(reply)

    return check
