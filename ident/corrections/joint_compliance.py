"""Elastic gears: the output stays behind by load / stiffness (thesis sec. 2.3, "robot deformation under load")."""

from __future__ import annotations

import numpy as np

from cell.descriptions import Cell
from ident.corrections.base import GEAR, Coefficient, Correction

SPREAD = 0.5  # of the catalogue compliance; stiffness of one type scatters by about 30 %


def joint_compliance(cell: Cell, joints: tuple[int, ...]) -> Correction:
    """One compliance a gear [rad/(N m)]."""
    nominal = 1.0 / cell.robot.gears.stiffness
    return Correction(
        "joint_compliance",
        "elastic gears",
        tuple(
            Coefficient(f"compliance{i + 1}", "rad/(N m)", float(c), SPREAD * float(c), GEAR + i)
            for i, c in enumerate(nominal)
        ),
        lambda state: list(-state.loads.gears(state.tension)),
        lambda state: list(-state.loads.gear_per_newton * np.ones_like(state.tension)),
    )
