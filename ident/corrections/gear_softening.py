"""Gears that are softer under a small load: a second slope below a knee.

The stiffness of a reducer's data sheet is a polygon: K1 up to a few percent of the rated torque, K2
beyond (Nabtesco RV and Harmonic Drive catalogues). Beside the compliance of the first slope beyond
the knee, so much more holds below it. Knees are found by evidence (ballbar.ident.softening); the
names of the coefficients (`soft2_54.2`) hold them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction, State, remade

GEAR_SOFTENING = "gear_softening"
SPREAD = 1.0  # of the catalogue compliance: half as stiff
_COEFFICIENT = re.compile(r"soft([1-9]\d*)_(\d+(?:\.\d+)?(?:e[+-]?\d+)?)")


def _coefficient(gear: int, knee: float, compliance: float) -> Coefficient:
    """The compliance [rad/(N m)] of a gear below a knee [N m]; compliance : of the whole gear."""
    name = f"soft{gear + 1}_{knee:.10g}"
    return Coefficient(name, "rad/(N m)", 0.0, SPREAD * compliance, GEAR + gear)


@remade
def gear_softening(robot: Robot, knees: Sequence[tuple[int, float]]) -> Correction:
    """Compliances [rad/(N m)] of gears (from 0) below their knees [N m], beside the others.

    Raises InputError for a gear that the robot does not have.
    """
    compliance = 1.0 / robot.required("gears").stiffness
    if any(gear >= robot.joints for gear, _ in knees):
        what = f"robot {robot.title} has {robot.joints} gears"
        raise InputError(f"corrections.{GEAR_SOFTENING}: {what}")

    def regressors(state: State) -> list[Array]:
        load = state.loads.gears(state.tension)
        return [-np.clip(load[gear], -knee, knee) for gear, knee in knees]

    def slopes(state: State) -> list[Array]:
        load, per_newton = state.loads.gears(state.tension), state.loads.gear_per_newton
        return [-per_newton[gear] * (np.abs(load[gear]) < knee) for gear, knee in knees]

    coefficients = tuple(_coefficient(gear, knee, float(compliance[gear])) for gear, knee in knees)
    return Correction(GEAR_SOFTENING, "gears softer below a knee", coefficients, regressors, slopes)


def knees_of(names: Iterable[str]) -> list[tuple[int, float]]:
    """Gear, from 0, and knee [N m] of every coefficient, by its name.

    Raises InputError for a name that is none of this correction's.
    """
    knees = []
    for name in names:
        parts = _COEFFICIENT.fullmatch(name)
        if parts is None:
            raise InputError(f"corrections.{GEAR_SOFTENING}.{name}: expected soft2_54.2 or similar")
        knees.append((int(parts[1]) - 1, float(parts[2])))
    return knees
