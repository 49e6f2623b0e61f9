"""A socket that holds the target, a ball, at one point."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.instruments.base import Instrument, Kind, Sight, TrueStand, seat_axes
from ballbar.cell.placement import Placement


class SocketSeat(Kind):
    """No value: the target stands at the seat's origin, within the socket's play."""

    name = "socket"
    chains = (("ball",),)
    noun = "touched sockets"
    names: ClassVar[tuple[str, ...]] = ()
    units: ClassVar[tuple[str, ...]] = ()
    directions = 3
    seat_turns = False
    local = True
    sighted = False
    scales = False

    def sight(self, values: Array, seat: Placement, predicted: Array) -> Sight:
        """The seat's origin, at every pose."""
        del values
        n = predicted.shape[1]
        return Sight(np.repeat(seat.origin[:, None], n, axis=1), seat_axes(seat, n))

    def measure(self, stand: TrueStand, noise: Array, instrument: Instrument) -> Array:
        """(N, 0)"""
        del noise, instrument
        return np.zeros((stand.distance.size, 0))

    def sigma(self, values: Array, instrument: Instrument) -> Array:
        """(N, 3) [m] play along each axis"""
        return np.full((len(values), 3), instrument.sigma_length)

    def brought(self, rod: Array, shares: Array, least: float, most: float) -> Array:
        """The socket."""
        del shares, least, most
        return np.zeros_like(rod)


KIND = SocketSeat()
