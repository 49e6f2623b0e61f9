"""Verification of a planned path in MuJoCo under soft servo, every millisecond against the limits.

The robots have errors of the expected size (thesis Table 3.1, and drawn ones), elastic gears,
backlash and friction. The result counts the instants that violate a limit; a valid plan has none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import bar_frames, nominal_geometry
from ballbar.cell.typical_machine import with_typical
from ballbar.planning.candidate import PathCandidate
from ballbar.planning.clearance import Clearance
from ballbar.planning.limits import CROSSING, LimitedValue, limited, measures
from ballbar.planning.request import PlanLimits, PlanRequest
from ballbar.planning.trajectory import Trajectory
from ballbar.sim.errors.plant_errors import (
    BarFriction,
    GearBacklash,
    GearFriction,
    JointCompliance,
    PlateBending,
    RodBacklash,
    RodStrain,
)
from ballbar.sim.errors.static_errors import StaticErrors, set_without_strain, true_geometry
from ballbar.sim.motion import Motion
from ballbar.sim.path import reference_path
from ballbar.sim.path_files import PATH_STEP
from ballbar.sim.plant.effects import Plant, plant_effects, servo_gains
from ballbar.sim.plant.mujoco_plant import run_plant
from ballbar.sim.settings import ErrorSettings
from ballbar.sim.streams import stream

TIMESTEP = 1e-3  # [s] (notes/plant sec. 2)
# [s] over which speeds and accelerations are taken: a gear that crosses its backlash is no motion
# of the arm
RATE_STEP = 0.05
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
    What the robot's file lacks is typical for seed 0, else drawn about it.

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
    robot, typical = with_typical(cell.robot)
    if typical.keys and seed:
        robot = typical.drawn(robot, stream(seed, "typical_machine"))
    cell, gains = replace(cell, robot=robot), servo_gains(robot, request.servo, key="servo")
    plant = Plant(cell, true, plant_effects(errors, cell, seed), gains)
    return run_plant(plant, path, timestep=TIMESTEP)


def checks(cell: Cell, limits: PlanLimits, around: Clearance, motion: Motion) -> list[Check]:
    """Every limit at every millisecond of a run, distances every CLEARANCE_STEP."""
    geometry, q, b, t = motion.geometry, motion.q, motion.b, motion.t
    speed, tip = _rate(q, t), bar_frames(geometry, b).tip.T
    moved = Trajectory(
        nominal=geometry,
        t=t,
        b=b,
        q=q,
        speed=speed,
        acceleration=_rate(speed, t),
        tip=tip,
        tip_speed=np.linalg.norm(_rate(tip, t), axis=1),
    )
    turns = np.ptp(b, axis=0).max(keepdims=True) / (2.0 * np.pi)
    force, distances = (
        np.abs(motion.rod_force),
        around.distances_along(geometry, q, b, t, step=CLEARANCE_STEP),
    )
    of_limits: dict[str, list[LimitedValue]] = {}
    for value in (
        *measures(cell, limits, moved),
        limited("cable_turns", turns, limits.cable_turns, "turns", 1.0, ""),
        limited("force_N", force, limits.force_N, "N", 1.0, ""),
        limited("clearance_m", distances, limits.clearance_m, "m", -1.0, ""),
    ):
        of_limits.setdefault(value.limit, []).append(value)
    return [_checked(*values) for values in of_limits.values()]


def _checked(first: LimitedValue, *others: LimitedValue) -> Check:
    """The worst of the values of one limit, and the instants at which any of them violates it."""
    values = (first, *others)
    worst = max((v for v in values if v.unit != CROSSING), key=lambda v: float(v.excess.max()))
    violated = np.any([value.excess > 0.0 for value in values], axis=0)
    return Check(
        limit=first.limit,
        worst=float(worst.value[worst.excess.argmax()]),
        allowed=first.allowed,
        unit=first.unit,
        instants=int(np.count_nonzero(violated)),
        looked_at=violated.size,
    )


def violations_in(run: list[Check]) -> int:
    """Number of instants that violate a limit, over all limits of a run."""
    return sum(check.instants for check in run)


def _rate(values: Array, t: Array) -> Array:
    """Central differences (K, n) over RATE_STEP of values (K, n) at times t (K,) [s]."""
    half = max(1, round(0.5 * RATE_STEP / float(t[1] - t[0])))
    rates = np.zeros_like(values)
    rates[half:-half] = (values[2 * half :] - values[: -2 * half]) / (2 * half * float(t[1] - t[0]))
    return rates
