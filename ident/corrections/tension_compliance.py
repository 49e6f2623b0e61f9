"""Gears that yield to the tension of a ball-bar's rod, of a robot whose stiffness nobody states.

It stands beside `unit_weights`, which has the sag under the arm's own weight: the tension acts
through a lever that the geometry gives, so only the compliance of each gear is unknown. Its prior
is wide: the typical compliance of a robot of this size (cell.typical_machine) give or take twice of
it, where published robots differ by a factor of 2 (one standard deviation).
"""

from __future__ import annotations

import numpy as np

from cell.descriptions import Cell
from cell.typical_machine import with_typical
from ident.corrections.base import GEAR, Coefficient, Correction, remade

SPREAD = 2.0  # of the typical compliance


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
