"""Other contents that the columns of the logs may have, and how well each agrees with the motion.

Encoders: any order of the columns, and other line counts. The ratio of a line count follows from
the angle that the robot's pose gives: `turning = arg(x + i y)` and `tilting = acos z` of the
direction (x, y, z) that a gimbal holds, compared by their speeds at all lags with the gain free.
Robot: the mistakes of ballbar.ident.causes.robot_log. All are judged by
ballbar.ident.causes.agreement.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import Geometry
from ballbar.ident.causes.agreement import (
    GIMBALS,
    SPHERE_ROWS,
    Gimbal,
    LoggedMotion,
    ToolPath,
    left,
    left_of,
    tool_path,
)
from ballbar.ident.causes.robot_log import other_angles
from ballbar.ident.start.speed_scan import scan_speeds

CANDIDATES = 12  # of the robot's columns that are compared with the encoders
MUST_OVERLAP = 10.0  # [s] to compare speeds
SAME_SCALE = 0.01  # ratio of angles beyond which a line count is wrong
NEARLY = 0.1  # of the largest error of a ratio, or of a doubling: as well as ratios are known
# Unexplained share above which ratios that are no powers of two are no line counts: where a short
# arc leaves the centre of the sphere open, sound encoders have any, and leave 0.05 to 0.11 with
# them. Unlike ratios must leave far less than as declared: there 0.03 of 0.12 was left with two.
ANYTHING, FAR_LESS = 0.03, 0.1
LEAST_SCALE = 1e-3  # smaller ratios are of encoders that stand still
MOVES = 0.1  # [rad] a path for calibration turns some joint by more


@dataclass(frozen=True)
class ColumnReading:
    """One way to read the columns, and what it leaves unexplained."""

    cause: str  # what would be wrong with the files
    remedy: str
    left: float  # unexplained share of the rod's motion
    rms: float  # [m] of the tool's distance from its sphere
    remark: str = ""  # to the evidence


def encoder_orders(motion: LoggedMotion, path: ToolPath) -> list[ColumnReading]:
    """Every other order of the encoder columns."""
    directions = {i: path.directions[i] for i, _ in motion.gimbals}
    if len(motion.encoders) == 2:  # of which gimbal they are, may be wrong too
        directions = path.directions
    gimbals = {
        (i, j, turning): Gimbal(motion.column(i), motion.column(j), direction, motion.step)
        for i, j in permutations(motion.encoders, 2)
        for turning, direction in directions.items()
    }
    declared = tuple(joint for pair in motion.gimbals for joint in pair)
    readings = []
    for order in permutations(motion.encoders, len(declared)):
        pairs = list(zip(order[::2], order[1::2], motion.gimbals, strict=True))
        share = left([gimbals[i, j, turning] for i, j, (turning, _) in pairs])
        held = dict(zip(declared, order, strict=True))
        if any(joint != column for joint, column in held.items()):
            readings.append(_ordered(held, share, path.rms))
    return [*readings, *(_other_gimbal(motion, path, gimbals) if len(motion.encoders) == 2 else ())]


def _other_gimbal(
    motion: LoggedMotion, path: ToolPath, gimbals: Mapping[tuple[int, int, int], Gimbal]
) -> Iterator[ColumnReading]:
    """Two encoders taken for those of the other gimbal, in both orders."""
    (i, j), (other,) = motion.gimbals[0], set(GIMBALS.values()) - {*motion.gimbals}
    for a, b in ((i, j), (j, i)):
        cause = f"the encoders b{a} and b{b} are those of b{other[0]} and b{other[1]}"
        share = left([gimbals[a, b, other[0]]])
        yield ColumnReading(cause, "Name them so in recording.yaml", share, path.rms)


def _ordered(held: dict[int, int], share: float, rms: float) -> ColumnReading:
    """held : column that holds a joint's readings, by joint."""
    moved = {joint: column for joint, column in held.items() if joint != column}
    if len(moved) == 2 and set(moved) == set(moved.values()):
        i, j = sorted(moved)
        cause = f"the columns of encoders b{i} and b{j} are exchanged"
    else:
        pairs = (f"b{joint} in that of b{column}" for joint, column in sorted(moved.items()))
        cause = f"the encoder columns are in another order: {', '.join(pairs)}"
    return ColumnReading(cause, "Correct `column` of these encoders in recording.yaml", share, rms)


def encoder_scales(motion: LoggedMotion, path: ToolPath) -> list[ColumnReading]:
    """The encoders with line counts by which they turn as far as the robot's pose says; or none."""
    ratios = _ratios(motion, path)
    off = {joint: abs(ratio - 1.0) for joint, ratio in ratios.items()}
    accuracy = max(SAME_SCALE, NEARLY * max(off.values(), default=0.0))
    wrong = {joint: ratio for joint, ratio in sorted(ratios.items()) if off[joint] > accuracy}
    if min(wrong.values(), default=0.0) < LEAST_SCALE:
        return []
    scale = np.array([wrong.get(joint, 1.0) for joint in motion.encoders])
    share = left_of(replace(motion, readings=motion.readings / scale), path)
    doublings = np.log2(list(wrong.values()))
    whole = np.rint(doublings)
    interpolation = (whole != 0.0).all() and np.abs(doublings - whole).max() <= NEARLY
    if not interpolation:
        equal = np.ptp(list(wrong.values())) <= accuracy  # as of encoders of one kind
        most = ANYTHING if equal else min(ANYTHING, FAR_LESS * left_of(motion, path))
        if share > most:
            return []
    names = " and ".join(f"b{j}" for j in wrong)
    factors = ", ".join(f"b{j} {ratio:.3f}" for j, ratio in wrong.items())
    return [
        ColumnReading(
            f"the line count of encoder {names} is wrong",
            f"Multiply `lines` in recording.yaml ({factors}), or correct `bits`, which count as "
            "powers of two",
            share,
            path.rms,
            f"; angle of the encoder over that of the robot's pose: {factors}",
        )
    ]


def _ratios(motion: LoggedMotion, path: ToolPath) -> dict[int, float]:
    """Angle of an encoder over that of the robot's pose, by joint; nothing where no lag fits."""
    joints = [joint for pair in motion.gimbals for joint in pair]
    poses = np.stack([a for i, _ in motion.gimbals for a in _angles(path.directions[i])], axis=1)
    readings = np.stack([motion.column(joint) for joint in joints], axis=1)
    least = round(MUST_OVERLAP / motion.step)
    speeds = _speeds(poses), _speeds(readings)
    pairs = [(k, k) for k in range(len(joints))]
    scan = scan_speeds(*speeds, pairs, least=least, paired=True)
    if not np.isfinite(scan.score).any():
        return {}
    lag = int(scan.lags[np.argmax(scan.score)])
    first, last = max(0, -lag), min(len(readings), len(poses) - lag)
    a, b = poses[first + lag : last + lag], readings[first:last]
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    moving = np.maximum((a * a).sum(axis=0), 1e-300)
    return dict(zip(joints, np.abs((a * b).sum(axis=0) / moving).tolist(), strict=True))


def _angles(direction: Array) -> tuple[Array, Array]:
    """(N,) [rad] turning and tilting angle of unit vectors (N, 3)."""
    x, y, z = direction.T
    return np.unwrap(np.arctan2(y, x)), np.arccos(np.clip(z, -1.0, 1.0))


def _speeds(angles: Array) -> Array:
    """(N, C) speeds of angles (N, C) over their rms."""
    speed = np.gradient(angles, axis=0)
    return np.asarray(speed / np.maximum(np.sqrt((speed * speed).mean(axis=0)), 1e-12))


def _distance(nominal: Geometry, q: Array) -> float:
    """[m] rms of the tool from its best sphere at q (N, J) [rad]; infinite where that says nothing.

    A short path is on many spheres, and some joints hardly move the tool.
    """
    if np.ptp(q, axis=0).max() < MOVES:
        return np.inf
    try:
        return tool_path(nominal, q).rms
    except ValueError:
        return np.inf


def robot_columns(
    robot: Robot, nominal: Geometry, motion: LoggedMotion, declared: float
) -> list[ColumnReading]:
    """The robot's log with each mistake of ballbar.ident.causes.robot_log corrected.

    declared : [m] rms distance of the tool from its sphere as logged. Only what does not leave it
    further away is compared with the encoders.
    """
    some = motion.q[:: 1 + len(motion.q) // SPHERE_ROWS]
    distances = (
        (_distance(nominal, mistake.joints(some)), mistake) for mistake in other_angles(robot)
    )
    spheres = [(rms, mistake) for rms, mistake in distances if rms <= 1.5 * declared + 1e-3]
    readings = []
    for _, mistake in sorted(spheres, key=lambda sphere: sphere[0])[:CANDIDATES]:
        path = tool_path(nominal, mistake.joints(motion.q))
        share = left_of(motion, path) if motion.gimbals else path.rms / nominal["bd3"]
        remedy = "Correct the columns of the robot's log, or its dialect"
        readings.append(ColumnReading(mistake.cause, remedy, share, path.rms))
    return readings
