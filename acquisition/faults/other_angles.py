"""Angles of a robot's log that cannot be what they are declared to be, and what they may be.

What a wrong kind or unit does to the numbers is known: degrees read as radians put the axes 57
times too far, joint angles read as motor angles keep the robot within a degree of zero. What
contradicts the robot is refused, and every reading that would fit is named. What nobody can see in
the numbers: motor radians taken for axis degrees, or the other way, are off by a factor of two to
three only (gear ratio over 57) and stay within all limits; the residual of identification shows
them.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.faults.damaged_values import with_damaged
from ballbar.acquisition.faults.jumps import find_jumps
from ballbar.acquisition.faults.robot_angles import AngleReading, RobotAngles, excess, moves
from ballbar.acquisition.flags import usable
from ballbar.acquisition.table.table import Table
from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import LogError
from ballbar.cell.neighbours import Rows
from ballbar.cell.robot_angles import joints_to_axes

# Of an axis's range beyond its limits: no calibration offset is as large, a wrong unit is.
FAR = 0.2
OVERSPEED = 2.0  # times the axis's greatest speed: beyond it lies no motion
FEW_PAIRS = 2  # of exchanged columns; where more fit, one stands for all
OUTLIER_ROWS = 5  # in a median over so many, two are outvoted
# Of the rows: a bad number makes one or two rows too fast or too far, a wrong unit makes many.
_MANY = 0.01
_READINGS = tuple(
    AngleReading(kind, unit) for kind in ("motors", "axes", "joints") for unit in ("rad", "deg")
)


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


def with_angle_jumps_checked(table: Table, angles: RobotAngles) -> tuple[Table, Rows]:
    """The table with jumps of the angles flagged, and the rows from which they stay away.

    Raises LogError if the angles cannot be what they are declared to be.
    """
    rows = np.flatnonzero(usable(table.flags))
    judged = angles.take(rows)
    limits = OVERSPEED * angles.robot.axis_speed_max
    jumps = find_jumps(judged.t, judged.joints, limits, judged.axes_step)
    table = with_damaged(table, rows[jumps.damaged])
    within_reach = not (excess(angles.robot, angles.extremes()) > FAR).any()
    if jumps.fast.size or not (moves(angles.joints) and within_reach):
        _refuse_other_angles(table, angles)
    reset = rows[jumps.lasting]
    sentence = "the angles jump here and do not come back: the logger started again; a new segment."
    table = table.remarked("angles jump", sentence, rows=reset)
    return table, reset[np.diff(angles.t)[reset - 1] > 0]  # where the clock goes on


def _refuse_other_angles(table: Table, angles: RobotAngles) -> None:
    """Raises OtherAnglesError if the angles at usable rows contradict the robot's data."""
    rows = np.flatnonzero(usable(table.flags))
    angles = angles.take(rows)
    robot, t, axes = angles.robot, angles.t, angles.axes
    if moves(angles.joints) and _fits(angles, axes):
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
            _question(angles),
            angles,
        )
    if fast.any(axis=1).sum() > max(2.0, _MANY * rows.size):
        row, axis = (int(index) for index in np.argwhere(fast)[0])
        speed = abs(usual[row + 1, axis] - usual[row, axis]) / max(t[row + 1] - t[row], 1e-9)
        raise OtherAnglesError(
            f"{table.location(rows[row + 1])}: axis {axis + 1} of {robot.name} would turn at "
            f"{speed:.4g} rad/s; it reaches {robot.axis_speed_max[axis]:.3g} rad/s. "
            f"{fast.any(axis=1).sum()} such steps.",
            _question(angles),
            angles,
        )
    if not moves(angles.logged) or moves(angles.joints):
        return
    if others := _others_that_fit(angles):
        span = np.rad2deg(np.ptp(angles.joints, axis=0).max())
        what = f"{_either(others)} where {angles.reading} are declared? As declared they turn "
        what += f"no axis by more than {span:.2g} deg."
        remedy = "Name the dialect of what was logged, or convert the log."
        raise LogError.at(table.location(rows[0]), what, remedy)


def _question(angles: RobotAngles) -> str:
    """A question about what the angles may be instead of what they are declared to be."""
    robot, exchanged = angles.robot, list[str]()  # pairs that leave it within its limits
    for i, j in reversed(list(combinations(range(robot.joints), 2))):  # wrists are mixed up first
        order = np.arange(robot.joints)
        order[[i, j]] = j, i
        joints = angles.reading.joints(robot, angles.logged[:, order])
        if _fits(angles, joints_to_axes(robot, joints)):
            exchanged.append(f"{angles.reading.kind} {i + 1} and {j + 1}")
    if len(exchanged) > FEW_PAIRS:
        exchanged = [f"two of the columns, such as {exchanged[0]},"]
    questions = "".join(f" Or are {columns} exchanged?" for columns in exchanged)
    return f"{_other_reading(angles)}{questions}"


def _other_reading(angles: RobotAngles) -> str:
    """A question that names the readings with which all axes stay within their limits."""
    reading, others = angles.reading, _others_that_fit(angles)
    degrees = AngleReading(reading.kind, "deg")
    if reading.unit == "rad" and degrees not in others:
        joints = degrees.joints(angles.robot, angles.logged)
        if _fits(angles, joints_to_axes(angles.robot, joints)):
            others.append(degrees)
    if not others:
        return (
            f"Is this the log of the robot that recording.yaml names, and does it hold {reading}? "
            "Correct its robot or dialect."
        )
    question = f"{_either(others)} where {reading} are declared?"
    if reading.unit == "rad" and degrees in others:
        others.remove(degrees)
        further = "".join(f" Or {other}?" for other in others)
        question = f"Degrees where radians are declared?{further}"
    return (
        f"{question} That way all axes stay within their limits: convert the log, or declare what "
        f"it holds. Or is it the log of another robot than {angles.robot.name}?"
    )


def _either(readings: list[AngleReading]) -> str:
    text = " or ".join(map(str, readings))
    return text[0].upper() + text[1:]


def _others_that_fit(angles: RobotAngles) -> list[AngleReading]:
    """Other readings with which the robot moves within its limits; rad before degrees."""
    fitting: list[AngleReading] = []
    for reading in _READINGS:
        joints = reading.joints(angles.robot, angles.logged)
        within = moves(joints) and _fits(angles, joints_to_axes(angles.robot, joints))
        if reading != angles.reading and within:
            fitting.append(reading)
    return fitting


def _fits(angles: RobotAngles, axes: Array) -> bool:
    """Whether axis angles (N, J) [rad] at the same times stay about within limits and speeds."""
    robot, extremes = angles.robot, np.stack((axes.min(axis=0), axes.max(axis=0)))
    return not ((excess(robot, extremes) > FAR).any() or _overspeed(robot, angles.t, axes).any())


def _overspeed(robot: Robot, t: Array, axes: Array) -> NDArray[np.bool_]:
    """(N-1, J) steps of axes (N, J) [rad] at t (N,) [s] that need more than an axis's speed."""
    step = np.diff(t)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    speed = np.abs(np.diff(axes, axis=0)) / np.maximum(step, 0.5 * usual)[:, None]
    return np.asarray(speed > OVERSPEED * robot.axis_speed_max)
