"""A belt of BELT teeth a turn drives axis 1: its pitch error is a harmonic of that order."""

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction, State

BELT = 17.0
WAVES = {"belt1_sin": np.sin, "belt1_cos": np.cos}  # both, since the phase is unknown


def belt_ripple(_cell: Cell, _encoders: tuple[int, ...]) -> Correction:
    """Sine and cosine amplitude [rad]."""
    each = tuple(Coefficient(n, "rad", mean=0.0, sigma=1e-4, channel=GEAR) for n in WAVES)
    return Correction("belt_ripple", "pitch error of the belt", each, _regressors)


def _regressors(state: State) -> list[Array]:
    return [wave(BELT * state.gears[0]) for wave in WAVES.values()]
