"""The rod's length wanders with a force that nothing else shows.

What kinematics alone leave on a machine with rigid gears is the strain of its rod: some micrometres
that neighbouring samples share, so that they are no white noise. With the force as a spline and the
catalogue's compliance they are taken up; the two are one product, so the compliance is held.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.descriptions import Cell
from ballbar.ident.corrections.base import ROD, Coefficient, Correction, remade

ROD_ELONGATION = "rod_elongation"
HELD = 1e-3  # of the compliance


@remade
def rod_elongation(cell: Cell) -> Correction:
    """The catalogue's compliance [m/N], held."""
    compliance = 1.0 / cell.ballbar.axial_stiffness
    coefficient = Coefficient("elongation", "m/N", compliance, HELD * compliance, ROD)
    return Correction(
        ROD_ELONGATION,
        "elongation of the rod",
        (coefficient,),
        lambda state: [state.tension],
        lambda state: [np.ones_like(state.tension)],
    )
