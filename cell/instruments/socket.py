"""A socket that holds the target, a ball, at one point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cell.arrays import Array
from cell.instruments.base import Kind, Sight, seat_axes
from cell.placement import Placement

if TYPE_CHECKING:
    from cell.instrument import Instrument


class SocketSeat(Kind):
    """No value: the target stands at the seat's origin, within the socket's play."""

    name = "socket"
    chains = (("ball",),)
    columns, directions = 0, 3
    seat_turns = False
    local = True
    scales = False

    def sight(self, values: Array, seat: Placement, predicted: Array) -> Sight:
        """The seat's origin, at every pose."""
        del values
        n = predicted.shape[1]
        return Sight(np.repeat(seat.origin[:, None], n, axis=1), seat_axes(seat, n))

    def measure(self, rod: Array, rotation: Array, noise: Array, instrument: Instrument) -> Array:
        """(N, 0)"""
        del rotation, noise, instrument
        return np.zeros((rod.shape[1], 0))

    def sigma(self, values: Array, instrument: Instrument) -> Array:
        """(N, 3) [m] play along each axis"""
        return np.full((len(values), 3), instrument.sigma_length)


KIND = SocketSeat()
