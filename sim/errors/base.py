"""What an error source of a plug-in is: the keys of a scenario, and what they do."""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.schema import Strict


class AngleErrorSource(Strict):
    """An error of the angles that the robot shows. The fields of a subclass are its keys."""

    def shown(self, q: Array, machine: np.random.Generator, noise: np.random.Generator) -> Array:
        """(N, J) [rad] joint angles that are logged in place of q (N, J) [rad].

        machine : draws the same for every recording of a machine. noise : for this recording.
        """
        raise NotImplementedError
