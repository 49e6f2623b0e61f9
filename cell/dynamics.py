"""Joint torques of a moving chain of rigid bodies: recursive Newton-Euler over all samples at once.

Outwards: angular velocity and acceleration of every body, acceleration of its centre of mass. Inwards: each joint carries the
forces and moments of all bodies behind it (Luh, Walker & Paul 1980). Component-first arrays as in cell.chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.chain import Frames, cross
from cell.descriptions import Link


@dataclass(frozen=True, eq=False)
class _Loaded:
    """One body at N samples."""

    com: Array  # (3, N) [m]
    force: Array  # (3, N) [N] that moves and carries it
    moment: Array  # (3, N) [N m] about its centre of mass


def joint_torques(
    frames: Frames,
    bodies: Sequence[Sequence[Link]],
    q: Array,
    *,
    gravity: Array,
    speed: Array | None = None,
    acceleration: Array | None = None,
) -> Array:
    """(J, N) [N m] torque about each joint axis that carries and moves the bodies.

    frames : of the chain at joint angles q (N, J) [rad]. bodies : those that turn with each joint, in the frame that turns
    with it. speed, acceleration : (N, J) [rad/s], [rad/s^2]; standstill without. gravity : (3,) [m/s^2].
    """
    loaded = _loaded(frames, bodies, q, gravity, speed, acceleration)
    joints, n = len(bodies), q.shape[0]
    torque = np.zeros((joints, n))
    force, moment = (
        np.zeros((3, n)),
        np.zeros((3, n)),
    )  # of all bodies behind, about the origin of the base
    for i in range(joints - 1, -1, -1):
        for body in loaded[i]:
            force = force + body.force
            moment = moment + body.moment + cross(body.com, body.force)
        torque[i] = (frames.z[i] * (moment - cross(frames.origin[i], force))).sum(axis=0)
    return torque


def _loaded(
    frames: Frames,
    bodies: Sequence[Sequence[Link]],
    q: Array,
    gravity: Array,
    speed: Array | None,
    acceleration: Array | None,
) -> list[list[_Loaded]]:
    n = q.shape[0]
    moves = speed is not None and acceleration is not None
    omega, alpha, at_origin = np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, n))
    point = frames.origin[0]
    cos, sin = np.cos(q.T), np.sin(q.T)
    out: list[list[_Loaded]] = []
    for i, links in enumerate(bodies):
        z = frames.z[i]
        arm = frames.origin[i] - point
        if moves:
            assert speed is not None
            assert acceleration is not None
            at_origin = at_origin + cross(alpha, arm) + cross(omega, cross(omega, arm))
            alpha = alpha + acceleration[:, i] * z + cross(omega, speed[:, i] * z)
            omega = omega + speed[:, i] * z
        point = frames.origin[i]
        x = cos[i] * frames.x[i] + sin[i] * frames.y[i]
        y = cos[i] * frames.y[i] - sin[i] * frames.x[i]
        out.append(
            [
                _body(
                    link, (x, y, z), point, at_origin - gravity[:, None], omega, alpha, moves=moves
                )
                for link in links
            ]
        )
    return out


def _body(
    link: Link,
    axes: tuple[Array, Array, Array],
    origin: Array,
    lifted: Array,
    omega: Array,
    alpha: Array,
    *,
    moves: bool,
) -> _Loaded:
    x, y, z = axes
    arm = link.com[0] * x + link.com[1] * y + link.com[2] * z
    if not moves:
        return _Loaded(origin + arm, link.mass * lifted, np.zeros_like(lifted))
    force = link.mass * (lifted + cross(alpha, arm) + cross(omega, cross(omega, arm)))
    moment = _turned(link.inertia, axes, alpha) + cross(omega, _turned(link.inertia, axes, omega))
    return _Loaded(origin + arm, force, moment)


def _turned(inertia: Array, axes: tuple[Array, Array, Array], vector: Array) -> Array:
    """(3, N) inertia (3, 3), given in `axes`, times a vector (3, N) of the base frame."""
    local = inertia @ np.stack([(axis * vector).sum(axis=0) for axis in axes])
    return np.asarray(sum(component * axis for component, axis in zip(local, axes, strict=True)))
