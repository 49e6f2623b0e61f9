"""The tool was taken off between recordings and sits elsewhere in the later ones.

The first recording's tool is the machine's; the known length of the plate stays its.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import parameter_named
from ballbar.ident.corrections.base import Coefficient, Correction, State

# clearance holes, a face that was wiped (notes/identification sec. 7); a dowel pin leaves a fifth
SHIFT, TURN = 1e-4, 2.5e-4  # [m], [rad]
# all six directions: the last encoder has an offset in each recording, so `theta` shifts the tool
KINDS = ("a", "d", "alpha", "theta", "beta")


def remounted_tool(cell: Cell, recordings: int) -> Correction:
    """Changes [m, rad] of the last row from the first recording to each later one."""
    row = [parameter_named(f"r{kind}{cell.robot.joints}") for kind in KINDS]

    def regressors(state: State) -> list[Array]:
        return [
            np.full_like(state.t, float(state.recording == k))
            for k in range(1, recordings)
            for _ in row
        ]

    coefficients = tuple(
        Coefficient(f"remount_{p.name}@{k + 1}", p.unit, 0.0, SHIFT if p.is_length else TURN, p)
        for k in range(1, recordings)
        for p in row
    )
    return Correction("remounted_tool", "remounted tool", coefficients, regressors)
