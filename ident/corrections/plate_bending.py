"""Bending of the offset plate: a hinge a third of its length from its foot (thesis sec. 4.5)."""

from __future__ import annotations

from ballbar.cell.descriptions import Cell
from ballbar.ident.corrections.base import PLATE, Coefficient, Correction

SPREAD = 1.0  # of the catalogue compliance, which leaves out the bolted joint


def plate_bending(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """Compliance of the hinge [rad/(N m)]."""
    compliance = 1.0 / (cell.plate.tip_stiffness * (2.0 / 3.0 * cell.plate.length) ** 2)
    return Correction(
        "plate_bending",
        "bending plate",
        (Coefficient("plate_compliance", "rad/(N m)", compliance, SPREAD * compliance, PLATE),),
        lambda state: [state.loads.plate_moment(state.tension)],
        lambda state: [state.loads.plate_per_newton],
    )
