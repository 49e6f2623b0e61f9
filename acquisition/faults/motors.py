"""Logged robot angles to joint angles, and the checks that the numbers are what the dialect says: which angles, in which unit.

A dialect holds motor angles, the controller's axis angles or the DH model's joint angles, in rad or degrees. Units and sides
are never guessed and never converted silently. What a wrong one does to the numbers is known, though: degrees read as
radians put the axes 57 times too far, joint angles read as motor angles keep the robot within a degree of zero. What
contradicts the robot is refused, and every reading that would fit is named. What nobody can see in the numbers: motor radians
taken for axis degrees, or the other way, are off by a factor of two to three only (gear ratio over 57) and stay within all
limits; the residual of identification shows them.

Motor torques go with them to the gears' outputs.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from acquisition.flags import RowFlag
from acquisition.formats.dialect import Side
from acquisition.report import Finding, finding
from acquisition.table.table import Table
from cell.descriptions import Robot
from cell.errors import LogError
from cell.robot_angles import controller_to_joints, joints_to_axes, motors_to_joints

Array = NDArray[np.float64]
Unit = Literal["rad", "deg"]

FAR = (
    0.2  # of an axis's range beyond its limits: no calibration offset is as large, a wrong unit is
)
OVERSPEED = 2.0  # times the axis's greatest speed: beyond it lies no motion
MOVES = 0.1  # [rad] a path for calibration turns some axis by more
HEAVY = 20.0  # times the arm's own weight at full reach: no motor bears more at its gear's output, one in another unit does
SENTINEL = 8.9e9  # controllers write 9E9 for an axis that is not there

OUTLIER_ROWS = 5  # in a median over so many, two are outvoted
_MANY = 0.01  # of the rows: a single bad number makes one or two rows too fast or too far, a wrong unit makes many
_MEANT: dict[tuple[Side, Unit], str] = {
    ("motors", "rad"): "motor angles in rad",
    ("motors", "deg"): "motor angles in degrees",
    ("axes", "rad"): "axis angles in rad",
    ("axes", "deg"): "axis angles in degrees",
    ("joints", "rad"): "joint angles in rad",
    ("joints", "deg"): "joint angles in degrees",
}


def to_joints(robot: Robot, angles: Array, side: Side, unit: Unit) -> Array:
    """(N, 6) [rad] joint angles of logged angles (N, 6) of that side and unit."""
    angles = np.deg2rad(angles) if unit == "deg" else angles
    match side:
        case "motors":
            return motors_to_joints(robot, angles)
        case "axes":
            return controller_to_joints(robot, angles)
        case "joints":
            return np.asarray(angles, dtype=np.float64)


def refuse_other_angles(
    robot: Robot,
    table: Table,
    t: Array,
    angles: Array,
    joints: Array,
    axes: Array,
    *,
    side: Side,
    unit: Unit,
    sound: NDArray[np.bool_],
) -> None:
    """Raises LogError if the logged angles (N, 6) cannot be what they are declared to be.

    t : (N,) [s]. joints, axes : (N, 6) [rad] what they are as declared. sound : (N,) rows to judge.
    Angles `within_reach` that move and come nowhere too fast need not be asked about.
    """
    rows = np.arange(t.size) if sound.all() else np.flatnonzero(sound)
    logged, joints, axes = (
        (angles, joints, axes) if sound.all() else (angles[rows], joints[rows], axes[rows])
    )
    if moves(joints) and _fits(robot, t[rows], axes):
        return
    usual = median_filter(
        axes, size=(OUTLIER_ROWS, 1), mode="nearest"
    )  # without single values that are wrong, however many
    far, fast = _excess(robot, axes) > FAR, _overspeed(robot, t[rows], usual)
    if (far.any(axis=1)).sum() > max(1.0, _MANY * rows.size):
        row, axis = (int(index) for index in np.argwhere(far)[0])
        lower, upper = np.rad2deg(robot.axis_lower[axis]), np.rad2deg(robot.axis_upper[axis])
        raise LogError(
            f"{table.place(rows[row])}: axis {axis + 1} of {robot.name} would stand at {np.rad2deg(axes[row, axis]):.5g} deg, far beyond "
            f"its limits {lower:.4g} to {upper:.4g} deg.{_hint(robot, t[rows], logged, side, unit)}"
        )
    if fast.any(axis=1).sum() > max(2.0, _MANY * rows.size):
        row, axis = (int(index) for index in np.argwhere(fast)[0])
        speed = abs(usual[row + 1, axis] - usual[row, axis]) / max(
            t[rows[row + 1]] - t[rows[row]], 1e-9
        )
        raise LogError(
            f"{table.place(rows[row + 1])}: axis {axis + 1} of {robot.name} would turn at {speed:.4g} rad/s; it reaches "
            f"{robot.axis_speed_max[axis]:.3g} rad/s. {fast.any(axis=1).sum()} such steps.{_hint(robot, t[rows], logged, side, unit)}"
        )
    if (
        moves(logged)
        and not moves(joints)
        and (others := _others_that_fit(robot, t[rows], logged, side, unit))
    ):
        span = np.rad2deg(np.ptp(joints, axis=0).max())
        raise LogError(
            f"{table.place(rows[0])}: {_meant(others)} where {_MEANT[side, unit]} are declared? As declared they turn no axis by more than "
            f"{span:.2g} deg, the other way they fit the axis limits. Name the dialect of what was logged, or convert the log."
        )


def _hint(robot: Robot, t: Array, logged: Array, side: Side, unit: Unit) -> str:
    others = _others_that_fit(robot, t, logged, side, unit)
    if (
        unit == "rad"
        and (side, "deg") not in others
        and _fits(robot, t, joints_to_axes(robot, to_joints(robot, logged, side, "deg")))
    ):
        others.append((side, "deg"))
    if not others:
        return f" Is this the log of the robot that recording.yaml names, and does it hold {_MEANT[side, unit]}?"
    if unit == "rad" and (side, "deg") in others:
        rest = [one for one in others if one != (side, "deg")]
        also = f" Or {_meant(rest, capital=False)}?" if rest else ""
        return (
            " Degrees where radians are declared? Read as degrees, all axes stay within their limits: convert the log, or declare degrees."
            + also
        )
    return f" {_meant(others)} where {_MEANT[side, unit]} are declared? That way all axes stay within their limits."


def _meant(others: list[tuple[Side, Unit]], *, capital: bool = True) -> str:
    text = " or ".join(_MEANT[one] for one in others)
    return text[0].upper() + text[1:] if capital else text


def _others_that_fit(
    robot: Robot, t: Array, logged: Array, side: Side, unit: Unit
) -> list[tuple[Side, Unit]]:
    """Other readings of the numbers under which the robot moves within its limits and speeds; rad before degrees."""
    out: list[tuple[Side, Unit]] = []
    for other in _MEANT:
        if other == (side, unit):
            continue
        joints = to_joints(robot, logged, *other)
        if moves(joints) and _fits(robot, t, joints_to_axes(robot, joints)):
            out.append(other)
    return out


def _fits(robot: Robot, t: Array, axes: Array) -> bool:
    """Whether axis angles (N, 6) stay about within limits and speeds."""
    return within_reach(robot, axes) and not _overspeed(robot, t, axes).any()


def within_reach(robot: Robot, axes: Array) -> bool:
    """Whether no axis angle of (N, 6) [rad] is far beyond its limits."""
    return not (_excess(robot, np.stack((axes.min(axis=0), axes.max(axis=0)))) > FAR).any()


def axis_speed_limits(robot: Robot) -> Array:
    """(6,) [rad/s] of the axes, beyond which lies no motion."""
    return OVERSPEED * robot.axis_speed_max


def _overspeed(robot: Robot, t: Array, axes: Array) -> NDArray[np.bool_]:
    """(N-1, 6) steps that would need more than an axis's speed."""
    step = np.diff(t)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    return np.asarray(
        np.abs(np.diff(axes, axis=0)) / np.maximum(step, 0.5 * usual)[:, None]
        > axis_speed_limits(robot)
    )


def gear_torques(robot: Robot, table: Table, columns: tuple[str, ...]) -> Array | None:
    """(N, 6) [N m] what the motors exert at the gears' outputs, positive along the gear's angle; none if it is not logged.

    columns : motor torques by joint, [N m] at the motor, positive along its angle.
    A gear passes power on: what multiplies the angle, transmission[i, i], divides the torque. Losses count as friction, and
    the couplings between the joints come after the gears (thesis App. A).
    Raises LogError for torques that no motor of the robot has.
    """
    if not columns or columns[0] not in table.columns:
        return None
    torque = np.stack([table.columns[name] for name in columns], axis=1) / np.diag(
        robot.transmission
    )
    bound = HEAVY * full_weight(robot)
    heavy = np.abs(torque) > bound
    if heavy.any():
        row, motor = (int(index) for index in np.argwhere(heavy)[0])
        value = table.columns[columns[motor]][row]
        raise LogError(
            f"{table.place(row)}: column {columns[motor]}: {value:.5g} N m at the motor would be {abs(torque[row, motor]):.3g} N m at the "
            f"gear's output of axis {motor + 1}, more than {HEAVY:g} times the weight of the whole arm stretched out. "
            f"{int(heavy.any(axis=1).sum())} such rows. At the gear's output, in percent, in N mm? Here are N m at the motor."
        )
    return torque


def full_weight(robot: Robot) -> float:
    """[N m] moment of the arm's whole weight at its full reach."""
    reach = float(np.abs(robot.a).sum() + np.abs(robot.d).sum())
    return float(sum(link.mass for link in robot.links[1:]) * np.linalg.norm(robot.gravity) * reach)


def moves(angles: Array) -> bool:
    """Whether some column of (N, C) [rad] turns far enough to be more than noise."""
    return any(
        bool(np.ptp(some, axis=0).max() > MOVES) for some in (angles[::100], angles)
    )  # few rows tell in most logs


def without_stand_ins(table: Table, columns: tuple[str, ...], findings: list[Finding]) -> Table:
    """The rows of one file without those that hold 9E9 for an angle, or all zeros before the first true one.

    Raises LogError if a column holds nothing else.
    """
    extremes = np.array(
        [(table.columns[name].min(), table.columns[name].max()) for name in columns]
    )
    if np.abs(extremes).max() < SENTINEL and any(table.columns[name][0] for name in columns):
        return table
    angles = np.stack([table.columns[name] for name in columns], axis=1)
    absent = np.abs(angles) >= SENTINEL
    if absent.all(axis=0).any():
        column = columns[int(np.flatnonzero(absent.all(axis=0))[0])]
        raise LogError(
            f"{table.place(0)}: column {column}: 9E9 in every row, which stands for an axis that is not there."
        )
    drop = absent.any(axis=1)
    if drop.any():
        sentence = "9E9 stands for no value; row left out."
        findings.append(
            finding("sentinel", "repaired", table.files[0], sentence, lines=table.line[drop])
        )
    zero = ~drop & (angles == 0.0).all(axis=1)
    first = int(np.argmin(zero)) if not zero.all() else 0
    if (
        first and np.abs(angles[first]).max() > MOVES
    ):  # a robot that starts at zero leaves it slowly
        sentence = "all angles are 0 before the first true ones; rows left out."
        findings.append(
            finding(
                "zeros at the start", "repaired", table.files[0], sentence, lines=table.line[:first]
            )
        )
        drop[:first] = True
    if not drop.any():
        return table
    table.flags[1:][drop[:-1] & ~drop[1:]] |= np.uint32(RowFlag.SENTINEL)
    return table.take(~drop)


def report_limits(
    robot: Robot, table: Table, axes: Array, sound: NDArray[np.bool_], findings: list[Finding]
) -> None:
    """Appends axes a little beyond their limits to `findings`; axes : (N, 6) [rad]."""
    extremes = np.stack((axes.min(axis=0), axes.max(axis=0)))
    for axis in np.flatnonzero(_excess(robot, extremes).any(axis=0)):
        angle = axes[:, axis]
        rows = np.flatnonzero(
            sound & ((angle < robot.axis_lower[axis]) | (angle > robot.axis_upper[axis]))
        )
        if not rows.size:
            continue
        beyond = np.rad2deg(
            max(
                robot.axis_lower[axis] - angle[rows].min(),
                angle[rows].max() - robot.axis_upper[axis],
            )
        )
        sentence = (
            f"axis {axis + 1} is up to {beyond:.3g} deg beyond its limits; is it the right robot?"
        )
        findings.append(
            finding(
                "axis beyond its limits",
                "warning",
                table.files[table.file[rows[0]]],
                sentence,
                lines=table.line[rows],
            )
        )


def _excess(robot: Robot, axes: Array) -> Array:
    """(N, 6) how far each axis is beyond its limits, as a fraction of its range; 0 within."""
    span = robot.axis_upper - robot.axis_lower
    return np.asarray(
        np.maximum(np.maximum(axes - robot.axis_upper, robot.axis_lower - axes), 0.0) / span
    )
