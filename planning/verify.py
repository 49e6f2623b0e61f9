"""Verification of a planned path in MuJoCo under soft servo, every millisecond against the limits.

The robots have errors of the expected size (thesis Table 3.1, and drawn ones), elastic gears,
backlash and friction. The result counts the instants that violate a limit; a valid plan has none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.closed_form import has_closed_form
from cell.descriptions import Cell
from cell.geometry import Geometry, bar_frames, nominal_chain, nominal_geometry, robot_frames
from cell.numerical_inverse import dexterity
from cell.robot_angles import joints_to_axes
from planning.candidate import PathCandidate
from planning.clearance import Clearance
from planning.limits import arm_margins, from_singular
from planning.request import PlanLimits, PlanRequest
from sim.errors.plant_errors import (
    BarFriction,
    GearBacklash,
    GearFriction,
    JointCompliance,
    PlateBending,
    RodBacklash,
    RodStrain,
)
from sim.errors.static_errors import StaticErrors, true_geometry
from sim.motion import Motion
from sim.path import reference_path
from sim.path_files import PATH_STEP
from sim.plant.effects import Plant, plant_effects, servo_gains
from sim.plant.mujoco_plant import run_plant
from sim.settings import ErrorSettings

TIMESTEP = 1e-3  # [s] (notes/mujoco sec. 2)
# [s] over which speeds and accelerations are taken: a gear that crosses its backlash is no motion
# of the arm
RATE_STEP = 0.05
EVERY = 10  # [-] rows between two singular values, which take longer than an angle
CLEARANCE_STEP = 0.05  # [s] between poses whose distances are measured: 12 mm at the highest speed


@dataclass(frozen=True)
class Check:
    """One limit over one run."""

    limit: str
    worst: float
    allowed: float
    unit: str
    instants: int  # that violate it
    looked_at: int  # instants examined


def plant_errors(*, table: bool) -> ErrorSettings:
    """Errors of a real robot that move or load it; of thesis Table 3.1, or drawn."""
    static = (
        StaticErrors(table="thesis_3_1") if table else StaticErrors(sigma_m=1e-3, sigma_rad=1e-3)
    )
    return ErrorSettings(
        static=static,
        joint_compliance=JointCompliance(),
        gear_backlash=GearBacklash(),
        gear_friction=GearFriction(),
        rod_strain=RodStrain(),
        rod_backlash=RodBacklash(),
        bar_friction=BarFriction(),
        plate_bending=PlateBending(),
    )


def run_in_plant(
    cell: Cell,
    request: PlanRequest,
    candidate: PathCandidate,
    *,
    seed: int,
    beginning: Array | None = None,
) -> Motion:
    """Motion of one robot on the path; seed 0 is the robot of thesis Table 3.1.

    beginning : (J,) [rad] as of `reference_path`: the configuration of the arm that was planned.

    Raises PlantError where the simulation fails.
    """
    nominal, timing = nominal_geometry(cell, candidate.position), request.timing
    path = reference_path(
        cell.robot,
        nominal,
        candidate.shape,
        duration=timing.duration_s,
        dwell=timing.dwell_s,
        stops=timing.stops,
        step=PATH_STEP,
        beginning=beginning,
    )
    errors = plant_errors(table=seed == 0)
    true = set_without_strain(true_geometry(nominal, errors, cell, seed=seed), path.q[:1])
    gains = servo_gains(cell.robot, request.servo, key="servo")
    plant = Plant(cell, true, plant_effects(errors, cell, seed), gains)
    return run_plant(plant, path, timestep=TIMESTEP)


def set_without_strain(true: Geometry, q: Array) -> Geometry:
    """The geometry with the ball-bar's base moved along the rod so that the rod is not strained.

    q : (1, 6) [rad] first target, at which the base is set with the robot at rest.
    """
    rod = robot_frames(true, q).tip[:, 0] - true.origin
    origin = true.origin + rod * (1.0 - true["bd3"] / np.linalg.norm(rod))
    return true.replaced({f"o{axis}": float(v) for axis, v in zip("xyz", origin, strict=True)})


def checks(cell: Cell, limits: PlanLimits, around: Clearance, motion: Motion) -> list[Check]:
    """Every limit at every millisecond of a run, distances every CLEARANCE_STEP."""
    axes = joints_to_axes(cell.robot, motion.q)
    rates = _rate(axes, motion.t)
    inside = np.minimum(axes - cell.robot.axis_lower, cell.robot.axis_upper - axes).min(axis=1)
    fastest = (np.abs(rates) / cell.robot.axis_speed_max).max(axis=1)
    hardest = np.degrees(np.abs(_rate(rates, motion.t))).max(axis=1)
    tip = bar_frames(motion.geometry, motion.b).tip
    speed = np.linalg.norm(_rate(tip.T, motion.t), axis=1)
    singular = np.minimum(from_singular(motion.b[:, 1]), from_singular(motion.b[:, 3]))
    swept = np.degrees(np.ptp(motion.b, axis=0)).max(keepdims=True)
    acceleration = limits.axis_acceleration_deg_per_s2
    distances = around.distances_along(
        motion.geometry, motion.q, motion.b, motion.t, step=CLEARANCE_STEP
    )
    if has_closed_form(nominal_chain(cell.robot)):
        elbow, shoulder = arm_margins(motion.geometry, motion.q)
        wrist = np.degrees(from_singular(motion.q[:, 4]))
        arm = [
            _at_least("wrist_margin_deg", wrist, limits.wrist_margin_deg, "deg"),
            _at_least("elbow_margin_deg", np.degrees(elbow), limits.elbow_margin_deg, "deg"),
            _at_least("shoulder_margin_m", shoulder, limits.shoulder_margin_m, "m"),
        ]
    else:
        value = dexterity(motion.geometry.robot, motion.q[::EVERY])
        arm = [_at_least("singular_value", value, limits.singular_value, "")]
    return [
        _at_least("axis_margin_deg", np.degrees(inside), limits.axis_margin_deg, "deg"),
        _at_most("axis_speed_share", fastest, limits.axis_speed_share, ""),
        _at_most("axis_acceleration_deg_per_s2", hardest, acceleration, "deg/s^2"),
        _at_most("tcp_speed_m_per_s", speed, limits.tcp_speed_m_per_s, "m/s"),
        *arm,
        _at_least("ballbar_margin_deg", np.degrees(singular), limits.ballbar_margin_deg, "deg"),
        _at_most("cable_turns", swept / 360.0, limits.cable_turns, "turns"),
        _at_most("force_N", np.abs(motion.rod_force), limits.force_N, "N"),
        _at_least("clearance_m", distances, limits.clearance_m, "m"),
    ]


def violations_in(run: list[Check]) -> int:
    """Number of instants that violate a limit, over all limits of a run."""
    return sum(check.instants for check in run)


def _rate(values: Array, t: Array) -> Array:
    """Central differences (K, n) over RATE_STEP of values (K, n) at times t (K,) [s]."""
    half = max(1, round(0.5 * RATE_STEP / float(t[1] - t[0])))
    rates = np.zeros_like(values)
    rates[half:-half] = (values[2 * half :] - values[: -2 * half]) / (2 * half * float(t[1] - t[0]))
    return rates


def _at_least(limit: str, values: Array, allowed: float, unit: str) -> Check:
    below = int(np.count_nonzero(values < allowed))
    return Check(limit, float(values.min()), allowed, unit, below, values.size)


def _at_most(limit: str, values: Array, allowed: float, unit: str) -> Check:
    above = int(np.count_nonzero(values > allowed))
    return Check(limit, float(values.max()), allowed, unit, above, values.size)
