"""Gears of a robot whose file states none: what they yield to the rod, and their backlash.

Beside `unit_weights`, which has the sag under the arm's own weight. The rod's tension acts through
levers that the geometry gives, so only compliances and widths are unknown. Their priors are wide:
what is typical of a robot of this size (cell.typical_machine), and how far published robots are from
it. The flank of the backlash follows the load of the typical masses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cell.descriptions import Cell
from cell.typical_machine import with_typical
from ident.corrections.base import GEAR, Coefficient, Correction, remade
from ident.corrections.gear_backlash import gear_backlash

# Of the typical compliance: stiffness and mass of published robots vary by a factor of 1.8, one
# standard deviation. A wider prior leaves the scale of the tension open, and with it the flank of
# the backlash.
SPREAD = 0.8


@remade
def tension_compliance(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """One compliance a gear [rad/(N m)], under the tension alone."""
    typical = 1.0 / with_typical(cell.robot)[0].required("gears").stiffness
    return Correction(
        "tension_compliance",
        "gears that yield to the rod's tension",
        tuple(
            Coefficient(f"yield{i}", "rad/(N m)", float(c), SPREAD * float(c), GEAR + i - 1)
            for i, c in enumerate(typical, start=1)
        ),
        lambda state: list(-state.loads.gear_per_newton * state.tension),
        lambda state: list(-state.loads.gear_per_newton * np.ones_like(state.tension)),
    )


@remade
def typical_backlash(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """Half the width of each gear's dead band [rad], on the flank of typical loads."""
    typical = replace(cell, robot=with_typical(cell.robot)[0])
    made = gear_backlash(typical, encoders)
    coefficients = tuple(replace(c, name=f"typical_{c.name}") for c in made.coefficients)
    return replace(made, name="typical_backlash", coefficients=coefficients)
