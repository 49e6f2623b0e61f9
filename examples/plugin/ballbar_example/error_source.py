"""The sensor of axis 1 is not linear: actual angle = shown angle + bend * (shown angle)^2."""

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.sim.errors.base import AngleErrorSource


class BentScale(AngleErrorSource):
    """The sensor of axis 1 is not linear."""

    bend_per_rad: float = 1e-3
    """Error at 1 rad from zero."""

    def shown(self, q: Array, *_: np.random.Generator) -> Array:
        shown = 2.0 * q[:, :1] / (1.0 + np.sqrt(1.0 + 4.0 * self.bend_per_rad * q[:, :1]))
        return np.hstack((shown, q[:, 1:]))
