"""Rigid motions by products of exponentials (Brockett 1984; Lynch & Park 2017, ch. 4).

A twist is (w, v), the angular velocity and the velocity of the point at the origin, base frame. A
chain is a list of twists at its home pose; twist k moves everything behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pose:
    """N poses, or one."""

    R: Array  # (..., 3, 3)
    p: Array  # (..., 3) [m]

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.R @ other.R, (self.R @ other.p[..., None])[..., 0] + self.p)


def turn(axis: Array, point: Array) -> Array:
    """(6,) twist of a hinge about a unit axis (3,) through a point (3,) [m]."""
    return np.concatenate((axis, np.cross(point, axis)))


def shift(axis: Array) -> Array:
    """(6,) twist of a slide along a unit axis (3,)."""
    return np.concatenate((np.zeros(3), axis))


def cross_matrix(w: Array) -> Array:
    """(..., 3, 3) matrix of the cross product with w (..., 3)."""
    zero = np.zeros(w.shape[:-1])
    rows = ((zero, -w[..., 2], w[..., 1]), (w[..., 2], zero, -w[..., 0]))
    last = (-w[..., 1], w[..., 0], zero)
    return np.stack([np.stack(row, axis=-1) for row in (*rows, last)], axis=-2)


def exponential(twist: Array, c: Array) -> Pose:
    """Motion by a constant twist (6,) through c (N,) [rad, m]."""
    w, v = twist[:3], twist[3:]
    if not w.any():
        return Pose(np.broadcast_to(np.eye(3), (*c.shape, 3, 3)), c[..., None] * v)
    W = cross_matrix(w)
    s, k = np.sin(c)[..., None, None], 2.0 * np.sin(0.5 * c)[..., None, None] ** 2
    R = np.eye(3) + s * W + k * (W @ W)
    point = np.cross(w, v)  # on the axis; a hinge has no pitch
    return Pose(R, point - R @ point)


def rotation_vector(turned: Array) -> Array:
    """(N, 3) [rad] of rotations (N, 3, 3) by less than half a turn."""
    skew = 0.5 * (turned - turned.swapaxes(1, 2))
    axis = np.stack((skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]), axis=1)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(turned, axis1=1, axis2=2) - 1.0))
    return axis * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), 1.0)[:, None]


@dataclass(frozen=True, eq=False)
class Placed:
    """A chain of K twists at N samples."""

    screws: Array  # (K, N, 6) the twists where they are
    links: tuple[Pose, ...]  # K displacements from home, of what lies behind each twist
    end: Pose


@dataclass(frozen=True, eq=False)
class Chain:
    """Twists (6,) in order, and the pose of the end with all coordinates zero."""

    twists: tuple[Array, ...]
    home: Pose

    def place(self, c: Array) -> Placed:
        """The chain at coordinates c (K, N) [rad, m]."""
        n = c.shape[1]
        at = Pose(np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3)))
        screws, links = np.empty((len(self.twists), n, 6)), []
        for k, twist in enumerate(self.twists):
            w = at.R @ twist[:3]
            screws[k, :, :3] = w
            screws[k, :, 3:] = np.cross(at.p, w) + at.R @ twist[3:]
            at = at @ exponential(twist, c[k]) if c[k].any() else at
            links.append(at)
        return Placed(screws, tuple(links), at @ self.home)


def homes(rows: Array, base: Pose) -> list[Pose]:
    """Frames 0..J of DH rows (J, 5) [m, m, rad, rad, rad] a d alpha theta beta at angles zero."""
    frames = [base]
    for a, d, alpha, theta, beta in rows:
        x, y, z = np.eye(3)
        step = Pose(np.eye(3), np.zeros(3))
        for twist, c in (
            (turn(z, np.zeros(3)), theta), (shift(z), d), (shift(x), a),
            (turn(x, np.zeros(3)), alpha), (turn(y, np.zeros(3)), beta),
        ):  # fmt: skip
            step = step @ exponential(twist, np.asarray(c))
        frames.append(frames[-1] @ step)
    return frames


def wrench(force: Array, point: Array, moment: Array | float = 0.0) -> Array:
    """(N, 6) moment about the origin [N m], then force [N], of a force at a point (N, 3)."""
    return np.concatenate((np.cross(point, force) + moment, force), axis=1)


def power(screws: Array, wrenches: Array) -> Array:
    """(K, N) work of wrenches (K, N, 6) or (N, 6) for a unit motion along each screw."""
    return np.asarray((screws * wrenches).sum(axis=-1))


def stacked(parts: Sequence[Array]) -> Array:
    """Running sums from the last part to each: what lies behind it."""
    return np.cumsum(np.stack(parts)[::-1], axis=0)[::-1]
