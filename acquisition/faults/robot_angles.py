"""Logged robot angles to joint angles and motor torques to those at the gears, and what is usable.

A dialect holds motor angles, the controller's axis angles or the DH model's joint angles, in rad or
degrees. Kind and unit are never guessed and never converted silently; numbers that contradict the
robot are refused (ballbar.acquisition.faults.other_angles).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbar.acquisition.flags import RowFlag, usable
from ballbar.acquisition.table.table import Table
from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.dialect import AngleKind, Dialect
from ballbar.cell.errors import LogError
from ballbar.cell.file_units import AngleUnit
from ballbar.cell.neighbours import Rows
from ballbar.cell.robot_angles import (
    controller_to_joints,
    gear_to_axis_torques,
    joints_to_axes,
    joints_to_motors,
    motors_to_joints,
)

# Times the arm's own weight at full reach: no motor bears more at its gear's output, one in
# another unit does.
HEAVY = 20.0


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
        side = "motor" if at_motors else "gear's output"
        times = abs(torque[row, motor]) / full_weight(robot)
        raise LogError(
            f"{table.location(row)}: column {columns[motor]}: {logged[row, motor]:.5g} N m at the "
            f"{side}: at the gear's output of axis {motor + 1} that is {times:.3g} times the "
            "weight of the whole arm stretched out. "
            f"{int(heavy.any(axis=1).sum())} such rows. In percent, in N mm, or on the other side "
            "of the gear? Convert the log, or name its dialect in recording.yaml."
        )
    return torque


def full_weight(robot: Robot) -> float:
    """[N m] moment of the arm's whole weight at its full reach; inf where it is unknown."""
    if robot.links is None:
        return float("inf")
    reach = float(np.abs(robot.a).sum() + np.abs(robot.d).sum())
    return float(sum(link.mass for link in robot.links[1:]) * np.linalg.norm(robot.gravity) * reach)


# [rad] 0.1 deg beyond a limit that is named: limits are stated in whole degrees, logs are rounded,
# and a controller that stops at its limit overshoots by less.
BEYOND = 1.75e-3
MOVES = 0.1  # [rad] a path for calibration turns some axis by more
SENTINEL = 8.9e9  # controllers write 9E9 for an axis that is not there
_BLOCK = 4096  # rows at a time, as in ballbar.cell.robot_angles


@dataclass(frozen=True)
class AngleReading:
    """The kind and unit for which the numbers of a robot's log are taken."""

    kind: AngleKind
    unit: AngleUnit

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
        joints = self.joints(robot, unit)
        most = np.abs(joints[1:] - joints[0]).max(axis=1)
        return dict(zip(columns, most.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class RobotAngles:
    """The angles of a robot's log as the robot has them if the reading is right."""

    robot: Robot
    t: Array  # (N,) [s]
    joints: Array  # (N, J) [rad] of the DH model
    reading: AngleReading

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


def pop_angles_inplace(
    robot: Robot, table: Table, t: Array, columns: tuple[str, ...], reading: AngleReading
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


def moves(angles: Array) -> bool:
    """Whether some column of (N, C) [rad] turns far enough to be more than noise."""
    # A few rows show it in most logs.
    return any(bool(np.ptp(rows, axis=0).max() > MOVES) for rows in (angles[::100], angles))


def excess(robot: Robot, axes: Array) -> Array:
    """(N, J) how far axes (N, J) [rad] are beyond their limits, as a fraction of the range."""
    span = robot.axis_upper - robot.axis_lower
    beyond = np.maximum(axes - robot.axis_upper, robot.axis_lower - axes)
    return np.asarray(np.maximum(beyond, 0.0) / span)


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
        what = f"column {column}: 9E9 in every row, which stands for an axis that is not there."
        raise LogError.at(table.location(0), what, "Name the columns of the axes that are.")
    drop = absent.any(axis=1)
    if drop.any():
        sentence = "9E9 stands for no value; row left out."
        table = table.remarked("sentinel", sentence, rows=drop)
    zero = ~drop & (angles == 0.0).all(axis=1)
    first = int(np.argmin(zero)) if not zero.all() else 0
    # A robot that starts at zero leaves it slowly.
    if first and np.abs(angles[first]).max() > MOVES:
        sentence = "all angles are 0 before the first true ones; rows left out."
        table = table.remarked("zeros at the start", sentence, rows=np.arange(first))
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
        sentence = f"axis {axis + 1} is up to {beyond:.3g} deg beyond its limits."
        table = table.remarked("axis beyond its limits", sentence, rows=rows)
    return table
