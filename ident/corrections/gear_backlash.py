"""Play of the gears: the output lies at one end of a dead band, which end depends on the sign of the load."""

from __future__ import annotations

from cell.descriptions import Cell
from ident.corrections.base import GEAR, Coefficient, Correction, sign_slope

SPREAD = 1.0  # of the catalogue width


def gear_backlash(cell: Cell, joints: tuple[int, ...]) -> Correction:
    """Half the width of each gear's dead band [rad]."""
    half = 0.5 * cell.robot.gears.lost_motion
    return Correction(
        "gear_backlash",
        "play of the gears",
        tuple(
            Coefficient(f"backlash{i + 1}", "rad", float(h), SPREAD * float(h), GEAR + i)
            for i, h in enumerate(half)
        ),
        lambda state: list(-state.load_sign()),
        lambda state: list(
            -sign_slope(state.loads.gears(state.tension), state.width[:, None] / state.sharpness)
            * state.loads.gear_per_newton
        ),
    )
