"""Targets of the rehearsed day: written, corrected, and held by the true robot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.files import write_whole
from ballbar.cell.geometry import robot_frames
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.compensation.targets_file import (
    CorrectedTable,
    axis_columns,
    correct_file,
    read_targets,
    write_corrected,
)
from ballbar.export.result import Result
from ballbar.ident.robot.accuracy import accuracy_grid, position_error
from ballbar.ident.robot.inverse_calibration import TargetError, corrected_targets
from ballbar.scenario import Scenario
from ballbar.sim.plant.held import hold_machine, pose_distance
from ballbar.sim.true_robot import true_machine

TARGETS = 50
GIVEN, CORRECTED = "targets.csv", "targets-corrected.csv"


@dataclass(frozen=True, eq=False)
class HeldTargets:
    """Targets in the plant: (N,) each."""

    before: Array  # [m] distance of the tool from where it belongs, targets as planned
    after: Array  # [m] the same with corrected targets
    aligned: Array  # [m] the same after the best rigid motion of the base


def correct_targets(folder: Path, result: Result) -> CorrectedTable:
    """Writes targets into the folder, and corrected ones beside them.

    They are the first of the accuracy box that can be corrected; at singularities none can.
    """
    q = correctable(result, accuracy_grid(result.robot))[:TARGETS]
    axes = np.degrees(joints_to_axes(result.robot, q))
    lines = [",".join(axis_columns(result.robot)), *(",".join(map(repr, r)) for r in axes.tolist())]
    write_whole(folder / GIVEN, ("\n".join(lines) + "\n").encode())
    correction = correct_file(folder / GIVEN, result)
    write_corrected(folder / CORRECTED, correction, result)
    return correction


def correctable(result: Result, q: Array) -> Array:
    """(K, J) [rad] the targets out of (N, J) that can be corrected.

    Targets are refused for one reason at a time, so the remaining ones are tried again.
    """
    calibration = result.calibration
    robot, nominal = calibration.identified_robot(), calibration.nominal_chain
    while True:
        try:
            corrected_targets(robot, nominal, q)
        except TargetError as error:
            q = np.delete(q, list(error.faults), axis=0)
        else:
            return q


def hold_targets(
    folder: Path, result: Result, scenario: Scenario, relative_to: Path
) -> HeldTargets:
    """How far the tool is off when the true robot holds the targets of a folder.

    relative_to : folder of the scenario's file.
    """
    given, corrected = (read_targets(folder / name, result.robot).q for name in (GIVEN, CORRECTED))
    robot = true_machine(scenario, relative_to=relative_to)
    planned, after = robot_frames(robot.nominal, given), hold_machine(robot, corrected)
    return HeldTargets(
        before=pose_distance(planned, hold_machine(robot, given))[0],
        after=pose_distance(planned, after)[0],
        aligned=position_error(planned.tip.T, after.tool[:, :3, 3]).error,
    )
