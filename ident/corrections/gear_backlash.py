"""Backlash of the gears: the output lies on one flank of a dead band, by the sign of the load."""

from __future__ import annotations

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction, State, remade, sign_slope

SPREAD = 1.0  # of the catalogue's lost motion: it grows with wear, and a new gear may have none


@remade
def gear_backlash(robot: Robot) -> Correction:
    """Half the width of each gear's dead band [rad]."""

    def slopes(state: State) -> list[Array]:
        width = state.width[:, None] / state.sharpness
        slope = sign_slope(state.loads.gears(state.tension), width)
        return list(-slope * state.loads.gear_per_newton)

    return Correction(
        "gear_backlash",
        "backlash of the gears",
        tuple(
            Coefficient(f"backlash{i}", "rad", float(h), SPREAD * float(h), GEAR + i - 1)
            for i, h in enumerate(0.5 * robot.required("gears").lost_motion, start=1)
        ),
        lambda state: list(-state.load_sign()),
        slopes,
    )
