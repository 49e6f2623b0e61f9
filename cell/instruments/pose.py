"""Position and orientation of the target in the frame of the seat: tracker with a 6-D target."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.instruments.base import (
    Instrument,
    Sight,
    TrueStand,
    position_in_seat,
    position_sigma,
    turned,
)
from ballbar.cell.instruments.point import SensedPoint
from ballbar.cell.placement import Placement
from ballbar.cell.rotation import matrix_from_rotvec, rotvec_from_matrix


class SensedPose(SensedPoint):
    """Three coordinates [m] and a rotation vector [rad] in the seat's frame."""

    name = "pose"
    chains = (
        ("revolute*", "revolute*", "prismatic*", "ball*"),
        ("prismatic*", "prismatic*", "prismatic*", "ball*"),
    )
    noun = "whole poses"
    names = ("x", "y", "z", "rx", "ry", "rz")
    units = ("m", "m", "m", "rad", "rad", "rad")
    target_turns = True

    def sight(self, values: Array, seat: Placement, predicted: Array) -> Sight:
        """Point and orientation in the robot's base frame."""
        rotation = np.einsum("ij,jkn->ikn", seat.rotation, matrix_from_rotvec(values[:, 3:].T))
        return replace(super().sight(values, seat, predicted), rotation=rotation)

    def measure(self, stand: TrueStand, noise: Array, instrument: Instrument) -> Array:
        """(N, 6) [m, rad]"""
        turns = rotvec_from_matrix(turned(stand, noise, instrument))
        return np.hstack((position_in_seat(stand, noise, instrument).T, turns.T))

    def sigma(self, values: Array, instrument: Instrument) -> Array:
        """(N, 6) [m, rad]"""
        turns = np.full((len(values), 3), instrument.sigma_rotation)
        return np.hstack((position_sigma(values, instrument), turns))


KIND = SensedPose()
