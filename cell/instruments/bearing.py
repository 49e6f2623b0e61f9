"""Two angles at which the seat sees the target: theodolite, camera that is aimed.

The distance is not sensed, so bearings alone leave the scale open: two seats at a known distance,
or any other instrument in the same fit, tell it.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.instruments.base import Instrument, Kind, Sight, TrueStand
from ballbar.cell.placement import Placement
from ballbar.cell.rigid_fit import nearest_rotation


class SensedBearing(Kind):
    """Azimuth about the seat's z axis from its x axis, and elevation above its xy plane [rad]."""

    name = "bearing"
    chains = (("revolute*", "revolute*", "prismatic", "ball"),)
    noun = "bearings"
    names, units = ("azimuth", "elevation"), ("rad", "rad")
    directions = 2
    judged = "position across the line of sight"
    scales = False

    def sight(self, values: Array, seat: Placement, predicted: Array) -> Sight:
        """The point of the line of sight that is nearest to the predicted target."""
        (ca, ce), (sa, se) = np.cos(values.T), np.sin(values.T)
        along = seat.rotation @ np.stack((ce * ca, ce * sa, se))
        distance = ((predicted - seat.origin[:, None]) * along).sum(axis=0)
        sideways = seat.rotation @ np.stack((-ce * sa, ce * ca, np.zeros_like(ca)))
        upward = seat.rotation @ np.stack((-se * ca, -se * sa, ce))
        return Sight(
            seat.origin[:, None] + distance * along, distance * np.stack((sideways, upward))
        )

    def measure(self, stand: TrueStand, noise: Array, instrument: Instrument) -> Array:
        """(N, 2) [rad]"""
        x, y, z = stand.rod
        elevation = np.arcsin(z / stand.distance)
        error = instrument.sigma_direction * noise[1:3]
        azimuth = np.arctan2(y, x) + error[0] / np.cos(elevation)
        return np.stack((azimuth, elevation + error[1]), axis=1)

    def sigma(self, values: Array, instrument: Instrument) -> Array:
        """(N, 2) [rad]"""
        across = instrument.sigma_direction / np.cos(values[:, 1])
        return np.stack((across, np.full(len(values), instrument.sigma_direction)), axis=1)

    def seat_of(self, values: Array, points: Array) -> Placement:
        """By the direct linear transformation: `u x (A p + b) = 0` (Abdel-Aziz & Karara 1971)."""
        (ca, ce), (sa, se) = np.cos(values.T), np.sin(values.T)
        along = np.stack((ce * ca, ce * sa, se), axis=1)
        known = np.hstack((points, np.ones((len(points), 1))))
        cross = np.cross(np.eye(3)[None], along[:, None], axis=2)  # (N, 3, 3)
        rows = -np.einsum("nij,nk->njik", cross, known).reshape(3 * len(points), 12)
        matrix = np.linalg.svd(rows)[2][-1].reshape(3, 4)
        if ((known @ matrix.T) * along).sum() < 0.0:
            matrix = -matrix
        linear, shift = matrix[:, :3], matrix[:, 3]
        return Placement(nearest_rotation(linear.T), -np.linalg.solve(linear, shift))


KIND = SensedBearing()
