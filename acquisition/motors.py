"""Robot motor angles to joint angles, and the checks that the numbers are what the dialect says: rad, at the motor.

Motor torques go with them to the gears' outputs.

Units are never guessed and never converted silently. What a wrong unit does to the numbers is known, though: degrees read
as radians put the axes 57 times too far, joint angles read as motor angles keep the robot within a degree of zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from acquisition.report import Finding, finding
from acquisition.table import Table
from cell.descriptions import Robot, joints_to_axes, motors_to_joints
from cell.errors import LogError

Array = NDArray[np.float64]

FAR = 0.2  # of an axis's range beyond its limits: no calibration offset is as large, a wrong unit is
OVERSPEED = 2.0  # times the axis's greatest speed: beyond it lies no motion
MOVES = 0.1  # [rad] a path for calibration turns some axis by more
UNIT_ROWS = 10  # a single bad number makes one or two rows too fast, a wrong unit makes many


def joint_angles(robot: Robot, table: Table, t: Array, columns: tuple[str, ...], findings: list[Finding]) -> Array:
    """(N, 6) [rad] joint angles of logged motor angles; axes a little beyond their limits are appended to `findings`.

    t : (N,) [s]. columns : motor angles by joint, [rad].
    Raises LogError if the angles cannot be motor angles in rad, or jump.
    """
    motors = np.stack([table.columns[name] for name in columns], axis=1)
    joints = motors_to_joints(robot, motors)
    axes = joints_to_axes(robot, joints)
    _refuse_joint_side(robot, table, motors, joints)
    _refuse_far_axes(robot, table, motors, axes)
    _refuse_overspeed(robot, table, t, motors, axes)
    _report_limits(robot, table, axes, findings)
    return joints


def gear_torques(robot: Robot, table: Table, columns: tuple[str, ...]) -> Array | None:
    """(N, 6) [N m] what the motors exert at the gears' outputs, positive along the gear's angle; none if it is not logged.

    columns : motor torques by joint, [N m] at the motor, positive along its angle.
    A gear passes power on: what multiplies the angle, transmission[i, i], divides the torque. Losses count as friction, and
    the couplings between the joints come after the gears (thesis App. A).
    """
    if not columns or columns[0] not in table.columns:
        return None
    return np.stack([table.columns[name] for name in columns], axis=1) / np.diag(robot.transmission)


def moves(angles: Array) -> bool:
    """Whether some column of (N, C) [rad] turns far enough to be more than noise."""
    return bool(np.ptp(angles, axis=0).max() > MOVES)


def _excess(robot: Robot, axes: Array) -> Array:
    """(N, 6) how far each axis is beyond its limits, as a fraction of its range; 0 within."""
    span = robot.axis_upper - robot.axis_lower
    return np.maximum(np.maximum(axes - robot.axis_upper, robot.axis_lower - axes), 0.0) / span


def _refuse_joint_side(robot: Robot, table: Table, motors: Array, joints: Array) -> None:
    if not moves(motors) or moves(joints) or _excess(robot, joints_to_axes(robot, motors)).any():
        return
    span = np.rad2deg(np.ptp(joints, axis=0).max())
    raise LogError(
        f"{table.place(0)}: joint angles where motor angles are declared? As motor angles they turn no axis by more than {span:.2g} deg, "
        "as joint angles they fit the axis limits. Log motor angles, or name the dialect that has joint angles."
    )


def _refuse_far_axes(robot: Robot, table: Table, motors: Array, axes: Array) -> None:
    far = _excess(robot, axes) > FAR
    if not far.any():
        return
    row, axis = (int(index) for index in np.argwhere(far)[0])
    lower, upper = np.rad2deg(robot.axis_lower[axis]), np.rad2deg(robot.axis_upper[axis])
    raise LogError(
        f"{table.place(row)}: axis {axis + 1} of {robot.name} would stand at {np.rad2deg(axes[row, axis]):.5g} deg, far beyond its limits "
        f"{lower:.4g} to {upper:.4g} deg.{_degrees_hint(robot, motors)}"
    )


def _refuse_overspeed(robot: Robot, table: Table, t: Array, motors: Array, axes: Array) -> None:
    time = np.diff(t)
    # A jittered stamp may follow closely: never divide by less than half the usual time between rows.
    speed = np.abs(np.diff(axes, axis=0)) / np.maximum(time, 0.5 * np.median(time))[:, None]
    fast = np.argwhere(speed > OVERSPEED * robot.axis_speed_max)
    if not fast.size:
        return
    row, axis = (int(index) for index in fast[0])
    hint = _degrees_hint(robot, motors) if len(fast) > UNIT_ROWS else " A number in this row or the one before is damaged."
    raise LogError(
        f"{table.place(row + 1)}: axis {axis + 1} of {robot.name} would turn at {speed[row, axis]:.4g} rad/s; "
        f"it reaches {robot.axis_speed_max[axis]:.3g} rad/s. {len(fast)} such steps.{hint}"
    )


def _degrees_hint(robot: Robot, motors: Array) -> str:
    if _excess(robot, joints_to_axes(robot, motors_to_joints(robot, np.deg2rad(motors)))).any():
        return " Is this the log of the robot that recording.yaml names, in rad at the motor?"
    return " Degrees where radians are declared? Read as degrees, all axes stay within their limits: convert the log to rad."


def _report_limits(robot: Robot, table: Table, axes: Array, findings: list[Finding]) -> None:
    excess = _excess(robot, axes)
    for axis in np.flatnonzero(excess.any(axis=0)):
        rows = np.flatnonzero(excess[:, axis])
        beyond = np.rad2deg(excess[:, axis].max() * (robot.axis_upper - robot.axis_lower)[axis])
        sentence = f"axis {axis + 1} is up to {beyond:.3g} deg beyond its limits; is it the right robot?"
        findings.append(finding("axis beyond its limits", "warning", table.files[table.file[rows[0]]], sentence, lines=table.line[rows]))
