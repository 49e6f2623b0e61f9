"""Predicted force in the rod along a trajectory under soft servo.

Robots with errors of the expected size (thesis sec. 5.4) would hold the tool beside the sphere by a
gap `g`. The compliance of servo, gears and rod along the rod closes it. With tau_1 the torque at
each gear per newton of tension, tau_0 the other torques of the gears, and tau_b the part of them
that no feed-forward carries (ball-bar, motion, friction),

    F (1/k_rod + sum tau_1^2 (1/k_gear + 1/kp)) = g - sum tau_1 (tau_0 / k_gear + tau_b / kp)

The prediction is quasi-static and without backlash; ballbar.planning.verify simulates the rest.
Where the robot's file lacks masses, gears or servo, typical ones stand for them
(ballbar.cell.typical_machine), and as many robots as MACHINES, drawn from their spread, give the
interval of the force.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.bodies import carried_bodies, link_bodies
from ballbar.cell.chain import Frames, screw
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.dynamics import joint_torques, torques_of_each
from ballbar.cell.geometry import (
    Geometry,
    nominal_geometry,
    parameter_named,
    parameter_screw,
    parameter_table,
)
from ballbar.cell.typical_machine import Spread, with_typical
from ballbar.ident.loads.gear_loads import Loads, MassModel, loads, mass_model
from ballbar.planning.trajectory import Trajectory
from ballbar.sim.errors.static_errors import THESIS_3_1
from ballbar.sim.plant.effects import servo_gains

CREEP = 1e-3  # [rad/s] speed at which Coulomb friction has most of its size; assumed
DRAWS = 8  # robots whose force is predicted
# Robots drawn from the spread about a typical one: another one is outside of what N of them reach
# with a probability of 2 / (N + 1)
MACHINES = 63
# [m, rad] standard deviation of each parameter (notes/plant, geometric_error_prior)
ERROR = 1e-3


@dataclass(frozen=True, eq=False)
class Forces:
    """Loads and rod tensions of DRAWS robots on one trajectory."""

    carried: Loads
    tension: Array  # (DRAWS, N) [N]
    # (2, N) [N] least and largest over the spread of a robot whose file lacks data, else of these
    extent: Array

    @property
    def magnitude(self) -> Array:
        """(N,) [N] largest magnitude over the robots."""
        return np.asarray(np.abs(self.extent).max(axis=0))

    @property
    def interval(self) -> tuple[float, float]:
        """[N] least and largest over robots and time."""
        return float(self.extent.min()), float(self.extent.max())


@dataclass(frozen=True, eq=False)
class Machines:
    """R robots of one geometry in error each; one row of the rest is of all of them."""

    errors: Array  # (P, R) [m, rad] deviations of the parameters
    mass: Array  # (R, J) of each link over the stated or typical one
    gear: Array  # (R, J) [rad/(N m)] compliance
    servo: Array  # (R, J) [rad/(N m)] compliance
    coulomb: Array  # (R, J) [N m]
    viscous: Array  # (R, J) [N m s/rad]


@dataclass(frozen=True, eq=False)
class ForceModel:
    """The part of a prediction that does not depend on the trajectory."""

    cell: Cell  # with typical values for what the robot's file lacks
    masses: MassModel
    names: tuple[str, ...]  # of P parameters that deviate
    robots: Machines  # DRAWS of them, as stated, or typical
    typical: Spread  # of the robot
    drawn: Machines | None  # MACHINES from the spread; None for a robot whose file is complete

    @property
    def held(self) -> Array:
        """(J,) [rad] that each axis stays behind its target until it reverses: Coulomb friction,
        from one side to the other, under the servo."""
        return np.asarray(2.0 * self.robots.coulomb[0] * self.robots.servo[0])


def force_model(cell: Cell, servo: str, *, seed: int) -> ForceModel:
    """The force model of a cell with drawn robots; servo : name of the gain set.

    Raises InputError where the robot has no such set.
    """
    robot, typical = with_typical(cell.robot)
    cell, table = replace(cell, robot=robot), parameter_table(robot)
    wrist = (n for n in table.robot if int(n[-1]) >= 6 and n != table.plate)
    names = tuple(dict.fromkeys((*THESIS_3_1, *(wrist if robot.joints > 6 else ()))))
    rng = np.random.default_rng(seed)

    def machines(robots: list[Robot], count: int) -> Machines:
        masses = np.array([[link.mass for link in r.required("links")[1:]] for r in robots])
        gears = [r.required("gears") for r in robots]
        return Machines(
            errors=ERROR * rng.standard_normal((len(names), count)),
            mass=masses / [link.mass for link in robot.required("links")[1:]],
            gear=1.0 / np.array([g.stiffness for g in gears]),
            servo=1.0 / np.array([servo_gains(r, servo, key="servo").kp for r in robots]),
            coulomb=np.array([g.coulomb for g in gears]),
            viscous=np.array([g.viscous for g in gears]),
        )

    robots, drawn = machines([robot], DRAWS), None
    if typical.keys:
        drawn = machines([typical.drawn(robot, rng) for _ in range(MACHINES)], MACHINES)
    return ForceModel(cell, mass_model(cell), names, robots, typical, drawn)


def predicted_forces(model: ForceModel, trajectory: Trajectory) -> Forces:
    """Tension of the rod along a trajectory; each of its runs begins without force."""
    geometry, cell, q, b = trajectory.nominal, model.cell, trajectory.q, trajectory.b
    frames = robot, bar = trajectory.robot, trajectory.bar
    carried = loads(
        model.masses,
        geometry,
        q=q,
        b=b,
        speed=trajectory.speed,
        acceleration=trajectory.acceleration,
        frames=frames,
    )
    levers = _levers(model, geometry, robot, bar, carried.on_bar)
    to_gear, per_newton = cell.robot.gear_to_joint, carried.gear_per_newton
    links = np.zeros((len(to_gear), *per_newton.shape))  # (J, J, N) at the gears, of each link
    if model.drawn is not None:
        bodies = list(enumerate(link_bodies(cell.robot)))
        each = torques_of_each(robot, bodies, q, gravity=cell.robot.gravity)
        links = np.einsum("gj,bjn->bgn", to_gear, each)
    weight = joint_torques(robot, carried_bodies(cell), q, gravity=cell.robot.gravity)
    uncompensated = carried.gear - to_gear @ weight
    speed = (trajectory.speed @ cell.robot.joint_to_gear).T
    side = np.tanh(speed / CREEP)

    def tension_of(m: Machines) -> Array:
        """(R, N) of one axis after the other, all robots at once."""
        gap = _gaps(levers, m.errors, bar.z[2], trajectory.first)
        sag, yielding = np.zeros_like(gap), np.full_like(gap, 1.0 / cell.ballbar.axial_stiffness)
        for j, lever in enumerate(per_newton):
            at_gear = carried.gear[j] + (m.mass - 1.0) @ links[:, j]
            rubbing = np.outer(m.coulomb[:, j], side[j]) + np.outer(m.viscous[:, j], speed[j])
            gear, servo = m.gear[:, j, None], m.servo[:, j, None]
            sag += lever * (gear * at_gear + servo * (uncompensated[j] + rubbing))
            yielding += (gear + servo) * lever**2
        return np.asarray((gap - sag) / yielding)

    every = tension = tension_of(model.robots)
    if model.drawn is not None:
        every = np.concatenate((tension, tension_of(model.drawn)))
    return Forces(carried, tension, np.stack((every.min(axis=0), every.max(axis=0))))


def _levers(
    model: ForceModel, geometry: Geometry, robot: Frames, bar: Frames, wrench: Array
) -> Array:
    """(P, N) [-, m] distance along the rod between tool and rod's end per unit of each error.

    wrench : (6, N) on the ball-bar per newton of tension.
    """
    levers = []
    for parameter in map(parameter_named, model.names):
        away = 1.0 if parameter.side == "robot" else -1.0  # the tool moves out, or the rod's end
        motion = parameter_screw(geometry, robot, bar, parameter)
        levers.append(away * (wrench * motion).sum(axis=0))
    return np.stack(levers)


def _gaps(levers: Array, errors: Array, rod: Array, first: NDArray[np.intp]) -> Array:
    """(R, N) [m] distance along the rod between tool and rod's end of robots with errors (P, R).

    rod : (3, N) its direction. first : (N,) index of the first target of each run, at which the
        base was set without force: there the gap along the rod is none.
    """
    gap = errors.T @ levers
    return np.asarray(gap - gap[:, first] * (rod * rod[:, first]).sum(axis=0))


def load_reversals(forces: Forces, width: Array) -> Array:
    """(DRAWS, 6) number of times that each gear's load changes the flank of its backlash.

    A load does so where it passes from beyond +width to beyond -width, or back. width : (6,) [N m]
    (ballbar.ident.corrections.base.backlash_transition).
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
    frames, rod = trajectory.robot, trajectory.bar.z[2]
    parameters = [parameter_named(name) for name in model.names]
    along = [(screw(frames, p.kind, p.row)[:3] * rod).sum(axis=0) for p in parameters]
    change = model.errors.T @ np.stack(along) - model.seat.T @ rod
    change -= change[:, :1] * (rod * rod[:, :1]).sum(axis=0)
    commanded = np.linalg.norm(trajectory.tip - trajectory.nominal.origin, axis=1)
    return Lengths(commanded + change, commanded, model.stroke)
