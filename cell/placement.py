"""Frames that are fixed to another one: the seat of an instrument to the robot's base, a target to
the flange.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames
from ballbar.cell.rotation import matrix_from_rotvec


@dataclass(frozen=True, eq=False)
class Placement:
    """A frame that is fixed to another one."""

    rotation: Array  # (3, 3)
    origin: Array  # (3,) [m]

    def moved(self, change: Array, *, about_own_axes: bool) -> Placement:
        """The frame after a shift (3,) [m], and where `change` is (6,) a rotation vector [rad]."""
        rotation = self.rotation
        if change.size == 6:
            turn = matrix_from_rotvec(change[3:, None])[:, :, 0]
            rotation = rotation @ turn if about_own_axes else turn @ rotation
        return Placement(rotation, self.origin + change[:3])


def target_frames(flange: Frames, target: Placement) -> Frames:
    """The robot's frames with that of a target on the flange as the last one."""
    rotation = np.einsum("ikn,kj->ijn", flange.rotation(), target.rotation)
    origin = flange.tip + np.einsum("ikn,k->in", flange.rotation(), target.origin)
    columns = (rotation[:, 0], rotation[:, 1], rotation[:, 2], origin)
    parts = (flange.x, flange.y, flange.z, flange.origin)
    x, y, z, o = (np.concatenate((p, c[None])) for p, c in zip(parts, columns, strict=True))
    return Frames(x, y, z, o, flange.x_link)
