"""Joint angles of still poses, and the checks that the columns hold what poses.yaml declares."""

from __future__ import annotations

import numpy as np

from acquisition.report import Finding, finding
from acquisition.table.quantities import PoseRows
from cell.arrays import Array
from cell.descriptions import Robot
from cell.errors import LogError
from cell.pose_file import AngleUnit, JointColumns
from cell.robot_angles import controller_to_joints, joints_to_axes

MOST_TURNS = 4.0 * np.pi  # [rad] no axis of a robot turns further
FAR = 0.2  # of an axis's range beyond its limits: no offset is as large, a wrong unit is
BEYOND = np.deg2rad(1.0)  # [rad] beyond a limit: reported
_MANY = 0.01  # of the poses: a bad number makes few, a wrong unit many


def joint_angles(robot: Robot, declared: JointColumns, logged: Array, unit: AngleUnit) -> Array:
    """(N, J) [rad] DH joint angles of logged angles (N, J) in `unit`."""
    angles = np.deg2rad(logged) if unit == "deg" else logged
    return controller_to_joints(robot, angles) if declared.angles == "axes" else angles


def refuse_other_unit(
    robot: Robot, declared: JointColumns, rows: PoseRows, logged: Array, unit: AngleUnit
) -> None:
    """Raises LogError if logged angles (N, J) cannot be the robot's in the declared unit.

    Rows with NaN are not judged.
    """
    judged = np.flatnonzero(np.isfinite(logged).all(axis=1))
    if not judged.size:
        return
    angles = logged[judged]
    largest = float(np.abs(angles).max())
    q = joint_angles(robot, declared, angles, unit)
    axes = joints_to_axes(robot, q)
    far = _excess(robot, axes) > FAR
    too_far = far.any(axis=1).sum() > max(1.0, _MANY * judged.size)
    turned = largest > (MOST_TURNS if unit == "rad" else np.rad2deg(MOST_TURNS))
    if not (turned or too_far):
        return
    place = np.unravel_index(int(np.abs(angles).argmax()), angles.shape)
    row, axis = map(int, place if turned else np.argwhere(far)[0])
    raise LogError(
        f"{rows.location(int(judged[row]))}: {_column(declared, axis)}: {angles[row, axis]:.6g} "
        f"read as {unit} puts {_beyond(robot, axes[row], axis)}. "
        f"{_remedy(robot, declared, angles, unit)}"
    )


def _column(declared: JointColumns, axis: int) -> str:
    columns = declared.columns
    return f"column {columns[axis]}" if len(columns) > axis else f"angle {axis + 1}"


def _beyond(robot: Robot, axes: Array, axis: int) -> str:
    """Where an axis of axes (J,) [rad] would stand, beside its limits."""
    lower, upper = np.rad2deg(robot.axis_lower[axis]), np.rad2deg(robot.axis_upper[axis])
    return (
        f"axis {axis + 1} of {robot.name} at {np.rad2deg(axes[axis]):.5g} deg, far beyond its "
        f"limits {lower:.4g} to {upper:.4g} deg"
    )


def _remedy(robot: Robot, declared: JointColumns, angles: Array, unit: AngleUnit) -> str:
    """Other readings of angles (N, J) in `unit` that fit the robot, or what else to look at."""
    others = [
        words
        for words, other, kind in (
            ("`unit: deg`", "deg", declared.angles),
            ("`unit: rad`", "rad", declared.angles),
            ("`angles: joints`", unit, "joints"),
            ("`angles: axes`", unit, "axes"),
        )
        if (other, kind) != (unit, declared.angles)
        and _fits(robot, declared.model_copy(update={"angles": kind}), angles, other)
    ]
    if not others:
        return (
            "Name the columns that hold the robot's angles, in the order of its axes, and the "
            "right robot."
        )
    return (
        f"With {' or '.join(others)} all angles stay within the limits: write so under joints in "
        "poses.yaml."
    )


def _fits(robot: Robot, declared: JointColumns, angles: Array, unit: str) -> bool:
    q = joint_angles(robot, declared, angles, "deg" if unit == "deg" else "rad")
    return not (_excess(robot, joints_to_axes(robot, q)) > FAR).any()


def may_be_rad(robot: Robot, declared: JointColumns, logged: Array) -> bool:
    """Whether logged angles (N, J) [rad or deg] fit the robot as rad, and none exceeds a turn."""
    small = float(np.abs(logged).max()) <= 2.0 * np.pi
    return small and _fits(robot, declared, logged, "rad")


def limit_findings(robot: Robot, rows: PoseRows, q: Array) -> tuple[Finding, ...]:
    """Poses whose joint angles q (N, J) [rad] put an axis beyond its limits by more than BEYOND."""
    axes = joints_to_axes(robot, q)
    over = np.maximum(robot.axis_lower - axes, axes - robot.axis_upper)
    beyond = np.flatnonzero((over > BEYOND).any(axis=1))
    if not beyond.size:
        return ()
    axis = int(over.max(axis=0).argmax())
    sentence = (
        f"axis {axis + 1} of {robot.name} lies up to {np.rad2deg(over[:, axis].max()):.3g} deg "
        "beyond its limits."
    )
    lines = rows.line[beyond]
    return (finding("beyond axis limits", "warning", rows.file, sentence, lines=lines),)


def _excess(robot: Robot, axes: Array) -> Array:
    """(N, J) how far axis angles (N, J) [rad] lie beyond their limits, as a share of the range."""
    over = np.maximum(robot.axis_lower - axes, axes - robot.axis_upper)
    return np.asarray(over / (robot.axis_upper - robot.axis_lower))
