"""A robot's log as its controller writes it, in any dialect that is read, by the dialect's file.

Columns, units and separators are those of the dialect (ballbar.cell.dialect); a container that is
no table of text has an encoder (ballbar.sim.logging.containers).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.dialect import Dialect, load_dialect
from ballbar.cell.errors import InputError
from ballbar.cell.files import write_whole
from ballbar.cell.robot_angles import gear_to_axis_torques, joints_to_axes, motors_to_joints
from ballbar.sim.logging.containers import ENCODERS, robot_log_name
from ballbar.sim.logging.load_logs import DeviceLogs

_TICKS = {"s": 1, "ms": 10**3, "us": 10**6, "100ns": 10**7, "ns": 10**9}  # a second


def robot_dialect(logs: DeviceLogs, robot: Robot) -> tuple[str, Dialect]:
    """Name and content of the dialect in which a scenario logs its robot.

    Raises InputError for one without columns of the torques that are logged, DescriptionError for
    one in the robot's file that does not exist.
    """
    name = logs.robot.dialect or robot.log_dialect
    dialect = load_dialect(name)
    if logs.torque and not dialect.torques:
        raise InputError(
            f"logs.torque: dialect {name} has no columns for torques. Leave torque out, or choose "
            "logs.robot.dialect = canonical-robot."
        )
    return name, dialect.for_axes(robot.joints)


def robot_period(logs: DeviceLogs, robot: Robot) -> float:
    """[s] from one row of the robot's log to the next."""
    rate = logs.robot.rate_hz
    return 1.0 / rate if rate else robot_dialect(logs, robot)[1].written.period_s


def robot_source(logs: DeviceLogs, robot: Robot) -> dict[str, object]:
    """`sources.robot` of recording.yaml."""
    name, dialect = robot_dialect(logs, robot)
    return {"files": [robot_log_name(dialect.container)], "dialect": name}


def write_robot_log(
    folder: Path,
    logs: DeviceLogs,
    robot: Robot,
    stamps: Array,
    motors: Array,
    torques: Array | None = None,
) -> None:
    """Write the file of `robot_source` into a recording's folder.

    stamps : (N,) [s] on the robot's clock. motors : (N, J) [rad]. torques : (N, J) [N m] at the
        motors, if they are logged.
    """
    _, dialect = robot_dialect(logs, robot)
    path = folder / robot_log_name(dialect.container)
    angles = logged_angles(dialect, robot, motors)
    if torques is not None:
        torques = logged_torques(dialect, robot, torques)
    if dialect.container == "text":
        write_whole(path, _table(dialect, stamps, angles, torques))
        return
    names, values = (dialect.time.column, *dialect.angles), angles
    if torques is not None:
        names, values = (*names, *dialect.torque_columns), np.hstack((angles, torques))
    times = stamps if dialect.time.type == "float" else _ticks(dialect, stamps)
    write_whole(path, ENCODERS[dialect.container][0](names, times, values))


def logged_torques(dialect: Dialect, robot: Robot, torques: Array) -> Array:
    """(N, J) [N m] torques where the dialect has them; torques : (N, J) at the motors."""
    if dialect.torques_at == "motors":
        return torques
    return gear_to_axis_torques(robot, torques / np.diag(robot.transmission))


def logged_angles(dialect: Dialect, robot: Robot, motors: Array) -> Array:
    """(N, J) motor, axis or joint angles of the dialect, in its unit."""
    angles = motors
    if dialect.angle_kind != "motors":
        angles = motors_to_joints(robot, motors)
    if dialect.angle_kind == "axes":
        angles = joints_to_axes(robot, angles)
    return np.rad2deg(angles) if dialect.angle_unit == "deg" else angles


def _ticks(dialect: Dialect, stamps: Array) -> Array:
    """(N,) whole units of the dialect's clock."""
    return np.asarray(np.rint(stamps * _TICKS[dialect.time.unit or "s"]).astype(np.int64))


def _table(dialect: Dialect, stamps: Array, angles: Array, torques: Array | None) -> bytes:
    # 1e-9 rad of a motor is 1e-11 rad of its joint, 1e-6 N m is 1e-4 N m there.
    written, separator = dialect.written, dialect.separators[0]
    first, axes = written.first_axis, angles.shape[1]
    angle = f"%.{written.digits}g" if written.digits else "%.9f"
    names = [written.time or dialect.time.column]
    names += [
        written.angle.format(first + k) if written.angle else dialect.angles[k] for k in range(axes)
    ]
    if dialect.time.unit == "s":
        forms, columns = ["%.6f"], [stamps, angles]
    else:
        forms, columns = ["%d"], [_ticks(dialect, stamps), angles]
    forms += [angle] * axes
    if torques is not None:
        names += dialect.torque_columns
        forms += ["%.6f"] * axes
        columns.append(torques)
    form = separator.join(forms)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    lines = [form % (stamp, *(v for part in parts for v in part)) for stamp, *parts in rows]
    return ("\n".join([separator.join(names), *lines]) + "\n").encode("ascii")
