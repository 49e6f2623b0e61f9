"""`ballbar correct` for programs: every target of a program for the identified robot.

An axis target is corrected as it is. A cartesian target stands for the joints that the nominal
robot has there in the configuration that it states; these are corrected, and the target becomes the
pose of the nominal robot with the corrected joints, since it is the nominal robot that the
controller computes with.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.descriptions import ProgramLanguage, Robot
from ballbar.cell.errors import InputError
from ballbar.cell.files import write_new_together
from ballbar.cell.foreign_text import printable
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.inverse import refine_reachable
from ballbar.cell.number_text import significant_text
from ballbar.cell.payload import Payload
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes
from ballbar.cell.rotation import quat_wxyz
from ballbar.compensation.configurations import axes_of_pose, configuration_changes
from ballbar.compensation.frames import (
    FrameOptions,
    angles_near,
    pose_of_angles,
    pose_of_quaternion,
)
from ballbar.compensation.krl import read_krl
from ballbar.compensation.pdl2 import read_pdl2
from ballbar.compensation.program_source import ProgramTarget, RobotProgram, refuse
from ballbar.compensation.program_text import Number, ProgramError, number_text, rewritten
from ballbar.compensation.rapid import read_rapid
from ballbar.compensation.targets_file import corrected_joints
from ballbar.export.result import Result
from ballbar.ident.robot.inverse_calibration import CorrectedTargets, TargetError
from ballbar.units import MM, MRAD

T = TypeVar("T")
WRITTEN = 1e-11  # [rad] last step to the axes that a text stands for
SHOWN = 10  # targets of the largest changes in the report


@dataclass(frozen=True, eq=False)
class CorrectedProgram:
    """A program for the identified robot."""

    program: RobotProgram
    text: str
    corrected: CorrectedTargets  # of all targets, in the order of the program
    q: Array  # (N, J) [rad] nominal targets
    axis_changes: Array  # (N, J) [rad]
    notes: tuple[str, ...]


def correct_program(program: RobotProgram, result: Result) -> CorrectedProgram:
    """Corrects every target. Raises InputError naming the lines of those that cannot be.

    So it does for a program in another language than that of the robot's controller.
    """
    robot, language = result.robot, LANGUAGES[program.path.suffix.lower()]
    if robot.program_language not in {None, language}:
        raise InputError(
            f"{program.path}: nothing was written. The program is {language.upper()} by its "
            f"ending, and {robot.title} takes {str(robot.program_language).upper()} "
            "(program_language of its file). Is it the result of another robot?"
        )
    axes = _of_targets(program, lambda k: _axes(program.targets[k], robot))
    q = controller_to_joints(robot, np.radians(np.array(axes).reshape(-1, robot.joints)))
    corrected, notes = _corrected(program, result, q)
    before, after = (np.degrees(joints_to_axes(robot, angles)) for angles in (q, corrected.q))

    def changes_of(k: int) -> tuple[list[tuple[Number, str]], list[tuple[Number, str]]]:
        target = program.targets[k]
        numbers = _numbers(robot, target, before[k], after[k])
        written = _axes_as_written(robot, target, numbers, after[k])
        return numbers, configuration_changes(robot, target, before[k], written)

    changes = _of_targets(program, changes_of)
    return CorrectedProgram(
        program=program,
        text=rewritten(program.text, [c for both in changes for part in both for c in part]),
        corrected=corrected,
        q=q,
        axis_changes=np.radians(after - before),
        notes=(
            *program.notes,
            *notes,
            *(
                f"{program.path.name}:{number.line}: configuration {number.text} becomes {text}, "
                "since an axis passes a limit of it"
                for _, configured in changes
                for number, text in configured
            ),
        ),
    )


def _of_targets(program: RobotProgram, compute: Callable[[int], T]) -> list[T]:
    """A value of each target. Raises InputError naming the lines of those that have none."""
    values, faults = [], []
    for k in range(len(program.targets)):
        try:
            values.append(compute(k))
        except ProgramError as fault:
            faults.append((fault.line, fault.why))
    refuse(program.path, faults)
    return values


def _axes(target: ProgramTarget, robot: Robot) -> Array:
    values = [number.value for number in target.numbers]
    if target.rotation is None:
        if len(values) != robot.joints:
            raise ProgramError(
                target.line, f"{target.name}: {len(values)} axes, {robot.title} has {robot.joints}"
            )
        return np.array(values)
    if robot.joints != 6:
        raise ProgramError(
            target.line, f"{target.name}: cartesian targets are corrected for six axes alone"
        )
    try:
        flange = _flange(target, values)
    except ValueError as error:
        raise ProgramError(target.line, f"{target.name}: {error}") from None
    return axes_of_pose(robot, flange, target)


def _flange(target: ProgramTarget, values: Sequence[float]) -> Array:
    """(4, 4) of the flange for position [mm] and rotation of a target, base frame.

    Raises ValueError for a quaternion that is far from unit.
    """
    pose = (
        pose_of_quaternion(values[:3], values[3:])
        if target.rotation == "quaternion"
        else pose_of_angles(values)
    )
    return np.asarray(target.setup.frame @ pose @ np.linalg.inv(target.setup.tool))


def _corrected(
    program: RobotProgram, result: Result, q: Array
) -> tuple[CorrectedTargets, list[str]]:
    """Corrected targets, and what was taken as given; targets of one payload go together."""
    parts: dict[tuple[float, ...], list[int]] = {}
    for k, target in enumerate(program.targets):
        parts.setdefault(target.setup.load, []).append(k)
    columns = [np.empty((len(q), q.shape[1])), *(np.empty(len(q)) for _ in range(4))]
    faults: list[tuple[int, str]] = []
    for key, rows in parts.items():
        payload = Payload(key[0], np.array(key[1:])) if key else None
        try:
            part = corrected_joints(result, q[rows], payload)
        except TargetError as error:
            named = [(program.targets[rows[k]], why) for k, why in error.faults.items()]
            faults += [(target.line, f"{target.name}: {why}") for target, why in named]
            continue
        for array, values in zip(columns, vars(part).values(), strict=True):
            array[rows] = values
    refuse(program.path, faults)
    return CorrectedTargets(*columns), _payload_notes(program, result, parts)


def _payload_notes(
    program: RobotProgram, result: Result, parts: dict[tuple[float, ...], list[int]]
) -> list[str]:
    if result.cell is None:
        return ["sag is that with the payload of the measurement"] if any(parts) else []
    identified = result.calibration.file.corrections
    if "unit_weights" in identified and any(parts):
        return ["sag is that with the payload of the recording: the robot's file has no masses"]
    if () not in parts or "joint_compliance" not in identified:
        return []
    tools = sorted({program.targets[k].setup.tool_name for k in parts[()]} - {""})
    of_tools = f" of {', '.join(tools)}" if tools else ""
    return [
        f"the payload{of_tools} is not known and was taken for that of the recording "
        f"({significant_text(result.cell.plate.mass)} kg); state it by --payload"
    ]


def _numbers(
    robot: Robot, target: ProgramTarget, before: Array, after: Array
) -> list[tuple[Number, str]]:
    """The target's numbers for axis angles (J,) [deg] before and after the correction."""
    if target.rotation is None:
        values, units = [before, after], ["deg"] * robot.joints
    else:
        given = [number.value for number in target.numbers[3:]]
        values = [_pose_values(robot, target, axes, given) for axes in (before, after)]
        units = ["mm"] * 3 + ["1" if target.rotation == "quaternion" else "deg"] * len(given)
    texts = (
        number_text(number, float(old), float(new), unit)
        for number, old, new, unit in zip(target.numbers, *values, units, strict=True)
    )
    return list(zip(target.numbers, texts, strict=True))


def _axes_as_written(
    robot: Robot, target: ProgramTarget, numbers: Sequence[tuple[Number, str]], after: Array
) -> Array:
    """(J,) [deg] axis angles that the nominal robot has at a target's new text.

    At zero the last digit decides the sign that the controller finds. after : (J,) [deg] without
    rounding.
    """
    if target.rotation is None:
        return after
    values = [replace(number, text=text).value for number, text in numbers]
    start = controller_to_joints(robot, np.radians(after))[None]
    pose = _flange(target, values)[None]
    q, reached = refine_reachable(nominal_chain(robot), start, pose, tolerance=WRITTEN)
    return np.asarray(np.degrees(joints_to_axes(robot, q))[0]) if reached[0] else after


def _pose_values(robot: Robot, target: ProgramTarget, axes: Array, given: Sequence[float]) -> Array:
    """Position [mm] and rotation of the target at axis angles (J,) [deg] of the nominal robot."""
    q = controller_to_joints(robot, np.radians(axes))[None]
    flange = forward(nominal_chain(robot), q).poses()[0]
    pose = np.linalg.solve(target.setup.frame, flange @ target.setup.tool)
    if target.rotation == "zyx":
        return np.concatenate((MM * pose[:3, 3], angles_near(pose, given)))
    quaternion = quat_wxyz(pose[:3, :3])
    sign = np.sign(quaternion @ given) or 1.0
    return np.concatenate((MM * pose[:3, 3], sign * quaternion))


def is_program(path: Path) -> bool:
    """Whether a file is a program, by its ending, rather than a table."""
    return path.suffix.lower() in LANGUAGES


def read_programs(path: Path, options: FrameOptions) -> list[RobotProgram]:
    """A program as its files: one, or the .src and .dat files of KRL.

    Raises InputError naming the lines that are not understood.
    """
    return READERS[LANGUAGES[path.suffix.lower()]](path, options)


def write_programs(out: Path, programs: Sequence[CorrectedProgram]) -> list[Path]:
    """Writes corrected programs to new files, of several with the endings that they had.

    Raises InputError, and writes none, if one of the files exists. If one cannot be written, such
    as on a full disk, the others are removed.
    """
    paths = (
        [out] if len(programs) == 1 else [out.with_suffix(p.program.path.suffix) for p in programs]
    )
    texts = (program.text.encode("latin-1") for program in programs)
    write_new_together(dict(zip(paths, texts, strict=True)))
    return paths


def _target_data(file: CorrectedProgram, k: int) -> dict[str, object]:
    target, corrected = file.program.targets[k], file.corrected
    return {
        "file": file.program.path.name,
        "name": target.name,
        "line": target.line,
        "position_error_m": float(corrected.position_before[k]),
        "angle_error_rad": float(corrected.angle_before[k]),
        "left_in_the_model_m": float(corrected.position_after[k]),
        "axis_correction_rad": file.axis_changes[k].tolist(),
    }


def correct_and_write_programs(
    path: Path, result: Result, out: Path, options: FrameOptions
) -> tuple[dict[str, object], list[str]]:
    """Corrects a program and writes it to new files.

    Returns the JSON of `correct`, in SI units, and lines of text. Raises InputError as the
    functions above.
    """
    programs = [correct_program(program, result) for program in read_programs(path, options)]
    written = [str(file) for file in write_programs(out, programs)]
    data: dict[str, object] = {
        "files": written,
        "source_sha256": result.sha256,
        "targets": [
            _target_data(file, k) for file in programs for k in range(len(file.program.targets))
        ],
        "notes": [note for file in programs for note in file.notes],
    }
    wrote = f"Wrote {', '.join(written)}. Run it slowly the first time."
    return data, [*program_lines(programs), wrote]


def program_lines(programs: Sequence[CorrectedProgram]) -> list[str]:
    """Lines of text: how many, the largest changes as a table, and what was taken as given."""
    rows = [
        (float(file.corrected.position_before[k]), k, file)
        for file in programs
        for k in range(len(file.program.targets))
    ]
    rows.sort(key=lambda row: -row[0])
    table = []
    for position, k, file in rows[:SHOWN]:
        target, angle = file.program.targets[k], float(file.corrected.angle_before[k])
        change = float(np.degrees(np.abs(file.axis_changes[k]).max()))
        table.append(
            f"{printable(target.name, ''):20s} {f'{file.program.path.name}:{target.line}':24s} "
            f"{position * MM:8.3f} {angle * MRAD:8.3f} {change:8.3f}"
        )
    head = f"{'largest changes':20s} {'line':24s} {'mm':>8s} {'mrad':>8s} {'axis deg':>8s}"
    return [
        f"{len(rows)} targets corrected",
        *([head, *table] if rows else []),
        *(f"care: {note}" for file in programs for note in file.notes),
    ]


LANGUAGES: dict[str, ProgramLanguage] = {
    **dict.fromkeys((".mod", ".modx", ".sys", ".prg"), "rapid"),
    **dict.fromkeys((".src", ".dat"), "krl"),
    ".pdl": "pdl2",
}
READERS: dict[ProgramLanguage, Callable[[Path, FrameOptions], list[RobotProgram]]] = {
    "rapid": read_rapid,
    "krl": read_krl,
    "pdl2": read_pdl2,
}
