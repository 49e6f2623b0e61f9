"""Ball-bar encoders: mounted off the axis, eccentric and elliptic graduation.

One to three cycles a turn, of unknown phase: sine and cosine each have half of the variance.
"""

from __future__ import annotations

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.ident.corrections.base import BAR, Coefficient, Correction, State
from ballbar.ident.corrections.gear_ripple import SQRT2, WAVES

# [rad] of 1, 2, 3 cycles a turn; the first is that of the mounting, 3.0e-4, and of the graduation,
# 6.0e-5, together (notes/plant, encoder_error_model).
AMPLITUDES = (3.1e-4, 2.5e-5, 8.0e-6)


def encoder_harmonics(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """Sine and cosine amplitudes [rad] of each encoder.

    The graduation turns with the joint, whatever the counter says, so the angles include the
    encoder offsets.
    """
    terms = [
        (joint, order, amplitude, wave)
        for joint in encoders
        for order, amplitude in enumerate(AMPLITUDES, start=1)
        for wave in WAVES
    ]

    def regressors(state: State) -> list[Array]:
        return [WAVES[wave](order * state.bar[joint - 1]) for joint, order, _, wave in terms]

    coefficients = tuple(
        Coefficient(
            f"encoder{joint}_{order}_{wave}", "rad", 0.0, amplitude / SQRT2, BAR + joint - 1
        )
        for joint, order, amplitude, wave in terms
    )
    return Correction("encoder_harmonics", "eccentric encoders", coefficients, regressors)
