"""Harmonic errors between motor log and gear output: transmission error by orders of the output, resolver by motor turns.

The orders are those of the robot's file and the first two of each motor's turn; a wrong order is no use
(notes/identification sec. 6: 40 taken as 41 leaves half of the error). Sine and cosine of each, phase unknown.
"""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from ident.corrections.base import GEAR, Coefficient, Correction, State

RESOLVER = (
    1.5e-3  # [rad] at the motor, first and second harmonic of a turn (notes/parameters, resolver)
)


def harmonic_orders(cell: Cell) -> list[tuple[int, float, float]]:
    """(gear from 0, cycles a turn of the output, expected amplitude [rad]) of every harmonic."""
    out = []
    for gear, listed in enumerate(cell.robot.gears.harmonics):
        ratio = 1.0 / abs(float(cell.robot.transmission[gear, gear]))
        sizes = dict(listed)
        for order in (ratio, 2.0 * ratio):
            sizes[order] = float(np.hypot(sizes.get(order, 0.0), RESOLVER / ratio))
        out += [(gear, order, size) for order, size in sizes.items()]
    return out


def gear_ripple(cell: Cell, joints: tuple[int, ...]) -> Correction:
    """Sine and cosine amplitudes [rad] of every harmonic, at the gears' outputs."""
    orders = harmonic_orders(cell)
    coefficients = [
        Coefficient(f"ripple{gear + 1}_{order:.6g}_{wave}", "rad", 0.0, size, GEAR + gear)
        for gear, order, size in orders
        for wave in ("sin", "cos")
    ]

    def signals(state: State) -> list[Array]:
        return [
            wave(order * state.gears[gear])
            for gear, order, _ in orders
            for wave in (np.sin, np.cos)
        ]

    return Correction(
        "gear_ripple", "transmission error and resolvers", tuple(coefficients), signals
    )
