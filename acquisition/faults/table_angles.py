"""Joint angles of a table of still poses: against the robot's limits, and by what they show.

What contradicts the declared unit or kind is refused; rounded angles, axes that stand and repeated
poses are findings.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ballbar.acquisition.faults.other_angles import FAR
from ballbar.acquisition.faults.robot_angles import AngleReading, excess
from ballbar.acquisition.report import Finding
from ballbar.acquisition.table.quantities import PoseRows
from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import LogError
from ballbar.cell.file_units import RADIANS, AngleUnit
from ballbar.cell.pose_file import JointColumns
from ballbar.cell.robot_angles import joints_to_axes

MOST_TURNS = 4.0 * np.pi  # [rad] no axis of a robot turns further
_BEYOND = np.deg2rad(1.0)  # [rad] beyond a limit: reported
_MANY = 0.01  # of the poses: a bad number makes few, a wrong unit many
# Steps of angles as a table has them; the coarsest on which all lie is reported.
_GRIDS_DEG = (10.0, 5.0, 1.0, 0.5, 0.1, 0.05, 0.01)
_GRIDS_RAD = (0.1, 0.01, 0.001)
_ON_GRID = 1e-6  # of a step: rounding of decimal numbers
_FEWEST = 5  # different angles of an axis, below which a grid is a coincidence
_STANDS = 1e-6  # [rad] an axis that turns by less stands
# [rad] between joint angles of one pose, to which a robot came back: repeatability and noise of its
# encoders. A UR10 lists such poses 0.05 to 0.2 mrad apart.
_SAME = 3.0e-4


def refuse_other_unit(
    robot: Robot, declared: JointColumns, reading: AngleReading, rows: PoseRows, logged: Array
) -> None:
    """Raises LogError if logged angles (N, J) cannot be the robot's in the declared unit.

    Rows with NaN are not judged.
    """
    complete = np.flatnonzero(np.isfinite(logged).all(axis=1))
    if not complete.size:
        return
    angles, unit = logged[complete], reading.unit
    axes = joints_to_axes(robot, reading.joints(robot, angles))
    far = excess(robot, axes) > FAR
    most = MOST_TURNS if unit == "rad" else np.rad2deg(MOST_TURNS)
    turned = float(np.abs(angles).max()) > most
    if not turned and far.any(axis=1).sum() <= max(1.0, _MANY * complete.size):
        return
    place = np.unravel_index(int(np.abs(angles).argmax()), angles.shape)
    row, axis = map(int, place if turned else np.argwhere(far)[0])
    named = axis < len(declared.columns)
    column = f"column {declared.columns[axis]}" if named else f"angle {axis + 1}"
    lower, upper = np.rad2deg(robot.axis_lower[axis]), np.rad2deg(robot.axis_upper[axis])
    readings = {
        **{f"`unit: {other}`": AngleReading(reading.kind, other) for other in RADIANS},
        **{f"`angles: {kind}`": AngleReading(kind, unit) for kind in ("joints", "axes")},
    }
    others = [k for k, other in readings.items() if other != reading and fits(robot, other, angles)]
    remedy = "Name the columns of the robot's angles, in the order of its axes; is it the robot?"
    if others:
        stay = "all angles stay within the limits: write so under joints in poses.yaml."
        remedy = f"With {' or '.join(others)} {stay}"
    raise LogError(
        f"{rows.location(int(complete[row]))}: {column}: {angles[row, axis]:.6g} read as {unit} "
        f"puts axis {axis + 1} of {robot.name} at {np.rad2deg(axes[row, axis]):.5g} deg, far "
        f"beyond its limits {lower:.4g} to {upper:.4g} deg. {remedy}"
    )


def fits(robot: Robot, reading: AngleReading, logged: Array) -> bool:
    """Whether logged angles (N, J), read so, keep every axis about within its limits."""
    return not (excess(robot, joints_to_axes(robot, reading.joints(robot, logged))) > FAR).any()


def angle_findings(
    robot: Robot, rows: PoseRows, reading: AngleReading, logged: Array
) -> tuple[Finding, ...]:
    """Findings about logged angles (N, J).

    Axes more than 1 deg beyond their limits, that never move or lie on a grid, and poses that the
    table has before.
    """
    q = reading.joints(robot, logged)
    axes = joints_to_axes(robot, q)
    over = np.maximum(robot.axis_lower - axes, axes - robot.axis_upper)
    axis = int(over.max(axis=0).argmax())
    worst = np.rad2deg(over[:, axis].max())
    sentence = f"axis {axis + 1} of {robot.name} lies up to {worst:.3g} deg beyond its limits."
    findings = [*rows.remark("beyond axis limits", sentence, (over > _BEYOND).any(axis=1))]
    still = np.ptp(logged, axis=0) * RADIANS[reading.unit] < _STANDS
    if still.all() and len(logged) > 1:
        sentence = "no axis moves over the whole table. Are these the columns of the angles?"
        findings += rows.remark("joints stand still", sentence)
    elif still.any() and len(logged) > 1:
        standing = _axes(np.flatnonzero(still).tolist())
        findings += rows.remark("axis stands still", f"{standing} never moves.")
    steps: dict[tuple[float, AngleUnit], list[int]] = {}
    for k in np.flatnonzero(~still).tolist():
        if (step := _grid(logged[:, k], reading.unit)) is not None:
            steps.setdefault(step, []).append(k)
    for (size, unit), rounded in steps.items():
        sentence = f"all angles of {_axes(rounded)} are whole multiples of {size:g} {unit}."
        findings += rows.remark("angles on a grid", sentence)
    again = np.zeros(len(q), dtype=bool)
    again[cKDTree(q).query_pairs(_SAME, output_type="ndarray").max(axis=1)] = True
    sentence = "the joint angles of a row before; keep such rows on one side of a split."
    return (*findings, *rows.remark("repeated pose", sentence, again))


def _grid(angles: Array, unit: AngleUnit) -> tuple[float, AngleUnit] | None:
    """Step and its unit of the coarsest grid on which angles (N,) in `unit` lie."""
    if np.unique(angles).size < _FEWEST:
        return None
    degrees = angles if unit == "deg" else np.rad2deg(angles)
    # Numbers of a file in rad have some six digits, so that a grid of degrees is there to 1e-4 deg.
    blur = 0.0 if unit == "deg" else 1e-4
    for step in _GRIDS_DEG if unit == "deg" else _GRIDS_DEG[:5]:
        off = np.abs(degrees - step * np.rint(degrees / step))
        if (off <= _ON_GRID * step + blur).all():
            return step, "deg"
    for step in _GRIDS_RAD if unit == "rad" else ():
        if (np.abs(angles - step * np.rint(angles / step)) <= _ON_GRID * step).all():
            return step, "rad"
    return None


def _axes(axes: Sequence[int]) -> str:
    numbers = [str(axis + 1) for axis in axes]
    return f"axis {numbers[0]}" if len(numbers) == 1 else f"axes {', '.join(numbers)}"
