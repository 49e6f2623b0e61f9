"""A length from the seat to the target: telescoping ball-bar, draw-wire."""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.instruments.base import Instrument, Kind, Sight, TrueStand
from ballbar.cell.placement import Placement


class SensedLength(Kind):
    """The distance of the target from the seat's origin."""

    name = "length"
    chains = (("universal", "prismatic*", "ball"), ("ball", "prismatic*", "ball"))
    noun = "distances"
    names, units = ("length",), ("m",)
    directions = 1
    judged = "distance"
    seat_turns = False
    local = True

    def sight(self, values: Array, seat: Placement, predicted: Array) -> Sight:
        """The rod points at the predicted target."""
        rod = predicted - seat.origin[:, None]
        along = rod / np.maximum(np.linalg.norm(rod, axis=0), np.finfo(float).tiny)
        return Sight(seat.origin[:, None] + values[:, 0] * along, along[None])

    def measure(self, stand: TrueStand, noise: Array, instrument: Instrument) -> Array:
        """(N, 1) [m]"""
        length = stand.distance + instrument.sigma_length * noise[0]
        return np.asarray(length[:, None])

    def sigma(self, values: Array, instrument: Instrument) -> Array:
        """(N, 1) [m]"""
        return np.full((len(values), 1), instrument.sigma_length)

    def seat_of(self, values: Array, points: Array) -> Placement:
        """By trilateration, linear in the seat o and its square: `2 p.o - |o|^2 = |p|^2 - L^2`."""
        matrix = np.hstack((2.0 * points, -np.ones((len(points), 1))))
        right = (points**2).sum(axis=1) - values[:, 0] ** 2
        return Placement(np.eye(3), np.linalg.lstsq(matrix, right, rcond=1e-6)[0][:3])

    def brought(self, rod: Array, shares: Array, least: float, most: float) -> Array:
        """Where they are, or where the rod is within its range."""
        distance = np.linalg.norm(rod, axis=1)
        inside = (distance >= least) & (distance <= most)
        length = np.where(inside, distance, least + shares * (most - least))
        return np.asarray(rod * (length / np.maximum(distance, 1e-9))[:, None])


KIND = SensedLength()
