"""The distance of the target from a plane: touch probe or dial gauge against a plate."""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.instruments.base import Instrument, Kind, Sight, TrueStand, across
from ballbar.cell.placement import Placement

_TILTS = 3  # rounds of tilting the normal, each linear
_HALF = 0.3  # [m] of the plate's side: a probe that is beyond it is brought back onto it


class TouchedPlane(Kind):
    """The height [m] of the target above the seat's xy plane."""

    name = "plane"
    chains = (("prismatic", "prismatic", "prismatic*", "ball"),)
    noun = "touched planes"
    names, units = ("height",), ("m",)
    directions = 1
    judged = "height"
    seat_fixed = False  # a plane does not show where on it the seat is
    local = True
    sighted = False
    scales = False  # a height near zero tells no scale

    def sight(self, values: Array, seat: Placement, predicted: Array) -> Sight:
        """The predicted target moved along the normal."""
        normal = np.repeat(seat.rotation[:, 2:], predicted.shape[1], axis=1)
        height = ((predicted - seat.origin[:, None]) * normal).sum(axis=0)
        return Sight(predicted + (values[:, 0] - height) * normal, normal[None])

    def measure(self, stand: TrueStand, noise: Array, instrument: Instrument) -> Array:
        """(N, 1) [m]"""
        return np.asarray((stand.rod[2] + instrument.sigma_length * noise[0])[:, None])

    def sigma(self, values: Array, instrument: Instrument) -> Array:
        """(N, 1) [m]"""
        return np.full((len(values), 1), instrument.sigma_length)

    def seat_of(self, values: Array, points: Array) -> Placement:
        """The plane nearest to the points, its normal on the side that explains the heights."""
        middle, height = points.mean(axis=0), values[:, 0]
        arm = points - middle
        normal = np.linalg.svd(arm)[2][2]
        if (arm @ normal) @ (height - height.mean()) < 0.0:
            normal = -normal
        for _ in range(_TILTS):
            axes = across(normal[:, None])[:, :, 0]
            rows = np.column_stack((arm @ axes.T, -np.ones(len(arm))))
            tilt = np.linalg.lstsq(rows, height - arm @ normal, rcond=None)[0]
            normal = normal + tilt[:2] @ axes
            normal /= np.linalg.norm(normal)
        first = across(normal[:, None])[0, :, 0]
        origin = middle + (arm @ normal - height).mean() * normal
        return Placement(np.stack((first, np.cross(normal, first), normal), axis=1), origin)

    def brought(self, rod: Array, shares: Array, least: float, most: float) -> Array:
        """Onto the plate, at a height within the gauge's travel."""
        out = np.clip(rod, -_HALF, _HALF)
        out[:, 2] = least + shares * (most - least)
        return out


KIND = TouchedPlane()
