"""`ballbar performance`: characteristics of ISO 9283 and ISO 230-4 of an identified robot.

What was measured stands first; at the test cube and over the workspace the identified robot
predicts.
"""

from __future__ import annotations

from dataclasses import asdict
from os import PathLike

import numpy as np

from ballbar.acquisition.pose_tables import PoseImport
from ballbar.acquisition.recording import Recording
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import geometry_of_chain, parameter_table, robot_geometry
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.ident.performance.characteristics import Listing, Performance, merged
from ballbar.ident.performance.cube import TestCube, fitting_cube
from ballbar.ident.performance.measured import Circle, measure
from ballbar.ident.performance.predicted import Prediction, RandomErrors, predict
from ballbar.ident.robot.identified_kinematics import kinematics
from ballbar.ident.signals.smooth_log import motion_of
from ballbar.ident.start.followed import followed_table
from ballbar.recordings.read import Thing, measured
from ballbar.result.calibration import Calibration, load
from ballbar.result.verification import check_same

NOTES = (
    "Predicted values are of the geometry and of what was identified at rest; servo, vibrations "
    "and the controller's own interpolation are in measured values alone.",
    "Accuracies are after the best fit of the base frame, which the standard has aligned before a "
    "test.",
)
COMMANDED = (
    "Commanded poses are those of the logged angles, so an error of the servo that the controller "
    "logs does not count."
)
NO_RADIUS = "F_max and F_min are about the mean length: state the bar's nominal length (--radius)."
NOTHING = (
    "The measurements hold no pose {least} times, no path that repeats and no full circle, or an "
    "instrument that senses neither positions nor a length: all values are predicted."
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
    prediction = prediction_of(stored)
    cube = fitting_cube(prediction.nominal, prediction.robot, side)
    if cube is None and side is not None:
        remedy = "Choose a smaller one, or none for the largest that fits."
        raise InputError(f"the robot does not take the poses of a cube of {side:g} m. {remedy}")
    listing, circles, notes = Listing(), tuple[Circle, ...](), list(NOTES)
    if thing is not None:
        circles = _measure(listing, stored, prediction, cube, measured(thing, cell), radius)
        notes.append(COMMANDED if listing.rows else NOTHING.format(least="three"))
        if circles and radius is None and not _of_points(listing):
            notes.append(NO_RADIUS)
    return Performance(
        rows=merged(listing.rows, predict(prediction, cube).rows),
        notes=tuple(notes),
        circles=circles,
        side=None if cube is None else cube.side,
        poses=None if cube is None else cube.poses,
    )


def prediction_of(calibration: Calibration) -> Prediction:
    """The identified robot of a result beside its nominal one, with the tool of both the same."""
    robot, chain = calibration.identified_robot(), calibration.nominal_chain
    geometry = geometry_of_chain(parameter_table(robot.robot), chain)
    excess = calibration.file.fit.excess
    return Prediction(
        nominal=kinematics(robot.rigid(geometry), chain),
        identified=kinematics(robot, chain),
        random=RandomErrors(*(() if excess is None else (excess.gear_rad, excess.wrist_rad))),
    )


def _of_points(listing: Listing) -> bool:
    """Whether circles were measured by positions, whose nominal radius is the commanded one."""
    stated = (row.statements["identified"].value for row in listing.rows if row.symbol == "RONt")
    return any(value is not None for value in stated)


def _measure(
    listing: Listing,
    stored: Calibration,
    prediction: Prediction,
    cube: TestCube | None,
    read: Recording | PoseImport,
    radius: float | None,
) -> tuple[Circle, ...]:
    """Adds what was measured; the circles."""
    if isinstance(read, PoseImport):
        folder, table = None if read.file is None else read.file.parent, read.table
        check_same(stored, folder, {"robot": read.description.robot}, table.robot)
    else:
        check_same(stored, read.folder, {"robot": read.description.robot}, None)
        table = _poses_of(stored, read)
    targets = {} if stored.of_logs else stored.targets
    return measure(listing, prediction, targets, table, cube, radius=radius)


def _poses_of(stored: Calibration, recording: Recording) -> PoseTable:
    """What a tracker or a sensed length measured beside the robot's log, as poses.

    The clock of a length is taken for the robot's: on a circle a late angle turns the plot alone.
    """
    log, robot = recording.robot_log, stored.robot
    if recording.tracker_log is not None:
        motion = motion_of(log, log.q)
        name = recording.name or "recording"
        return followed_table(name, robot, robot_geometry(robot), motion, recording.tracker_log)
    if (lengths := recording.length_log) is None:
        return PoseTable(recording.name, robot, ())
    at = np.clip(lengths.t, log.t[0], log.t[-1])
    group = PoseGroup(
        measured="length",
        seat="seat",
        target="target",
        q=np.column_stack([np.interp(at, log.t, column) for column in log.q.T]),
        values=lengths.length[:, None],
        sigma=np.zeros((at.size, 1)),  # not stated
        rows=np.arange(at.size),
        file="",
        time=lengths.t,
    )
    return PoseTable(recording.name, robot, (group,))


def performance_data(stated: Performance) -> dict[str, object]:
    """JSON of `performance`, SI units."""
    return {
        "cube_side_m": stated.side,
        "cube_poses": None if stated.poses is None else stated.poses.tolist(),
        "characteristics": [
            {
                "symbol": row.symbol,
                "name": row.name,
                "clause": row.clause,
                "place": row.place,
                "unit": row.unit,
                "cycles": row.cycles,
                **{robot: asdict(each) for robot, each in row.statements.items()},
            }
            for row in stated.rows
        ],
        "notes": list(stated.notes),
    }
