"""The force in the rod that a soft servo will let arise on a course, before anything is simulated.

Robots of the size of error that is expected (thesis sec. 5.4) would hold the tool beside the sphere by `g`; servo and gears give way
along the rod until the rod is as long as it is. With tau_1 the torque at each gear per newton of tension, tau_0 what the gears
carry anyway, tau_b the part of it that no feed-forward takes (the ball-bar and the motion),

    F (1/k_rod + sum tau_1^2 (1/k_gear + 1/kp)) = g - sum tau_1 (tau_0 / k_gear + tau_b / kp)

Quasi-static, without friction and play: what a plan needs, and what the check in MuJoCo then measures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.bodies import carried_bodies
from cell.chain import Array
from cell.descriptions import Cell, ServoGains
from cell.dynamics import joint_torques
from cell.geometry import NAMES, PARAMETERS, bar_frames, parameter_screw, robot_frames
from ident.loads import Loads, MassModel, loads, on_ballbar
from planning.course import Course

DRAWS = 8  # robots whose force is predicted
ERROR = 1e-3  # [m, rad] standard deviation of each parameter (physical_parameters.yaml, geometric_error_prior)
CATALOGUE = ("rd1", "rtheta1", "rd3", "ra6")  # not drawn: what the ball-bar's place absorbs, and the plate's known length


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
    errors: Array  # (P, DRAWS) [m, rad] deviations of the robot's parameters
    drawn: tuple[int, ...]  # (P,) indices into PARAMETERS


def force_model(cell: Cell, masses: MassModel, gains: ServoGains, *, seed: int) -> ForceModel:
    """Draws the robots."""
    drawn = tuple(i for i, p in enumerate(PARAMETERS) if p.side == "robot" and p.kind != "beta" and NAMES[i] not in CATALOGUE)
    errors = ERROR * np.random.default_rng(seed).standard_normal((len(drawn), DRAWS))
    return ForceModel(cell, masses, gains, errors, drawn)


def predicted_forces(model: ForceModel, course: Course) -> Forces:
    """Tension of the rod along a course."""
    geometry, cell = course.nominal, model.cell
    carried = loads(model.masses, geometry, course.q, course.b, course.speed, course.acceleration)
    robot, bar = robot_frames(geometry, course.q), bar_frames(geometry, course.b)
    _, wrench = on_ballbar(model.masses, bar, course.b)  # (6, N) per newton
    levers = np.stack([(wrench * parameter_screw(geometry, robot, bar, PARAMETERS[i])).sum(axis=0) for i in model.drawn])
    gap = model.errors.T @ levers
    gap -= gap.mean(axis=1, keepdims=True)  # the ball-bar was placed with this robot: no constant push remains
    per_newton = carried.gear_per_newton
    to_gear = cell.robot.gear_to_joint
    weight = to_gear @ joint_torques(robot, carried_bodies(cell), course.q, gravity=cell.robot.gravity)
    gear, servo = 1.0 / cell.robot.gears.stiffness[:, None], 1.0 / model.gains.kp[:, None]
    compliance = 1.0 / cell.ballbar.axial_stiffness + (per_newton**2 * (gear + servo)).sum(axis=0)
    sag = (per_newton * (carried.gear * gear + (carried.gear - weight) * servo)).sum(axis=0)
    return Forces(carried, np.asarray((gap - sag) / compliance))


def load_reversals(forces: Forces, width: Array) -> Array:
    """(DRAWS, 6) how often each gear's load changes sides of its play: passes from beyond +width to beyond -width or back.

    width : (6,) [N m] (ident.corrections.base.play_width).
    """
    load = forces.carried.gear + forces.tension[:, None, :] * forces.carried.gear_per_newton  # (DRAWS, 6, N)
    side = np.where(load > width[:, None], 1, np.where(load < -width[:, None], -1, 0))
    out = np.zeros(side.shape[:2])
    for k, gear in np.ndindex(side.shape[:2]):
        decided = side[k, gear][side[k, gear] != 0]
        out[k, gear] = np.count_nonzero(np.diff(decided))
    return out
