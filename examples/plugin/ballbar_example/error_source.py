"""The belt of axis 1 in a simulation; its phase is drawn."""

import numpy as np

from ballbar.cell.schema import NotNegative
from ballbar.sim.errors.base import ErrorSource, GearHarmonics


class BeltRipple(ErrorSource):
    """The belt of axis 1 has a pitch error."""

    teeth: NotNegative = 17.0
    """Cycles per turn of the axis."""
    amplitude_rad: NotNegative = 1.0e-4
    """Amplitude at the axis."""

    def ripples(self, _joints: int, rng: np.random.Generator) -> GearHarmonics:
        """One harmonic of gear 0."""
        yield 0, self.teeth, self.amplitude_rad, rng.uniform(0.0, 2.0 * np.pi)
