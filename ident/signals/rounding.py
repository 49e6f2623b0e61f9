"""Steps to which a table rounds its joint angles, and the noise that this is."""

from __future__ import annotations

import numpy as np

from cell.arrays import Array

GRIDS_DEG = (1.0, 0.5, 0.1, 0.05, 0.01)  # steps to which tables round their angles


def rounding_noise(q: Array) -> Array:
    """(J,) [rad] standard deviation of the rounding of angles q (N, J)."""
    return np.asarray(rounding(q) / np.sqrt(12.0))


def rounding(q: Array) -> Array:
    """(J,) [rad] step to which the angles q (N, J) were rounded; 0 where none is seen."""
    degrees = np.rad2deg(q)
    out = np.zeros(q.shape[1])
    for j, angles in enumerate(degrees.T):
        if len(np.unique(angles.round(9))) < min(10, len(angles)):
            continue  # a joint that hardly moves, or a grid of poses by intention
        for step in GRIDS_DEG:
            if np.abs(angles / step - np.round(angles / step)).max() < 1e-6:
                out[j] = step
                break
    commanded = out >= 0.5  # whole and half degrees are targets of a program, not rounding
    return np.deg2rad(np.where(commanded, 0.0, out))
