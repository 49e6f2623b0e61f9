"""Harmonic errors between motor log and gear output: transmission error and resolver.

The orders are those of the robot's file, per turn of the output, and the first two of each motor's
turn; a wrong order does not help (notes/identification sec. 6: 40 taken as 41 leaves half of the
error). Sine and cosine of each, since the phase is unknown: of an expected amplitude A each has the
variance A^2 / 2 (arcsine distribution, JCGM 101:2008, 6.4.6).
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction, State, remade

RESOLVER = 1.5e-3  # [rad] at the motor, 1 and 2 cycles a turn (notes/plant, motor_position_sensor)
SQRT2 = float(np.sqrt(2.0))
WAVES = {"sin": np.sin, "cos": np.cos}


def harmonic_orders(robot: Robot) -> list[tuple[int, float, float]]:
    """Gear from 0, cycles a turn of its output, expected amplitude [rad] of every harmonic."""
    out = []
    for gear, listed in enumerate(robot.required("gears").harmonics):
        ratio = 1.0 / abs(float(robot.transmission[gear, gear]))
        sizes = dict(listed)
        for order in (ratio, 2.0 * ratio):
            sizes[order] = float(np.hypot(sizes.get(order, 0.0), RESOLVER / ratio))
        out += [(gear, order, size) for order, size in sizes.items()]
    return out


@remade
def gear_ripple(robot: Robot) -> Correction:
    """Sine and cosine amplitudes [rad] of every harmonic, at the gears' outputs."""
    terms = [(*order, wave) for order in harmonic_orders(robot) for wave in WAVES]

    def regressors(state: State) -> list[Array]:
        return [WAVES[wave](order * state.gears[gear]) for gear, order, _, wave in terms]

    coefficients = tuple(
        Coefficient(f"ripple{gear + 1}_{order:.6g}_{wave}", "rad", 0.0, size / SQRT2, GEAR + gear)
        for gear, order, size, wave in terms
    )
    return Correction("gear_ripple", "transmission error and resolvers", coefficients, regressors)
