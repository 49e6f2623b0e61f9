"""Elastic gears: the output lags by load / stiffness (thesis sec. 2.3)."""

from __future__ import annotations

import numpy as np

from ballbar.cell.descriptions import Robot
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction, remade

# Of the catalogue compliance: gears of one class differ by a factor of 1.7 (notes/plant,
# irb2400: range of the stiffness), and the links' own compliance adds to it.
SPREAD = 0.5


@remade
def joint_compliance(robot: Robot) -> Correction:
    """One compliance a gear [rad/(N m)]."""
    return Correction(
        "joint_compliance",
        "elastic gears",
        tuple(
            Coefficient(f"compliance{i}", "rad/(N m)", float(c), SPREAD * float(c), GEAR + i - 1)
            for i, c in enumerate(1.0 / robot.required("gears").stiffness, start=1)
        ),
        lambda state: list(-state.loads.gears(state.tension)),
        lambda state: list(-state.loads.gear_per_newton * np.ones_like(state.tension)),
    )
