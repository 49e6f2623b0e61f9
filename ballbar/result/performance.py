"""`ballbar performance`: characteristics of ISO 9283 and ISO 230-4 of an identified robot.

What was measured stands first; at the test cube and over the workspace the identified robot
predicts.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from os import PathLike

import numpy as np

from ballbar.acquisition.pose_tables import PoseImport
from ballbar.acquisition.recording import Recording
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import geometry_of_chain, parameter_table
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.ident.performance.characteristics import ROBOTS, Characteristic, Performance, merged
from ballbar.ident.performance.cube import fitting_cube
from ballbar.ident.performance.measured import Circle, lengths_beside, measure
from ballbar.ident.performance.predicted import RobotPair, predict
from ballbar.ident.robot.identified_kinematics import kinematics
from ballbar.ident.robot.inverse_calibration import FULL
from ballbar.ident.robot.pose_covariance import PoseCovariance
from ballbar.recordings.read import Thing, measured
from ballbar.result.calibration import Calibration, load
from ballbar.result.verification import check_same

NOTES = (
    "Predicted values are of the geometry and of what was identified at rest; servo, vibrations "
    "and the controller's own interpolation are in measured values alone.",
    "Accuracies are after the best fit of the base frame, which the standard has aligned before a "
    "test.",
)
COMMANDED = "Commanded poses are those of the logged angles, so a logged error does not count."
NO_CUBE = (
    "No test cube of 250 to 1000 mm lies within the fitted ranges with one orientation "
    "and away from singular postures, so the workspace alone is stated; --cube takes another edge."
)
FEW_AXES = (
    "A robot with fewer than six axes does not keep one orientation over a test cube, so the "
    "workspace alone is stated."
)
NO_RADIUS = "F_max and F_min are about the mean length: state the bar's nominal length (--radius)."
NOTHING = (
    "The measurements hold no pose three times, no path that repeats and no full circle, or no "
    "positions or lengths: all values are predicted."
)


def performance(
    calibration: Calibration | str | PathLike[str],
    thing: Thing | None = None,
    *,
    side: float | None = None,
    radius: float | None = None,
    cell: Cell | None = None,
) -> Performance:
    """The characteristics of an identified robot, measured where `thing` has repetitions.

    calibration : or the path of one. thing : poses, or a recording, as of `identify`, with the
    `cell` of arrays. side : [m] edge of the test cube; by default the largest standard one that
    fits. radius : [m] nominal length of a telescoping ball-bar.

    Raises InputError for measurements of another robot, for a cube that does not fit, and for a
    result that states no uncertainty.
    """
    stored = calibration if isinstance(calibration, Calibration) else load(calibration)
    robots = robots_of(stored)
    cube = fitting_cube(robots.nominal, robots.robot, side)
    if cube is None and side is not None:
        remedy = "Choose a smaller one, or none for the largest that fits."
        why = remedy if robots.robot.robot.joints >= FULL else FEW_AXES
        raise InputError(f"the robot does not take the poses of a cube of {side:g} m. {why}")
    rows, circles, notes = list[Characteristic](), list[Circle](), list(NOTES)
    if thing is not None:
        table, targets = _poses_of(stored, robots, measured(thing, cell)), stored.targets
        rows, circles = measure(robots, targets, table, cube, radius=radius)
        notes.append(COMMANDED if rows else NOTHING)
        if circles and radius is None and table.groups[0].measured == "length":
            notes.append(NO_RADIUS)
    stated = merged(rows, predict(robots, cube))
    if cube is None:
        notes.append(NO_CUBE if stored.robot.joints >= FULL else FEW_AXES)
        return Performance(stated, tuple(notes), tuple(circles))
    axes = joints_to_axes(stored.robot, cube.q)
    return Performance(stated, tuple(notes), tuple(circles), cube.side, cube.poses, axes)


def robots_of(calibration: Calibration) -> RobotPair:
    """The identified robot of a result beside its nominal one, with the tool of both the same.

    What is stated of still poses is what the file holds, so that all documents state the same: the
    error of cross-validation, of poses in regions that others lie about, and over the whole of the
    fitted ranges at least the stated uncertainty of the target.
    """
    own = calibration.identified_robot if calibration.of_logs else calibration.robot_of_poses
    robot, chain = own(), calibration.nominal_chain
    if isinstance(stated := robot.stated, PoseCovariance):
        least = max(stated.discrepancy, calibration.tcp_sigma / np.sqrt(3.0))
        robot = replace(robot, stated=replace(stated, discrepancy=float(least)))
    geometry = geometry_of_chain(parameter_table(robot.robot), chain)
    return RobotPair(kinematics(robot.rigid(geometry), chain), kinematics(robot, chain))


def _poses_of(stored: Calibration, robots: RobotPair, read: Recording | PoseImport) -> PoseTable:
    """Poses as read, or the lengths of a telescoping ball-bar beside a robot's log."""
    if isinstance(read, PoseImport):
        folder, table = None if read.file is None else read.file.parent, read.table
        check_same(stored, folder, {"robot": read.description.robot}, table.robot)
        return table
    check_same(stored, read.folder, {"robot": read.description.robot}, None)
    log, lengths = read.robot_log, read.length_log
    if lengths is None:
        return PoseTable(read.name, stored.robot, ())
    commanded = robots.nominal.identified.ends(log.q)[:, :3, 3]
    at = lengths.t + lengths_beside(commanded, log.t, lengths)
    q = np.column_stack([np.interp(at, log.t, column) for column in log.q.T])
    values, rows = lengths.length[:, None], np.arange(lengths.t.size)
    group = PoseGroup("length", "seat", "target", q, values, sigma=0.0 * values, rows=rows, file="")
    return PoseTable(read.name, stored.robot, (group,))


def performance_data(stated: Performance) -> dict[str, object]:
    """JSON of `performance`, SI units."""
    rows = [
        {key: getattr(row, key) for key in ("symbol", "name", "clause", "place", "unit", "cycles")}
        | {robot: asdict(s) for robot, s in zip(ROBOTS, row.statements, strict=True)}
        for row in stated.rows
    ]
    cube = {
        "cube_side_m": stated.side,
        "cube_poses": None if stated.poses is None else stated.poses.tolist(),
        "cube_axes_rad": None if stated.axes is None else stated.axes.tolist(),
    }
    return {**cube, "characteristics": rows, "notes": list(stated.notes)}
