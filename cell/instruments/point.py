"""The position of the target in the frame of the seat: laser tracker, coordinate machine."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.instruments.base import (
    Instrument,
    Kind,
    Sight,
    TrueStand,
    position_in_seat,
    position_sigma,
    seat_axes,
)
from ballbar.cell.placement import Placement


class SensedPoint(Kind):
    """Three coordinates [m] in the seat's frame."""

    name = "point"
    chains = (
        ("revolute*", "revolute*", "prismatic*", "ball"),
        ("prismatic*", "prismatic*", "prismatic*", "ball"),
    )
    noun = "points"
    names: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    units: ClassVar[tuple[str, ...]] = ("m", "m", "m")
    directions = 3

    def sight(self, values: Array, seat: Placement, predicted: Array) -> Sight:
        """The point in the robot's base frame."""
        del predicted
        point = seat.rotation @ values[:, :3].T + seat.origin[:, None]
        return Sight(point, seat_axes(seat, len(values)))

    def measure(self, stand: TrueStand, noise: Array, instrument: Instrument) -> Array:
        """(N, 3) [m]"""
        return np.asarray(position_in_seat(stand, noise, instrument).T)

    def sigma(self, values: Array, instrument: Instrument) -> Array:
        """(N, 3) [m]"""
        return position_sigma(values, instrument)


KIND = SensedPoint()
