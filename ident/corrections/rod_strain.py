"""Axial compliance and backlash of the rod, its joints and the base below (thesis sec. 5.3).

A base that shifts by force / stiffness moves the ball-bar's end along the rod exactly as strain
does: one compliance stands for both. The path's forces move the rod by a few micrometres only, so
the prior carries much of the answer.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.descriptions import Cell
from ballbar.ident.corrections.base import ROD, TENSION_WIDTH, Coefficient, Correction, sign_slope

SPREAD = 0.7  # of the catalogue compliance: a base as stiff as 5e7 N/m adds half of it


def rod_strain(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """Compliance [m/N] along the rod and half the width of its backlash [m]."""
    compliance, half = 1.0 / cell.ballbar.axial_stiffness, 0.5 * cell.ballbar.backlash
    return Correction(
        "rod_strain",
        "strain and backlash of the rod",
        (
            Coefficient("rod_compliance", "m/N", compliance, SPREAD * compliance, ROD),
            Coefficient("rod_backlash", "m", half, half, ROD),
        ),
        lambda state: [state.tension, state.tension_sign()],
        lambda state: [
            np.ones_like(state.tension),
            sign_slope(state.tension, TENSION_WIDTH / state.sharpness),
        ],
    )
