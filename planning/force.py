"""The force in the rod that a soft servo will let arise on a course, before anything is simulated.

Robots of the size of error that is expected (thesis sec. 5.4) would hold the tool beside the sphere by `g`; servo and gears give way
along the rod until the rod is as long as it is. With tau_1 the torque at each gear per newton of tension, tau_0 what the gears
carry anyway, tau_b the part of it that no feed-forward takes (the ball-bar, the motion, friction),

    F (1/k_rod + sum tau_1^2 (1/k_gear + 1/kp)) = g - sum tau_1 (tau_0 / k_gear + tau_b / kp)

Quasi-static, without play: what a plan needs, and what the check in MuJoCo then measures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.bodies import carried_bodies
from cell.descriptions import Cell, ServoGains
from cell.dynamics import joint_torques
from cell.geometry import INDEX, PARAMETERS, bar_frames, parameter_screw, robot_frames
from ident.loads.gear_loads import Loads, MassModel, loads, on_ballbar
from planning.course import Course
from sim.errors.static_errors import THESIS_3_1

CREEP = 1e-3  # [rad/s] speed at which friction has most of its size
DRAWS = 8  # robots whose force is predicted
ERROR = (
    1e-3  # [m, rad] standard deviation of each parameter (notes/parameters, geometric_error_prior)
)


@dataclass(frozen=True, eq=False)
class Forces:
    """Of DRAWS robots on one course."""

    carried: Loads
    tension: Array  # (DRAWS, N) [N]

    @property
    def largest(self) -> float:
        """[N] over robots and time."""
        return float(np.abs(self.tension).max())


@dataclass(frozen=True, eq=False)
class ForceModel:
    """What does not depend on the course."""

    cell: Cell
    masses: MassModel
    gains: ServoGains
    errors: Array  # (P, DRAWS) [m, rad] deviations of robot, rod and the ball-bar's place, as in thesis Table 3.1
    drawn: tuple[int, ...]  # (P,) indices into PARAMETERS


def force_model(cell: Cell, masses: MassModel, gains: ServoGains, *, seed: int) -> ForceModel:
    """Draws the robots."""
    drawn = tuple(INDEX[name] for name in THESIS_3_1)
    errors = ERROR * np.random.default_rng(seed).standard_normal((len(drawn), DRAWS))
    return ForceModel(cell, masses, gains, errors, drawn)


def predicted_forces(model: ForceModel, course: Course) -> Forces:
    """Tension of the rod along a course."""
    geometry, cell = course.nominal, model.cell
    carried = loads(model.masses, geometry, course.q, course.b, course.speed, course.acceleration)
    robot, bar = robot_frames(geometry, course.q), bar_frames(geometry, course.b)
    _, wrench = on_ballbar(model.masses, bar, course.b)  # (6, N) per newton
    away = [
        1.0 if PARAMETERS[i].side == "robot" else -1.0 for i in model.drawn
    ]  # the tool moves out, or the rod's end after it
    levers = np.stack(
        [
            s * (wrench * parameter_screw(geometry, robot, bar, PARAMETERS[i])).sum(axis=0)
            for i, s in zip(model.drawn, away, strict=True)
        ]
    )
    gap = model.errors.T @ levers
    rod = bar.z[2]
    gap -= gap[:, :1] * (rod * rod[:, :1]).sum(
        axis=0
    )  # the base was set without strain at the first target: along the rod there
    per_newton = carried.gear_per_newton
    to_gear = cell.robot.gear_to_joint
    weight = to_gear @ joint_torques(
        robot, carried_bodies(cell), course.q, gravity=cell.robot.gravity
    )
    gear, servo = 1.0 / cell.robot.gears.stiffness[:, None], 1.0 / model.gains.kp[:, None]
    compliance = 1.0 / cell.ballbar.axial_stiffness + (per_newton**2 * (gear + servo)).sum(axis=0)
    rubbing = _friction(cell, (course.speed @ cell.robot.joint_to_gear).T)
    sag = (per_newton * (carried.gear * gear + (carried.gear - weight + rubbing) * servo)).sum(
        axis=0
    )
    return Forces(carried, np.asarray((gap - sag) / compliance))


def _friction(cell: Cell, speed: Array) -> Array:
    """(6, N) [N m] of the gears at speeds (6, N) [rad/s], Coulomb and viscous."""
    gears = cell.robot.gears
    return np.asarray(
        gears.coulomb[:, None] * np.tanh(speed / CREEP) + gears.viscous[:, None] * speed
    )


def load_reversals(forces: Forces, width: Array) -> Array:
    """(DRAWS, 6) how often each gear's load changes sides of its play: passes from beyond +width to beyond -width or back.

    width : (6,) [N m] (ident.corrections.base.backlash_transition).
    """
    load = (
        forces.carried.gear + forces.tension[:, None, :] * forces.carried.gear_per_newton
    )  # (DRAWS, 6, N)
    side = np.where(load > width[:, None], 1, np.where(load < -width[:, None], -1, 0))
    out = np.zeros(side.shape[:2])
    for k, gear in np.ndindex(side.shape[:2]):
        decided = side[k, gear][side[k, gear] != 0]
        out[k, gear] = np.count_nonzero(np.diff(decided))
    return out
