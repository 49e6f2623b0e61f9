"""Frames and payloads of a program that stand elsewhere: what the options of `correct` state.

    --tool NAME=X,Y,Z,A,B,C     mm and deg, frame of the tcp in that of the flange
    --frame NAME=X,Y,Z,A,B,C    of a work object or base in the robot's base frame
    --payload NAME=KG,X,Y,Z     kg and mm, centre of mass in the flange's frame

A is the turn about z, B about y', C about x''. Without NAME it holds for all that the program does
not declare itself. A tool is named by the program, or by its number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.payload import Payload

MM = 1e-3  # [m]


@dataclass(frozen=True, eq=False)
class FrameOptions:
    """Tools, frames and payloads beside the program, by lower-case name; "" for all others."""

    tools: dict[str, Array] = field(default_factory=dict)
    frames: dict[str, Array] = field(default_factory=dict)
    payloads: dict[str, Payload] = field(default_factory=dict)
    keep: frozenset[str] = frozenset()  # targets of other files, which stay as they are

    def tool(self, name: str) -> Array | None:
        return self.tools.get(name.lower(), self.tools.get(""))

    def frame(self, name: str) -> Array | None:
        return self.frames.get(name.lower(), self.frames.get(""))

    def payload(self, name: str) -> Payload | None:
        return self.payloads.get(name.lower(), self.payloads.get(""))


def frame_options(
    tools: Sequence[str], frames: Sequence[str], payloads: Sequence[str], keep: Sequence[str]
) -> FrameOptions:
    """The options from their texts. Raises InputError for one that is not understood."""

    def poses(option: str, texts: Sequence[str]) -> dict[str, Array]:
        named = [(name, _numbers(option, v, (6,), "X,Y,Z,A,B,C")) for name, v in map(_named, texts)]
        return {name: pose_of_angles(numbers) for name, numbers in named}

    return FrameOptions(
        tools=poses("--tool", tools),
        frames=poses("--frame", frames),
        payloads={name: _payload(values) for name, values in map(_named, payloads)},
        keep=frozenset(name.strip().lower() for text in keep for name in text.split(",")),
    )


def pose_of_quaternion(position_mm: Sequence[float], quaternion_wxyz: Sequence[float]) -> Array:
    """(4, 4) frame; the quaternion is normalised. Raises ValueError where it is far from unit."""
    w, *xyz = quaternion_wxyz
    if abs(float(np.linalg.norm(quaternion_wxyz)) - 1.0) > 0.01:
        raise ValueError("the quaternion has not unit length")
    return _placed(position_mm, Rotation.from_quat([*xyz, w]))


def pose_of_angles(values: Sequence[float]) -> Array:
    """(4, 4) frame of X, Y, Z [mm] and turns A, B, C [deg] about z, y', x''."""
    return _placed(values[:3], Rotation.from_euler("ZYX", values[3:], degrees=True))


def angles_near(pose: Array, previous: Sequence[float]) -> Array:
    """(3,) [deg] turns A, B, C of a frame, as near to previous ones as turns allow."""
    r, before = pose[:3, :3], np.array(previous, dtype=np.float64)
    cosine = float(np.hypot(r[0, 0], r[1, 0]))
    b = np.degrees(np.arctan2(-r[2, 0], cosine))
    if cosine < 1e-7:  # A and C turn about the same axis: A stays
        a = before[0]
        without_a = Rotation.from_euler("Z", -a, degrees=True).as_matrix() @ r
        options = np.array([[a, b, np.degrees(np.arctan2(-without_a[1, 2], without_a[1, 1]))]])
    else:
        a, c = np.degrees(np.arctan2(r[1, 0], r[0, 0])), np.degrees(np.arctan2(r[2, 1], r[2, 2]))
        options = np.array([[a, b, c], [a + 180.0, 180.0 - b, c + 180.0]])
    options -= 360.0 * np.round((options - before) / 360.0)
    return np.asarray(options[np.abs(options - before).max(axis=1).argmin()])


def payload_of(kilograms: float, centre_mm: Sequence[float]) -> Payload:
    """A payload with its centre in the flange's frame. Raises InputError where none is so."""
    return Payload(kilograms, MM * np.array(centre_mm, dtype=np.float64))


def _placed(position_mm: Sequence[float], rotation: Rotation) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.as_matrix(), MM * np.array(position_mm, dtype=np.float64)
    return pose


def _named(text: str) -> tuple[str, str]:
    name, equals, values = text.rpartition("=")
    return (name.strip().lower() if equals else ""), values


def _payload(values: str) -> Payload:
    kilograms, *centre = _numbers("--payload", values, (1, 4), "KG or KG,X,Y,Z")
    try:
        return payload_of(kilograms, centre or (0.0, 0.0, 0.0))
    except InputError as error:
        raise InputError(f"--payload {values}: {error}") from None


def _numbers(option: str, values: str, counts: tuple[int, ...], form: str) -> list[float]:
    try:
        numbers = [float(part) for part in values.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not np.isfinite(numbers).all():
        raise InputError(f"{option} {values}: expected [NAME=]{form}, in mm, deg and kg")
    return numbers
