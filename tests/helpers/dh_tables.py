"""Tables of DH rows read back by plain matrices."""

from __future__ import annotations

import csv

import numpy as np

from ballbar.cell.arrays import Array


def turn(axis: str, angle: Array | float) -> Array:
    angle = np.atleast_1d(angle)
    out = np.tile(np.eye(4), (angle.size, 1, 1))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    out[:, i, i] = out[:, j, j] = np.cos(angle)
    out[:, j, i] = np.sin(angle)
    out[:, i, j] = -np.sin(angle)
    return out


def shift(axis: str, length: float) -> Array:
    out = np.eye(4)
    out["xyz".index(axis), 3] = length
    return out


def table(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader([line for line in text.splitlines() if not line.startswith("#")]))


def along_table(text: str, q: Array, order: str) -> Array:
    """Poses of a DH table; `order` spells its row, as in zZXxy: z turns, Z shifts."""
    pose: Array = np.eye(4)[None]
    for row in table(text):
        joint = q[:, int(row["joint"]) - 1] if row["joint"] != "tool" else 0.0
        steps = {
            "z": turn("z", float(row["theta_rad"]) + joint),
            "Z": shift("z", float(row["d_m"])),
            "X": shift("x", float(row["a_m"])),
            "x": turn("x", float(row["alpha_rad"])),
            "y": turn("y", float(row["beta_rad"])),
        }
        for letter in order:
            pose = pose @ steps[letter]
    return pose
