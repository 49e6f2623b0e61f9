"""Prediction of a path along which an instrument follows a target on the robot.

Its rows are those of an identification of such a recording (ballbar.ident.estimator.observations):
the unknowns of still poses of ballbar.planning.pose_information, and the instrument's clock. Each
of SAMPLES instants stands for the rows about it, whose white noise averages, while what the model
leaves unexplained is common to them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline

from ballbar.cell.clock import Clock
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import geometry_of_chain, parameter_table
from ballbar.cell.load import describes_instrument, load_instrument
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseTable
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.ident.corrections.unit_weights import unit_weights
from ballbar.ident.estimator.build_unknowns import still_unknowns
from ballbar.ident.estimator.model import still_model
from ballbar.ident.estimator.robust_fit import equations_at
from ballbar.ident.estimator.unknowns import PlacedPoses
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.signals.motion import MotionByLog
from ballbar.ident.signals.smooth_log import interpolating_log
from ballbar.planning.crlb import SAMPLES, PathPrediction
from ballbar.planning.pose_information import expected_group, smooth_joint_errors
from ballbar.planning.pose_request import POSE_SCHEMA, PosePlanRequest
from ballbar.planning.request import PlanRequest
from ballbar.planning.stations import PoseSetup, setup_of
from ballbar.planning.trajectory import Passage

# [m] of the instrument in the base frame and of the target on the flange; assumed, as in
# scenarios/plans/irb2400_tracker.yaml. Where the instrument stands hardly matters.
SEAT, TARGET = (3.0, 0.0, 0.5), (0.05, 0.0, 0.1)
RATE = 100.0  # [Hz] rows of the instrument; assumed


def followed(request: PlanRequest, name: str | None) -> PoseSetup | None:
    """The instrument of this name, its place and its target; None for one that does not follow.

    Raises InputError for a workspace that the robot does not have, and for a tracker beside a
    ball-bar that follows no target.
    """
    cell = request.cell
    if name is None or not describes_instrument(name) or not load_instrument(name).follows:
        if name is not None and name == cell.tracker:
            raise InputError(f"cell.tracker = {name}: it follows no target, as tracker_point does")
        return None
    poses = {
        "schema": f"{POSE_SCHEMA}/1",
        "name": request.name,
        "robot": cell.robot,
        "instrument": name,
        "seats": ({"position_m": SEAT},),
        "targets": ({"position_m": TARGET},),
    }
    setup = PosePlanRequest.model_validate(poses)
    return setup_of(setup.model_copy(update={"workspace": request.workspace}), relative_to=Path())


def predict_followed(
    setup: PoseSetup, request: PlanRequest, trajectory: Passage, *, samples: int = SAMPLES
) -> PathPrediction:
    """The prediction of a path that an instrument follows."""
    robot, placed = setup.robot, placed_along(setup, request, trajectory, samples=samples)
    nominal = geometry_of_chain(parameter_table(robot), setup.chain)
    corrections = (unit_weights(robot), smooth_joint_errors(robot))
    layout = still_unknowns(nominal, placed, corrections)
    model = still_model(placed.table, layout, corrections, np.zeros(robot.joints))
    linear = equations_at(model, layout.mean, setup.unexplained, ())
    ((name, target),) = placed.targets.items()
    return PathPrediction(
        layout=layout,
        normal=linear.normal,
        robot=IdentifiedRobot(
            robot, nominal, corrections, layout.mean[layout.coefficients], target=target
        ),
        grid=setup.grid,
        target=name,
        model=model,
        points=linear.evaluations,
    )


def placed_along(
    setup: PoseSetup,
    request: PlanRequest,
    trajectory: Passage,
    *,
    loads: BSpline | None = None,
    samples: int = SAMPLES,
) -> PlacedPoses:
    """The rows that the instrument measures along a path; loads : as of `MotionByLog`."""
    robot, (station,), sensors = setup.robot, setup.stations, request.sensors
    t = np.linspace(trajectory.t[0], trajectory.t[-1], samples + 2)[1:-1]
    spacing = float(t[1] - t[0])
    angles, (ours, theirs) = (
        sensors.robot_noise_sigma_rad,
        (np.sqrt(min(1.0, 1.0 / (rate * spacing))) for rate in (sensors.robot_rate_hz, RATE)),
    )
    log = interpolating_log(trajectory.t, trajectory.q, np.full(robot.joints, angles * ours))
    motion = MotionByLog(request.name, log, Clock(0.0, 0.0), loads)
    group = expected_group(setup, station, joints_to_axes(robot, motion.angles(t)))
    group = replace(group, time=t, motion=motion, sigma=theirs * group.sigma)
    table = PoseTable(request.name, robot, (group,))
    seats = {station.seat: Placement(np.eye(3), station.origin)}
    return PlacedPoses(table, seats, {station.target: Placement(np.eye(3), station.point)})
