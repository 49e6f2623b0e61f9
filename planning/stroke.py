"""Predicted length of a telescoping bar along a trajectory.

The nominal robot keeps the length near the middle of the stroke. Robots with errors of the expected
size, and a seat that is placed to a millimetre, change it by `u . (J e - o)`: u the direction of
the rod, J e the tool's displacement by the robot's errors e, o that of the seat, which is set so
that the bar begins in the middle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.chain import screw
from cell.descriptions import Cell
from cell.geometry import bar_frames, nominal_geometry, parameter_named, robot_frames
from planning.force import DRAWS, ERROR
from planning.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class StrokeModel:
    """The part of a prediction that does not depend on the trajectory."""

    names: tuple[str, ...]  # parameters of the robot that deviate
    errors: Array  # (P, DRAWS) [m, rad]
    seat: Array  # (3, DRAWS) [m]
    stroke: tuple[float, float]  # [m] shortest and longest length


@dataclass(frozen=True, eq=False)
class Lengths:
    """Lengths of the bar with DRAWS robots on one trajectory."""

    length: Array  # (DRAWS, N) [m]
    commanded: Array  # (N,) [m] with the nominal robot
    stroke: tuple[float, float]  # [m]

    @property
    def leaving(self) -> int:
        """Number of robots with which the bar leaves its stroke."""
        low, high = self.stroke
        return int(((self.length < low) | (self.length > high)).any(axis=1).sum())

    @property
    def scale(self) -> float:
        """Factor on the robots' errors with which they take a quarter of the stroke each way."""
        low, high = self.stroke
        return float(0.25 * (high - low) / np.abs(self.length - self.commanded).max())

    @property
    def warning(self) -> str:
        """Says with how many robots the bar leaves its stroke, and the remedy; empty for none."""
        if not self.leaving:
            return ""
        return (
            f"with {self.leaving} of {len(self.length)} robots that are off by 1 mm and 1 mrad the "
            "bar leaves its stroke. Calibrate coarsely first (still poses, or a bar of longer "
            "stroke) and correct the targets of this path with the result (ballbar correct)"
        )


def stroke_model(cell: Cell, *, seed: int) -> StrokeModel | None:
    """The model of a cell with drawn robots; None where the rod's length is not sensed."""
    if cell.ballbar.stroke is None:
        return None
    table = nominal_geometry(cell, np.zeros(3)).table
    names = tuple(n for n in table.robot if n not in (*table.gauge, table.plate))
    rng = np.random.default_rng(seed)
    errors = ERROR * rng.standard_normal((len(names), DRAWS))
    return StrokeModel(names, errors, ERROR * rng.standard_normal((3, DRAWS)), cell.ballbar.stroke)


def predicted_lengths(model: StrokeModel, trajectory: Trajectory) -> Lengths:
    """Lengths of the bar along a trajectory."""
    frames = robot_frames(trajectory.nominal, trajectory.q)
    rod = bar_frames(trajectory.nominal, trajectory.b).z[2]
    parameters = [parameter_named(name) for name in model.names]
    along = [(screw(frames, p.kind, p.row)[:3] * rod).sum(axis=0) for p in parameters]
    change = model.errors.T @ np.stack(along) - model.seat.T @ rod
    change -= change[:, :1] * (rod * rod[:, :1]).sum(axis=0)
    commanded = np.linalg.norm(trajectory.tip - trajectory.nominal.origin, axis=1)
    return Lengths(commanded + change, commanded, model.stroke)
