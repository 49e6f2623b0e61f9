"""Predicted force in the rod along a trajectory under soft servo.

Robots with errors of the expected size (thesis sec. 5.4) would hold the tool beside the sphere by a
gap `g`. The compliance of servo, gears and rod along the rod closes it. With tau_1 the torque at
each gear per newton of tension, tau_0 the other torques of the gears, and tau_b the part of them
that no feed-forward carries (ball-bar, motion, friction),

    F (1/k_rod + sum tau_1^2 (1/k_gear + 1/kp)) = g - sum tau_1 (tau_0 / k_gear + tau_b / kp)

The prediction is quasi-static and without backlash; planning.verify simulates the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.bodies import carried_bodies
from cell.chain import Frames, screw
from cell.descriptions import Cell, ServoGains
from cell.dynamics import joint_torques
from cell.geometry import (
    Geometry,
    bar_frames,
    nominal_geometry,
    parameter_named,
    parameter_screw,
    robot_frames,
)
from ident.loads.gear_loads import Loads, MassModel, loads, on_ballbar
from planning.trajectory import Trajectory
from sim.errors.static_errors import THESIS_3_1

CREEP = 1e-3  # [rad/s] speed at which Coulomb friction has most of its size; assumed
DRAWS = 8  # robots whose force is predicted
# [m, rad] standard deviation of each parameter (notes/parameters, geometric_error_prior)
ERROR = 1e-3


@dataclass(frozen=True, eq=False)
class Forces:
    """Loads and rod tensions of DRAWS robots on one trajectory."""

    carried: Loads
    tension: Array  # (DRAWS, N) [N]

    @property
    def largest(self) -> float:
        """[N] largest magnitude over robots and time."""
        return float(np.abs(self.tension).max())


@dataclass(frozen=True, eq=False)
class ForceModel:
    """The part of a prediction that does not depend on the trajectory."""

    cell: Cell
    masses: MassModel
    gains: ServoGains
    errors: Array  # (P, DRAWS) [m, rad] deviations of the parameters of thesis Table 3.1


def force_model(cell: Cell, masses: MassModel, gains: ServoGains, *, seed: int) -> ForceModel:
    """The force model of a cell with drawn robots."""
    errors = ERROR * np.random.default_rng(seed).standard_normal((len(THESIS_3_1), DRAWS))
    return ForceModel(cell, masses, gains, errors)


def predicted_forces(model: ForceModel, trajectory: Trajectory) -> Forces:
    """Tension of the rod along a trajectory; each of its runs begins without force."""
    geometry, cell, q, b = trajectory.nominal, model.cell, trajectory.q, trajectory.b
    carried = loads(model.masses, geometry, q, b, trajectory.speed, trajectory.acceleration)
    robot, bar = robot_frames(geometry, q), bar_frames(geometry, b)
    wrench = on_ballbar(model.masses, bar, b)[1]
    gap = _gaps(model, geometry, robot, bar, wrench, first=trajectory.first)
    per_newton = carried.gear_per_newton
    weight = joint_torques(robot, carried_bodies(cell), q, gravity=cell.robot.gravity)
    gears = cell.robot.required("gears")
    gear, servo = 1.0 / gears.stiffness[:, None], 1.0 / model.gains.kp[:, None]
    compliance = 1.0 / cell.ballbar.axial_stiffness + (per_newton**2 * (gear + servo)).sum(axis=0)
    speed = (trajectory.speed @ cell.robot.joint_to_gear).T
    coulomb = gears.coulomb[:, None] * np.tanh(speed / CREEP)
    friction = coulomb + gears.viscous[:, None] * speed
    uncompensated = carried.gear - cell.robot.gear_to_joint @ weight + friction
    sag = (per_newton * (carried.gear * gear + uncompensated * servo)).sum(axis=0)
    return Forces(carried, np.asarray((gap - sag) / compliance))


def _gaps(
    model: ForceModel,
    geometry: Geometry,
    robot: Frames,
    bar: Frames,
    wrench: Array,
    *,
    first: NDArray[np.intp],
) -> Array:
    """(DRAWS, N) [m] distance along the rod between tool and rod's end of the drawn robots.

    wrench : (6, N) on the ball-bar per newton of tension. first : (N,) index of the first target
        of each run, at which the base was set without force: there the gap along the rod is none.
    """
    levers = []
    for parameter in map(parameter_named, THESIS_3_1):
        away = 1.0 if parameter.side == "robot" else -1.0  # the tool moves out, or the rod's end
        motion = parameter_screw(geometry, robot, bar, parameter)
        levers.append(away * (wrench * motion).sum(axis=0))
    gap = model.errors.T @ np.stack(levers)
    rod = bar.z[2]
    return np.asarray(gap - gap[:, first] * (rod * rod[:, first]).sum(axis=0))


def load_reversals(forces: Forces, width: Array) -> Array:
    """(DRAWS, 6) number of times that each gear's load changes the flank of its backlash.

    A load does so where it passes from beyond +width to beyond -width, or back. width : (6,) [N m]
    (ident.corrections.base.backlash_transition).
    """
    # (DRAWS, 6, N)
    load = forces.carried.gear + forces.tension[:, None, :] * forces.carried.gear_per_newton
    side = np.where(load > width[:, None], 1, np.where(load < -width[:, None], -1, 0))
    reversals = np.zeros(side.shape[:2])
    for k, gear in np.ndindex(side.shape[:2]):
        flanks = side[k, gear][side[k, gear] != 0]
        reversals[k, gear] = np.count_nonzero(np.diff(flanks))
    return reversals


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
