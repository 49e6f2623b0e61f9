"""Joint torques of a moving chain of rigid bodies by recursive Newton-Euler, all samples at once.

The outward recursion gives angular velocity and acceleration of every body and the acceleration of
its centre of mass. The inward recursion sums at each joint the forces and moments of all bodies
beyond it (Luh, Walker & Paul 1980). Arrays are component-first as in cell.chain.
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
    """Forces on one body at N samples."""

    com: Array  # (3, N) [m]
    force: Array  # (3, N) [N] that accelerates and carries it
    moment: Array  # (3, N) [N m] about its centre of mass


@dataclass(frozen=True, eq=False)
class _Motion:
    """Motion of a joint's frame at N samples."""

    origin: Array  # (3, N) [m]
    lift: Array  # (3, N) [m/s^2] acceleration of the origin less gravity
    omega: Array  # (3, N) [rad/s]
    alpha: Array  # (3, N) [rad/s^2]


def joint_torques(
    frames: Frames,
    bodies: Sequence[Sequence[Link]],
    q: Array,
    *,
    gravity: Array,
    speed: Array | None = None,
    acceleration: Array | None = None,
) -> Array:
    """(J, N) [N m] torque about each joint axis that carries and accelerates the bodies.

    frames : of the chain at joint angles q (N, J) [rad]. bodies : that turn with each joint, in the
        frame that turns with it. gravity : (3,) [m/s^2]. speed, acceleration : (N, J) [rad/s],
        [rad/s^2]; both or neither, which stands for a robot at rest.
    """
    moments = joint_moments(
        frames, bodies, q, gravity=gravity, speed=speed, acceleration=acceleration
    )
    return np.asarray((frames.z[: len(bodies)] * moments).sum(axis=1))


def joint_moments(
    frames: Frames,
    bodies: Sequence[Sequence[Link]],
    q: Array,
    *,
    gravity: Array,
    speed: Array | None = None,
    acceleration: Array | None = None,
) -> Array:
    """(J, 3, N) [N m] moment at each joint that carries and accelerates all bodies beyond it.

    Base frame. The part about the joint's axis is its torque, the rest is the bearing's. Arguments
    as of `joint_torques`.
    """
    loaded = _loaded(frames, bodies, q, gravity, speed, acceleration)
    joints, n = len(bodies), q.shape[0]
    out = np.zeros((joints, 3, n))
    # of all bodies beyond a joint, about the origin of the base
    force, moment = np.zeros((3, n)), np.zeros((3, n))
    for i in range(joints - 1, -1, -1):
        for body in loaded[i]:
            force = force + body.force
            moment = moment + body.moment + cross(body.com, body.force)
        out[i] = moment - cross(frames.origin[i], force)
    return out


def _loaded(
    frames: Frames,
    bodies: Sequence[Sequence[Link]],
    q: Array,
    gravity: Array,
    speed: Array | None,
    acceleration: Array | None,
) -> list[list[_Loaded]]:
    n = q.shape[0]
    omega, alpha, at_origin = np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, n))
    point = frames.origin[0]
    cos, sin = np.cos(q.T), np.sin(q.T)
    out: list[list[_Loaded]] = []
    for i, links in enumerate(bodies):
        z = frames.z[i]
        arm = frames.origin[i] - point
        if speed is not None and acceleration is not None:
            at_origin = at_origin + cross(alpha, arm) + cross(omega, cross(omega, arm))
            alpha = alpha + acceleration[:, i] * z + cross(omega, speed[:, i] * z)
            omega = omega + speed[:, i] * z
        point = frames.origin[i]
        x = cos[i] * frames.x[i] + sin[i] * frames.y[i]
        y = cos[i] * frames.y[i] - sin[i] * frames.x[i]
        motion = _Motion(point, at_origin - gravity[:, None], omega, alpha)
        at_rest = speed is None or acceleration is None
        out.append([_body(link, (x, y, z), motion, at_rest=at_rest) for link in links])
    return out


def _body(
    link: Link, axes: tuple[Array, Array, Array], motion: _Motion, *, at_rest: bool
) -> _Loaded:
    x, y, z = axes
    origin, lift, omega, alpha = motion.origin, motion.lift, motion.omega, motion.alpha
    arm = link.com[0] * x + link.com[1] * y + link.com[2] * z
    if at_rest:
        return _Loaded(origin + arm, link.mass * lift, np.zeros_like(lift))
    force = link.mass * (lift + cross(alpha, arm) + cross(omega, cross(omega, arm)))
    moment = _turned(link.inertia, axes, alpha) + cross(omega, _turned(link.inertia, axes, omega))
    return _Loaded(origin + arm, force, moment)


def _turned(inertia: Array, axes: tuple[Array, Array, Array], vector: Array) -> Array:
    """(3, N) inertia (3, 3) in the frame of `axes` times a vector (3, N) of the base frame."""
    local = inertia @ np.stack([(axis * vector).sum(axis=0) for axis in axes])
    return np.asarray(sum(component * axis for component, axis in zip(local, axes, strict=True)))
