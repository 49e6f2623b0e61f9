"""Joint offsets alone, for controllers and drivers that take nothing else.

The offsets are not the identified zeros: they bring the nominal robot nearest to the identified one
over the fitted ranges, sag and backlash included, its base and its tool placed again. What they
leave is stated. Zeros of axes that only turn the base or the tool stay as they are.

Files: LeRobot's calibration (huggingface/lerobot, src/lerobot/motors/motors_bus.py, feetech.py) and
the offsets of robot_calibration (mikeferguson/robot_calibration, src/optimization/offsets.cpp).
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.errors import InputError
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.export.result import Result, number
from ballbar.ident.estimator.build_unknowns import arm_parameters

LEVER = 0.1  # [m] from the tool to points beside it, which tell its orientation
POSES = 200
TICKS = 4096  # a turn of a Feetech motor
LARGEST = 2047  # ticks of its offset: sign and eleven bits
OFFSET_FILES = (".json", ".yaml")
_MOTOR = {"id", "drive_mode", "homing_offset", "range_min", "range_max"}
_LINE = re.compile(r"^(\s*)([\w./-]+)(\s*:\s*)(\S+)(.*)$")


@dataclass(frozen=True, eq=False)
class Offsets:
    """Offsets of the controller's axes, and mean TCP errors against the identified robot."""

    axes: Array  # (J,) [rad] to add to the shown angles
    nominal: float  # [m] of the nominal robot
    left: float  # [m] with the offsets

    @property
    def sentence(self) -> str:
        """A sentence on the error that they leave."""
        shown = ", ".join(f"{angle:.3f}" for angle in np.rad2deg(self.axes))
        return (
            f"Offsets alone, {shown} deg: against the identified robot the TCP error is "
            f"{self.left * 1e3:.3f} mm in place of {self.nominal * 1e3:.3f} mm (means over the "
            "fitted ranges, base and tool placed again)"
        )


def joint_offsets(result: Result) -> Offsets:
    """The offsets that bring the nominal robot nearest to the identified one."""
    identified = result.calibration.identified_robot(next(iter(result.calibration.targets), None))
    poses, nominal = identified.workspace()[:POSES], result.nominal
    tool = identified.tool_matrix[:3, 3]
    points = tool + LEVER * np.vstack((np.zeros(3), np.eye(3)[:2]))
    ends = identified.ends(poses)
    wanted = _placed(ends[:, :3, :3], ends[:, :3, 3], points)
    free = [p.row for p in arm_parameters(result.robot) if p.kind == "theta"]

    def off(x: Array) -> Array:
        """(K, 3, 3) [m] of points, with offsets, then base and tool (6,) each."""
        q = poses.copy()
        q[:, free] += x[12:]
        frames = forward(nominal, q).poses()
        turns = matrix_from_rotvec(x[[[3, 9], [4, 10], [5, 11]]]).transpose(2, 0, 1)
        held = (points - tool) @ turns[1].T + tool + x[6:9]
        placed = _placed(frames[:, :3, :3], frames[:, :3, 3], held) @ turns[0].T + x[:3]
        return np.asarray(placed - wanted)

    def error(count: int) -> tuple[Array, float]:
        rest = np.zeros(12 + len(free) - count)

        def residual(x: Array) -> Array:
            return off(np.append(x, rest)).ravel()

        x = np.append(least_squares(residual, np.zeros(count)).x, rest)
        return x, float(np.linalg.norm(off(x)[:, 0], axis=1).mean())

    _, before = error(12)
    x, after = error(12 + len(free))
    joints = np.zeros(result.robot.joints)
    joints[free] = x[12:]
    return Offsets(joints @ result.robot.joint_to_axis, before, after)


def _placed(rotation: Array, origin: Array, points: Array) -> Array:
    """(N, P, 3) points (P, 3) of frames."""
    return np.asarray(np.einsum("nij,pj->npi", rotation, points) + origin[:, None])


def offsets_into(result: Result, file: Path, joints: list[str]) -> tuple[bytes, list[str]]:
    """A file of offsets with those of the result, and lines of text about it.

    file : LeRobot's .json, or robot_calibration's .yaml with a line `joint: offset` for each axis.
    joints : names of the axes from base to tip; by default the first ones of the file.

    Raises InputError for a file that is neither, or that lacks an axis.
    """
    if not file.is_file():
        raise InputError(f"{file}: no such file. Name the robot's file of offsets.")
    text = file.read_text("utf-8", errors="replace")
    offsets = joint_offsets(result)
    write = _lerobot if file.suffix == ".json" else _robot_calibration
    content, lines = write(text, str(file), joints, offsets)
    return content.encode(), [offsets.sentence, *lines]


def _lerobot(text: str, source: str, joints: list[str], offsets: Offsets) -> tuple[str, list[str]]:
    """Position = actual - homing_offset, and an angle counts from the middle of the range.

    The middle stays; both ends move inwards by the offset, so that neither is behind a stop.
    """
    try:
        motors: Any = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"{source}: not JSON ({error}).") from None
    if not isinstance(motors, dict) or not all(
        isinstance(m, dict) and set(m) == _MOTOR and all(type(v) is int for v in m.values())
        for m in motors.values()
    ):
        wanted = ", ".join(sorted(_MOTOR))
        raise InputError(f"{source}: not a calibration of LeRobot: each motor has {wanted}.")
    changed = []
    for name, angle in zip(
        _named(list(motors), source, joints, offsets), offsets.axes, strict=True
    ):
        motor = motors[name]
        if motor["drive_mode"]:
            raise InputError(f"{source}: {name} has a drive_mode of 1; arms of LeRobot have 0.")
        ticks = round(angle / (2.0 * np.pi) * TICKS)
        motor["homing_offset"] -= ticks
        if abs(motor["homing_offset"]) > LARGEST:
            raise InputError(
                f"{source}: {name} would have an offset of {motor['homing_offset']} ticks, more "
                f"than the {LARGEST} that a motor holds. Mount its horn again."
            )
        motor["range_min"] += abs(ticks)
        motor["range_max"] -= abs(ticks)
        changed.append(f"{name} {-ticks:+d}")
    return json.dumps(motors, indent=4), [f"homing_offset, ticks: {', '.join(changed)}"]


def _robot_calibration(
    text: str, source: str, joints: list[str], offsets: Offsets
) -> tuple[str, list[str]]:
    """Lines `joint: offset` [rad]: joint = shown + offset. Offsets in the file add to the new."""
    lines = text.splitlines()
    listed = {m[2]: (k, m) for k, line in enumerate(lines) if (m := _LINE.match(line))}
    for name, angle in zip(
        _named(list(listed), source, joints, offsets), offsets.axes, strict=True
    ):
        k, match = listed[name]
        try:
            value = float(match[4]) + float(angle)
        except ValueError:
            raise InputError(f"{source}: {name}: expected an offset, found {match[4]}.") from None
        lines[k] = f"{match[1]}{match[2]}{match[3]}{number(value)}{match[5]}"
    return "\n".join(lines) + "\n", []


def _named(names: list[str], source: str, joints: list[str], offsets: Offsets) -> list[str]:
    """The axes' names in a file."""
    count = len(offsets.axes)
    chosen = joints or names[:count]
    missing = [name for name in chosen if name not in names]
    if missing or len(chosen) != count:
        raise InputError(
            f"{source}: it names {', '.join(names) or 'no joint'}; name the {count} axes of the "
            "robot among them, from base to tip, with --joints a,b,c."
        )
    return chosen
