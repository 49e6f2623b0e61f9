"""Joint errors of whole orders, found by evidence: so many cycles a turn of a joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cell.arrays import Array
from ident.corrections.base import GEAR, Coefficient, Correction, State

# [rad] of each amplitude; 2e-4 gives the same (docs/real_robots, orders)
PRIOR = 3e-4
WAVES = {"cos": np.cos, "sin": np.sin}


def joint_harmonics(orders: Sequence[tuple[int, int]]) -> Correction:
    """Cosine and sine amplitudes [rad] of each pair of joint (from 0) and order."""
    terms = [(joint, order, wave) for joint, order in orders for wave in WAVES]

    def regressors(state: State) -> list[Array]:
        return [WAVES[wave](order * state.gears[joint]) for joint, order, wave in terms]

    coefficients = tuple(
        Coefficient(f"joint{joint + 1}_{order}_{wave}", "rad", 0.0, PRIOR, GEAR + joint)
        for joint, order, wave in terms
    )
    return Correction("joint_harmonics", "errors of the joints", coefficients, regressors)
