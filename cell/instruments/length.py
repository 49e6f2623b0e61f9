"""A length from the seat to the target: telescoping ball-bar, draw-wire."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cell.arrays import Array
from cell.instruments.base import Kind, Sight
from cell.placement import Placement

if TYPE_CHECKING:
    from cell.instrument import Instrument


class SensedLength(Kind):
    """The distance of the target from the seat's origin."""

    name = "length"
    chains = (("universal", "prismatic*", "ball"), ("ball", "prismatic*", "ball"))
    columns, directions = 1, 1
    seat_turns = False
    local = True

    def sight(self, values: Array, seat: Placement, predicted: Array) -> Sight:
        """The rod points at the predicted target."""
        rod = predicted - seat.origin[:, None]
        along = rod / np.maximum(np.linalg.norm(rod, axis=0), np.finfo(float).tiny)
        return Sight(seat.origin[:, None] + values[:, 0] * along, along[None])

    def measure(self, rod: Array, rotation: Array, noise: Array, instrument: Instrument) -> Array:
        """(N, 1) [m]"""
        del rotation
        length = np.linalg.norm(rod, axis=0) + instrument.sigma_length * noise[0]
        return np.asarray(length[:, None])

    def sigma(self, values: Array, instrument: Instrument) -> Array:
        """(N, 1) [m]"""
        return np.full((len(values), 1), instrument.sigma_length)


KIND = SensedLength()
