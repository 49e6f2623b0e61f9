"""Joint torques of a moving chain of rigid bodies by recursive Newton-Euler, all samples at once.

The outward recursion gives angular velocity and acceleration of every body and the acceleration of
its centre of mass. The inward recursion sums at each joint the forces and moments of all bodies
beyond it (Luh, Walker & Paul 1980). Arrays are component-first as in ballbar.cell.chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, cross
from ballbar.cell.descriptions import Link


@dataclass(frozen=True, eq=False)
class _Loaded:
    """Forces on one body at N samples."""

    com: Array  # (3, N) [m]
    force: Array  # (3, N) [N] that accelerates and carries it
    moment: Array  # (3, N) [N m] about its centre of mass


@dataclass(frozen=True, eq=False)
class _Motion:
    """Motion of a frame that turns with a joint, at N samples."""

    axes: tuple[Array, Array, Array]  # (3, N) each
    origin: Array  # (3, N) [m]
    lift: Array  # (3, N) [m/s^2] acceleration of the origin less gravity
    omega: Array  # (3, N) [rad/s]
    alpha: Array  # (3, N) [rad/s^2]
    at_rest: bool


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
    joints, n = len(bodies), q.shape[0]
    motions = _motions(frames, joints, q, gravity, speed, acceleration)
    out = np.zeros((joints, 3, n))
    # of all bodies beyond a joint, about the origin of the base
    force, moment = np.zeros((3, n)), np.zeros((3, n))
    for i in range(joints - 1, -1, -1):
        for body in (_loaded(link, motions[i]) for link in bodies[i]):
            force = force + body.force
            moment = moment + body.moment + cross(body.com, body.force)
        out[i] = moment - cross(frames.origin[i], force)
    return out


def torques_of_each(
    frames: Frames,
    bodies: Sequence[tuple[int, Link]],
    q: Array,
    *,
    gravity: Array,
    speed: Array | None = None,
    acceleration: Array | None = None,
) -> Array:
    """(B, J, N) [N m] torques about the joint axes that each body asks for by itself.

    bodies : index from 0 of the joint that a body turns with, and the body in the frame that turns
        with it. Other arguments as of `joint_torques`.
    """
    joints = q.shape[1]
    motions = _motions(frames, joints, q, gravity, speed, acceleration)
    out = np.zeros((len(bodies), joints, q.shape[0]))
    for torques, (joint, link) in zip(out, bodies, strict=True):
        body = _loaded(link, motions[joint])
        moment = body.moment + cross(body.com, body.force)
        for i in range(joint + 1):
            torques[i] = (frames.z[i] * (moment - cross(frames.origin[i], body.force))).sum(axis=0)
    return out


def _motions(
    frames: Frames,
    joints: int,
    q: Array,
    gravity: Array,
    speed: Array | None,
    acceleration: Array | None,
) -> list[_Motion]:
    n = q.shape[0]
    omega, alpha, at_origin = np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, n))
    point = frames.origin[0]
    cos, sin = np.cos(q.T), np.sin(q.T)
    at_rest = speed is None or acceleration is None
    out = []
    for i in range(joints):
        z = frames.z[i]
        arm = frames.origin[i] - point
        if speed is not None and acceleration is not None:
            at_origin = at_origin + cross(alpha, arm) + cross(omega, cross(omega, arm))
            alpha = alpha + acceleration[:, i] * z + cross(omega, speed[:, i] * z)
            omega = omega + speed[:, i] * z
        point = frames.origin[i]
        x = cos[i] * frames.x[i] + sin[i] * frames.y[i]
        y = cos[i] * frames.y[i] - sin[i] * frames.x[i]
        lift = at_origin - gravity[:, None]
        out.append(_Motion((x, y, z), point, lift, omega, alpha, at_rest))
    return out


def _loaded(link: Link, motion: _Motion) -> _Loaded:
    x, y, z = motion.axes
    lift, omega, alpha = motion.lift, motion.omega, motion.alpha
    arm = link.com[0] * x + link.com[1] * y + link.com[2] * z
    if motion.at_rest:
        return _Loaded(motion.origin + arm, link.mass * lift, np.zeros_like(lift))
    force = link.mass * (lift + cross(alpha, arm) + cross(omega, cross(omega, arm)))
    about_centre = _turned(link.inertia, motion.axes, alpha) + cross(
        omega, _turned(link.inertia, motion.axes, omega)
    )
    return _Loaded(motion.origin + arm, force, about_centre)


def _turned(inertia: Array, axes: tuple[Array, Array, Array], vector: Array) -> Array:
    """(3, N) inertia (3, 3) in the frame of `axes` times a vector (3, N) of the base frame."""
    local = inertia @ np.stack([(axis * vector).sum(axis=0) for axis in axes])
    return np.asarray(sum(component * axis for component, axis in zip(local, axes, strict=True)))
