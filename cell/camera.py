"""A camera: where its lens images points, and what is known of the lens before any picture.

Pixels (u, v) are those of OpenCV: u to the right, v down, the middle of the first pixel at (0, 0).
The frame of the camera has its origin in the centre of projection, z along the optical axis and x
along u. Lenses: pinhole with radial and decentring distortion (Brown 1966), and the equidistant
lens with a polynomial of the angle (Kannala & Brandt 2006), which OpenCV calls fisheye.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ballbar.cell.arrays import Array

LensModel = Literal["brown", "fisheye"]
_PINHOLE = ("fx", "fy", "cx", "cy")
NAMES: dict[LensModel, tuple[str, ...]] = {
    "brown": (*_PINHOLE, "k1", "k2", "p1", "p2", "k3"),
    "fisheye": (*_PINHOLE, "k1", "k2", "k3", "k4"),
}
_ON_AXIS = 1e-4  # tangent of the angle below which a fisheye lens is a pinhole
_NEWTON = 12  # steps of the inverse of a lens
_EXACT = 1e-12  # last step of it
_LEAST_DEPTH = 1e-6  # [m] points nearer, or behind the camera, are imaged as if they were there


@dataclass(frozen=True, eq=False)
class Lens:
    """A lens: focal lengths and principal point [px], and distortion."""

    model: LensModel
    values: Array  # (L,) as NAMES of the model

    def image(self, points: Array) -> tuple[Array, Array, Array]:
        """Pixels (..., 2) of points (..., 3) [m] in the frame of the camera, and their derivatives.

        Those by the point are (..., 2, 3) [px/m], those by the lens (..., 2, L).
        """
        depth = np.maximum(points[..., 2], _LEAST_DEPTH)
        tangents = points[..., :2] / depth[..., None]
        bent, by_tangents, by_distortion = self._distorted(tangents)
        focal, centre = self.values[:2], self.values[2:4]
        by_lens = np.zeros((*bent.shape, self.values.size))
        by_lens[..., 0, 0], by_lens[..., 1, 1] = bent[..., 0], bent[..., 1]
        by_lens[..., 0, 2] = by_lens[..., 1, 3] = 1.0
        by_lens[..., 4:] = focal[:, None] * by_distortion
        by_point = np.zeros((*bent.shape, 3))
        by_point[..., 0, 0] = by_point[..., 1, 1] = 1.0
        by_point[..., 2] = -tangents
        by_point = focal[:, None] * (by_tangents @ by_point) / depth[..., None, None]
        return focal * bent + centre, by_point, by_lens

    def tangents(self, pixels: Array) -> Array:
        """(..., 2) x / z and y / z of the lines of sight of pixels (..., 2), by Newton's method."""
        wanted = (pixels - self.values[2:4]) / self.values[:2]
        out = wanted.copy()
        for _ in range(_NEWTON):
            bent, slope, _ = self._distorted(out)
            step = np.linalg.solve(slope, (wanted - bent)[..., None])[..., 0]
            out += np.clip(step, -0.5, 0.5)
            if not step.size or np.abs(step).max() < _EXACT:
                break
        return out

    def _distorted(self, tangents: Array) -> tuple[Array, Array, Array]:
        """Distorted tangents (..., 2), derivatives by tangents (..., 2, 2) and by distortion."""
        bend = _brown if self.model == "brown" else _fisheye
        return bend(tangents, self.values[4:])


def _brown(tangents: Array, distortion: Array) -> tuple[Array, Array, Array]:
    k1, k2, p1, p2, k3 = distortion
    x, y = tangents[..., 0], tangents[..., 1]
    square, mixed = x * x + y * y, 2.0 * x * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    slope = k1 + square * (2.0 * k2 + square * 3.0 * k3)  # of `radial` by `square`
    along_x, along_y = square + 2.0 * x * x, square + 2.0 * y * y
    bent = tangents * radial[..., None]
    bent += np.stack((p1 * mixed + p2 * along_x, p1 * along_y + p2 * mixed), axis=-1)
    cross = mixed * slope + 2.0 * (p1 * x + p2 * y)
    by_x = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    by_y = radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    by_tangents = np.stack((by_x, cross, cross, by_y), axis=-1).reshape(*x.shape, 2, 2)
    powers = np.stack((square, square**2, square**3), axis=-1)[..., None, :] * tangents[..., None]
    decentring = np.stack((mixed, along_x, along_y, mixed), axis=-1).reshape(*x.shape, 2, 2)
    by_distortion = np.concatenate((powers[..., :2], decentring, powers[..., 2:]), axis=-1)
    return bent, by_tangents, by_distortion


def _fisheye(tangents: Array, distortion: Array) -> tuple[Array, Array, Array]:
    radius = np.maximum(np.linalg.norm(tangents, axis=-1), _ON_AXIS)
    angle = np.arctan(radius)
    powers = angle[..., None] ** np.array([3, 5, 7, 9])
    share = (angle + powers @ distortion) / radius
    slope = 1.0 + (powers / angle[..., None]) @ (distortion * np.array([3.0, 5.0, 7.0, 9.0]))
    change = (slope / (1.0 + radius**2) - share) / radius**2  # of `share`, by radius, over radius
    outer = tangents[..., :, None] * tangents[..., None, :]
    by_tangents = share[..., None, None] * np.eye(2) + change[..., None, None] * outer
    by_distortion = tangents[..., None] * (powers / radius[..., None])[..., None, :]
    return share[..., None] * tangents, by_tangents, by_distortion


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera, and what is known of it before any picture."""

    image: tuple[int, int]  # [px] width and height
    lens: Lens  # as calibrated, or by the field of view
    covariance: Array  # (L, L) of the lens's values
    sigma: float  # [px] noise of a corner, about
