"""Logged robot angles to joint angles, and the checks that the numbers are what the dialect says.

A dialect holds motor angles, the controller's axis angles or the DH model's joint angles, in rad or
degrees. Kind and unit are never guessed and never converted silently. What a wrong one does to the
numbers is known, though: degrees read as radians put the axes 57 times too far, joint angles read
as motor angles keep the robot within a degree of zero. What contradicts the robot is refused, and
every reading that would fit is named. What nobody can see in the numbers: motor radians taken for
axis degrees, or the other way, are off by a factor of two to three only (gear ratio over 57) and
stay within all limits; the residual of identification shows them.

Motor torques go with the angles to the gears' outputs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from acquisition.flags import RowFlag, usable
from acquisition.table.table import Table
from cell.arrays import Array
from cell.descriptions import Robot
from cell.dialect import AngleKind, Dialect
from cell.errors import LogError
from cell.neighbours import Rows
from cell.robot_angles import (
    controller_to_joints,
    gear_to_axis_torques,
    joints_to_axes,
    joints_to_motors,
    motors_to_joints,
)

Unit = Literal["rad", "deg"]

# Of an axis's range beyond its limits: no calibration offset is as large, a wrong unit is.
FAR = 0.2
# [rad] 0.1 deg beyond a limit that is named: limits are stated in whole degrees, logs are rounded,
# and a controller that stops at its limit overshoots by less.
BEYOND = 1.75e-3
OVERSPEED = 2.0  # times the axis's greatest speed: beyond it lies no motion
MOVES = 0.1  # [rad] a path for calibration turns some axis by more
# Times the arm's own weight at full reach: no motor bears more at its gear's output, one in
# another unit does.
HEAVY = 20.0
FEW_PAIRS = 2  # of exchanged columns; where more fit, one stands for all
SENTINEL = 8.9e9  # controllers write 9E9 for an axis that is not there

OUTLIER_ROWS = 5  # in a median over so many, two are outvoted
# Of the rows: a bad number makes one or two rows too fast or too far, a wrong unit makes many.
_MANY = 0.01
_BLOCK = 4096  # rows at a time, as in cell.robot_angles


@dataclass(frozen=True)
class Reading:
    """What the numbers of a robot's log are taken for."""

    kind: AngleKind
    unit: Unit

    def __str__(self) -> str:
        kinds = {"motors": "motor angles", "axes": "axis angles", "joints": "joint angles"}
        return f"{kinds[self.kind]} in {'degrees' if self.unit == 'deg' else 'rad'}"

    def joints(self, robot: Robot, logged: Array) -> Array:
        """(N, J) [rad] joint angles of logged angles (N, J)."""
        angles = np.deg2rad(logged) if self.unit == "deg" else logged
        match self.kind:
            case "motors":
                return motors_to_joints(robot, angles)
            case "axes":
                return controller_to_joints(robot, angles)
            case "joints":
                return np.asarray(angles, dtype=np.float64)

    def logged(self, robot: Robot, joints: Array) -> Array:
        """(N, J) logged angles of joint angles (N, J) [rad]; inverse of `joints`."""
        match self.kind:
            case "motors":
                angles = joints_to_motors(robot, joints)
            case "axes":
                angles = joints_to_axes(robot, joints)
            case "joints":
                angles = joints
        return np.rad2deg(angles) if self.unit == "deg" else angles

    def scales(self, robot: Robot, columns: Sequence[str]) -> dict[str, float]:
        """[rad] by which a unit of each column turns the joint that it turns most."""
        unit = np.vstack((np.zeros(robot.joints), np.eye(robot.joints)))
        turned = self.joints(robot, unit)
        most = np.abs(turned[1:] - turned[0]).max(axis=1)
        return dict(zip(columns, most.tolist(), strict=True))


_READINGS = tuple(
    Reading(kind, unit) for kind in ("motors", "axes", "joints") for unit in ("rad", "deg")
)


@dataclass(frozen=True, eq=False)
class RobotAngles:
    """The angles of a robot's log as the robot has them if the reading is right."""

    robot: Robot
    t: Array  # (N,) [s]
    joints: Array  # (N, J) [rad] of the DH model
    reading: Reading

    @property
    def logged(self) -> Array:
        """(N, J) in the unit of the reading."""
        return self.reading.logged(self.robot, self.joints)

    @property
    def axes(self) -> Array:
        """(N, J) [rad] as the controller limits them."""
        return joints_to_axes(self.robot, self.joints)

    def axes_step(self, later: Array, earlier: Array) -> Array:
        """(N, J) [rad] by how much the axes differ between joint angles (N, J) [rad]."""
        return joints_to_axes(self.robot, later) - joints_to_axes(self.robot, earlier)

    def axis(self, k: int) -> Array:
        """(N,) [rad] of one axis, from 0."""
        parts = [joints_to_axes(self.robot, part)[:, k].copy() for part in _blocks(self.joints)]
        return np.concatenate(parts)

    def extremes(self) -> Array:
        """(2, J) [rad] smallest and largest angle of each axis."""
        ends = [
            (axes.min(axis=0), axes.max(axis=0))
            for axes in (joints_to_axes(self.robot, part) for part in _blocks(self.joints))
        ]
        lower, upper = np.stack(ends, axis=1)
        return np.stack((lower.min(axis=0), upper.max(axis=0)))

    def take(self, rows: Rows) -> RobotAngles:
        """The chosen rows, in ascending order."""
        if rows.size == self.t.size:
            return self
        return replace(self, t=self.t[rows], joints=self.joints[rows])


class OtherAnglesError(LogError):
    """The angles of a robot's log cannot be what they are declared to be."""

    def __init__(self, statement: str, question: str, angles: RobotAngles) -> None:
        """Sentences on what contradicts the robot, and on what the angles may be.

        angles : of the usable rows, as declared.
        """
        super().__init__(statement, question, angles)  # all that a copy in another process needs
        self.statement = statement
        self.question = question
        self.angles = angles

    def __str__(self) -> str:
        return f"{self.statement} {self.question}"


def pop_angles_inplace(
    robot: Robot, table: Table, t: Array, columns: tuple[str, ...], reading: Reading
) -> RobotAngles:
    """The angles of a table whose rows were taken at t (N,) [s].

    columns : those of the joints, in order. The table loses them: a long log is not held twice.
    """
    joints = np.empty((len(columns), len(table))).T  # column by column, as checks go
    for k, name in enumerate(columns):
        joints[:, k] = table.columns.pop(name)
    for part in _blocks(joints):
        part[:] = reading.joints(robot, part)
    return RobotAngles(robot, t, joints, reading)


def _blocks(angles: Array) -> Iterator[Array]:
    """Views of angles (N, J), some rows each."""
    return (angles[begin : begin + _BLOCK] for begin in range(0, len(angles), _BLOCK))


def refuse_other_angles(robot: Robot, table: Table, angles: RobotAngles) -> None:
    """Raises OtherAnglesError if the logged angles cannot be what they are declared to be.

    Rows with excluding flags are not judged. Angles `within_reach` that move and come nowhere too
    fast need no such check.
    """
    rows = np.flatnonzero(usable(table.flags))
    angles = angles.take(rows)
    t, axes = angles.t, angles.axes
    if moves(angles.joints) and _fits(robot, t, axes):
        return
    # Without single values that are wrong, however many.
    from scipy.ndimage import median_filter  # noqa: PLC0415  slow to import, and rarely needed

    usual = median_filter(axes, size=(OUTLIER_ROWS, 1), mode="nearest")
    far, fast = excess(robot, axes) > FAR, _overspeed(robot, t, usual)
    if far.any(axis=1).sum() > max(1.0, _MANY * rows.size):
        row, axis = (int(index) for index in np.argwhere(far)[0])
        lower, upper = np.rad2deg(robot.axis_lower[axis]), np.rad2deg(robot.axis_upper[axis])
        raise OtherAnglesError(
            f"{table.location(rows[row])}: axis {axis + 1} of {robot.name} would stand at "
            f"{np.rad2deg(axes[row, axis]):.5g} deg, far beyond its limits {lower:.4g} to "
            f"{upper:.4g} deg.",
            _question(robot, angles),
            angles,
        )
    if fast.any(axis=1).sum() > max(2.0, _MANY * rows.size):
        row, axis = (int(index) for index in np.argwhere(fast)[0])
        speed = abs(usual[row + 1, axis] - usual[row, axis]) / max(t[row + 1] - t[row], 1e-9)
        raise OtherAnglesError(
            f"{table.location(rows[row + 1])}: axis {axis + 1} of {robot.name} would turn at "
            f"{speed:.4g} rad/s; it reaches {robot.axis_speed_max[axis]:.3g} rad/s. "
            f"{fast.any(axis=1).sum()} such steps.",
            _question(robot, angles),
            angles,
        )
    if not moves(angles.logged) or moves(angles.joints):
        return
    if others := _others_that_fit(robot, angles):
        span = np.rad2deg(np.ptp(angles.joints, axis=0).max())
        raise LogError(
            f"{table.location(rows[0])}: {_either(others)} where {angles.reading} are declared? As "
            f"declared they turn no axis by more than {span:.2g} deg, the other way they fit the "
            "axis limits. Name the dialect of what was logged, or convert the log."
        )


def _question(robot: Robot, angles: RobotAngles) -> str:
    """A question about what the angles may be instead of what they are declared to be."""
    exchanged = _exchanged_columns(robot, angles)
    if len(exchanged) > FEW_PAIRS:
        exchanged = [f"two of the columns, such as {exchanged[0]},"]
    questions = "".join(f" Or are {columns} exchanged?" for columns in exchanged)
    return f"{_other_reading(robot, angles)}{questions}"


def _exchanged_columns(robot: Robot, angles: RobotAngles) -> list[str]:
    """Pairs of columns with which the robot, once they are exchanged, moves within its limits."""
    pairs = []
    for i, j in reversed(list(combinations(range(robot.joints), 2))):  # wrists are mixed up first
        order = np.arange(robot.joints)
        order[[i, j]] = j, i
        joints = angles.reading.joints(robot, angles.logged[:, order])
        if _fits(robot, angles.t, joints_to_axes(robot, joints)):
            pairs.append(f"{angles.reading.kind} {i + 1} and {j + 1}")
    return pairs


def _other_reading(robot: Robot, angles: RobotAngles) -> str:
    reading, others = angles.reading, _others_that_fit(robot, angles)
    degrees = Reading(reading.kind, "deg")
    if reading.unit == "rad" and degrees not in others:
        axes = joints_to_axes(robot, degrees.joints(robot, angles.logged))
        if _fits(robot, angles.t, axes):
            others.append(degrees)
    if not others:
        return (
            f"Is this the log of the robot that recording.yaml names, and does it hold {reading}? "
            "Correct its robot or dialect."
        )
    robot_question = f" Or is it the log of another robot than {robot.name}?"
    if reading.unit == "rad" and degrees in others:
        rest = [other for other in others if other != degrees]
        also = f" Or {' or '.join(map(str, rest))}?" if rest else ""
        return (
            "Degrees where radians are declared? Read as degrees, all axes stay within their "
            f"limits: convert the log, or declare degrees.{also}{robot_question}"
        )
    stay = "That way all axes stay within their limits: convert the log, or name its dialect."
    return f"{_either(others)} where {reading} are declared? {stay}{robot_question}"


def _either(readings: list[Reading]) -> str:
    text = " or ".join(map(str, readings))
    return text[0].upper() + text[1:]


def _others_that_fit(robot: Robot, angles: RobotAngles) -> list[Reading]:
    """Other readings with which the robot moves within its limits; rad before degrees."""
    fitting: list[Reading] = []
    for reading in _READINGS:
        if reading == angles.reading:
            continue
        joints = reading.joints(robot, angles.logged)
        if moves(joints) and _fits(robot, angles.t, joints_to_axes(robot, joints)):
            fitting.append(reading)
    return fitting


def _fits(robot: Robot, t: Array, axes: Array) -> bool:
    """Whether axis angles (N, J) [rad] at t (N,) [s] stay about within limits and speeds."""
    far = excess(robot, np.stack((axes.min(axis=0), axes.max(axis=0)))) > FAR
    return not (far.any() or _overspeed(robot, t, axes).any())


def within_reach(angles: RobotAngles) -> bool:
    """Whether no axis angle is far beyond its limits."""
    return not (excess(angles.robot, angles.extremes()) > FAR).any()


def axis_speed_limits(robot: Robot) -> Array:
    """(J,) [rad/s] of the axes, beyond which lies no motion."""
    return OVERSPEED * robot.axis_speed_max


def _overspeed(robot: Robot, t: Array, axes: Array) -> NDArray[np.bool_]:
    """(N-1, J) steps of axes (N, J) [rad] at t (N,) [s] that need more than an axis's speed."""
    step = np.diff(t)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    speed = np.abs(np.diff(axes, axis=0)) / np.maximum(step, 0.5 * usual)[:, None]
    return np.asarray(speed > axis_speed_limits(robot))


def gear_torques(robot: Robot, table: Table, dialect: Dialect) -> Array | None:
    """(N, J) [N m] motor torques at the gears' outputs, positive along the gear's angle.

    None if they are not logged.

    dialect : names their columns, and says whether they are at the motor, positive along its angle,
        or already behind the gear, positive along the controller's axis angle.
    A gear passes power on: what multiplies the angle, transmission[i, i], divides the torque.
    Losses count as friction, and the couplings between the joints come after the gears (thesis App.
    A).
    Raises LogError for torques that no motor of the robot has.
    """
    columns = dialect.torque_columns
    if not columns or columns[0] not in table.columns:
        return None
    logged = np.stack([table.columns[name] for name in columns], axis=1)
    at_motors = dialect.torques_at == "motors"
    if at_motors:
        torque = logged / np.diag(robot.transmission)
    else:
        torque = gear_to_axis_torques(robot, logged)
    heavy = np.abs(torque) > HEAVY * full_weight(robot)
    if heavy.any():
        row, motor = (int(index) for index in np.argwhere(heavy)[0])
        value = f"{logged[row, motor]:.5g} N m"
        if at_motors:
            value += f" at the motor would be {abs(torque[row, motor]):.3g} N m"
        doubt, place = (
            ("At the gear's output, in percent", "at the motor")
            if at_motors
            else ("In percent", "behind the gear")
        )
        raise LogError(
            f"{table.location(row)}: column {columns[motor]}: {value} at the gear's output of axis "
            f"{motor + 1}, more than {HEAVY:g} times the weight of the whole arm stretched out. "
            f"{int(heavy.any(axis=1).sum())} such rows. {doubt}, in N mm? Here are N m {place}. "
            "Convert the log, or name its dialect in recording.yaml."
        )
    return torque


def full_weight(robot: Robot) -> float:
    """[N m] moment of the arm's whole weight at its full reach; inf where it is unknown."""
    if robot.links is None:
        return float("inf")
    reach = float(np.abs(robot.a).sum() + np.abs(robot.d).sum())
    return float(sum(link.mass for link in robot.links[1:]) * np.linalg.norm(robot.gravity) * reach)


def moves(angles: Array) -> bool:
    """Whether some column of (N, C) [rad] turns far enough to be more than noise."""
    # A few rows show it in most logs.
    return any(bool(np.ptp(rows, axis=0).max() > MOVES) for rows in (angles[::100], angles))


def without_sentinels(table: Table, columns: tuple[str, ...]) -> Table:
    """The rows of one file without those that hold 9E9 for an angle, or zeros before the first one.

    columns : the robot's angles.
    Raises LogError if a column holds nothing else.
    """
    extremes = [(table.columns[name].min(), table.columns[name].max()) for name in columns]
    if np.abs(extremes).max() < SENTINEL and any(table.columns[name][0] for name in columns):
        return table
    angles = np.stack([table.columns[name] for name in columns], axis=1)
    absent = np.abs(angles) >= SENTINEL
    if absent.all(axis=0).any():
        column = columns[int(np.argmax(absent.all(axis=0)))]
        raise LogError(
            f"{table.location(0)}: column {column}: 9E9 in every row, which stands for an axis "
            "that is not there. Name the columns of the axes that are."
        )
    drop = absent.any(axis=1)
    if drop.any():
        sentence = "9E9 stands for no value; row left out."
        table = table.remarked("sentinel", "repaired", sentence, rows=drop)
    zero = ~drop & (angles == 0.0).all(axis=1)
    first = int(np.argmin(zero)) if not zero.all() else 0
    # A robot that starts at zero leaves it slowly.
    if first and np.abs(angles[first]).max() > MOVES:
        sentence = "all angles are 0 before the first true ones; rows left out."
        table = table.remarked("zeros at the start", "repaired", sentence, rows=np.arange(first))
        drop[:first] = True
    if not drop.any():
        return table
    behind = np.concatenate(([False], drop[:-1])) & ~drop
    return table.flagged(behind, RowFlag.SENTINEL).take(~drop)


def with_limits_checked(table: Table, angles: RobotAngles) -> Table:
    """The table with a finding for each axis a little beyond its limits."""
    robot, valid = angles.robot, usable(table.flags)
    for axis in np.flatnonzero(excess(robot, angles.extremes()).any(axis=0)):
        angle, lower, upper = angles.axis(int(axis)), robot.axis_lower[axis], robot.axis_upper[axis]
        rows = np.flatnonzero(valid & ((angle < lower - BEYOND) | (angle > upper + BEYOND)))
        if not rows.size:
            continue
        beyond = np.rad2deg(max(lower - angle[rows].min(), angle[rows].max() - upper))
        sentence = (
            f"axis {axis + 1} is up to {beyond:.3g} deg beyond its limits; is it the right robot?"
        )
        table = table.remarked("axis beyond its limits", "warning", sentence, rows=rows)
    return table


def excess(robot: Robot, axes: Array) -> Array:
    """(N, J) how far axes (N, J) [rad] are beyond their limits, as a fraction of the range."""
    span = robot.axis_upper - robot.axis_lower
    beyond = np.maximum(axes - robot.axis_upper, robot.axis_lower - axes)
    return np.asarray(np.maximum(beyond, 0.0) / span)
