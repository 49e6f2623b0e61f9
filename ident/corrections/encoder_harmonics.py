"""Ball-bar encoders: graduation off centre and elliptic, one to three cycles a turn."""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from ident.corrections.base import BAR, Coefficient, Correction, State

AMPLITUDES = (
    6.0e-5,
    2.5e-5,
    8.0e-6,
)  # [rad] expected, of 1, 2 and 3 cycles a turn (notes/parameters, encoder)


def encoder_harmonics(cell: Cell, joints: tuple[int, ...]) -> Correction:
    """Sine and cosine amplitudes [rad] of each fitted encoder."""
    coefficients = [
        Coefficient(f"encoder{joint}_{order + 1}_{wave}", "rad", 0.0, size, BAR + joint - 1)
        for joint in joints
        for order, size in enumerate(AMPLITUDES)
        for wave in ("sin", "cos")
    ]

    def signals(state: State) -> list[Array]:
        return [
            wave((order + 1) * state.bar[j - 1])
            for j in joints
            for order in range(len(AMPLITUDES))
            for wave in (np.sin, np.cos)
        ]

    return Correction("encoder_harmonics", "eccentric encoders", tuple(coefficients), signals)
