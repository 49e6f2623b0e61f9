"""Inverse kinematics of nominal arms in closed form.

With parallel axes 2 and 3 and a spherical wrist, the wrist is decoupled (Pieper's method) and
solved as ZYZ angles. With parallel axes 2, 3 and 4 and offsets between the last three (cobots), the
shift along these axes tells axis 1, their direction in the tool's frame axes 5 and 6 (Hawkins
2013), and axes 2 to 4 are a planar arm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, forward
from ballbar.cell.errors import InputError

ARM_AXES = 3  # whose angles are unique: only the wrist turns as a whole
ELBOWS = (1.0, -1.0)  # up and down
REACHED = 1e-9  # [m, rad] of a pose that is taken, and of offsets that are none
# [rad] twists of the arms that have a closed form; with s = -1 alpha_4 and alpha_5 are mirrored
_SPHERICAL = np.array([-1.0, 0.0, -1.0, 1.0, -1.0, 0.0]) * (np.pi / 2.0)
_PARALLEL = np.array([1.0, 0.0, 0.0, 1.0, -1.0, 0.0]) * (np.pi / 2.0)


def has_closed_form(chain: Chain) -> bool:
    """Whether `robot_branches` holds for a chain: nominal rows of that structure, no offset beside.

    The axes of an arm that is built so may miss one another: then its wrist is not decoupled.
    """
    return _is_spherical(chain, _SPHERICAL) or _is_spherical(chain, _mirrored(_SPHERICAL))


def robot_branches(chain: Chain, poses: Array, elbows: Sequence[float] = ELBOWS) -> Array:
    """Joint angles of the nominal robot in its four configurations with the arm in front.

    poses : (N, 4, 4) tool frames in the base frame. elbows : those of ELBOWS that are asked for.

    Returns (4, N, 6) [rad] in the order elbow up and wrist +, up and -, down and +, down and -, or
    two of them for one elbow; NaN where a pose is out of reach, or where the wrist is exactly
    singular. Raises InputError for a robot of another structure (ballbar.cell.numerical_inverse).
    """
    if not has_closed_form(chain):
        raise InputError(
            "angles in closed form are those of nominal robots of six axes with parallel axes 2 "
            "and 3 and a spherical wrist, and this robot is built otherwise"
        )
    return _reaching(chain, _in_front(chain, poses, elbows=elbows), poses)


def arm_branches(chain: Chain, poses: Array, *, beyond: float = 0.0) -> Array | None:
    """All configurations of an arm that has a closed form, in whatever direction its axes count.

    poses : (N, 4, 4) tool frames in the base frame. beyond : [-] share of the reach by which poses
        out of it are taken too, with angles near those of a robot that is as much longer.

    Returns (8, N, 6) [rad], NaN where a configuration does not exist; None for a robot of another
    structure.
    """
    form = _form(chain)
    if form is None:
        return None
    ends = poses.copy()
    ends[:, :3, 1:3] *= form.sign[-1]
    q = form.branches(form.chain, ends, beyond)
    return (q if beyond else _reaching(form.chain, q, ends)) * form.sign[:-1]


def has_arm_branches(chain: Chain) -> bool:
    """Whether `arm_branches` holds for a chain."""
    return _form(chain) is not None


@dataclass(frozen=True, eq=False)
class _Form:
    """A closed form that holds for a chain with some z axes reversed."""

    branches: Callable[[Chain, Array, float], Array]
    chain: Chain  # with the z axes reversed
    sign: Array  # (J+1,) -1 of each frame whose z axis was reversed


def _form(chain: Chain) -> _Form | None:
    for alpha, holds, branches in (
        (_SPHERICAL, _is_spherical, _spherical),
        (_PARALLEL, _is_parallel, _parallel),
    ):
        usual, sign = _usual(chain, alpha)
        if holds(usual, alpha):
            return _Form(branches, usual, sign)
    return None


def _mirrored(alpha: Array) -> Array:
    """The twists with the wrist bent to the other side."""
    return np.asarray(alpha * (1.0, 1.0, 1.0, -1.0, -1.0, 1.0))


def _is_spherical(chain: Chain, alpha: Array) -> bool:
    return _is_nominal(chain, alpha, (*chain.a[3:5], chain.d[1:3].sum(), *chain.d[4:5]))


def _is_parallel(chain: Chain, alpha: Array) -> bool:
    return _is_nominal(chain, alpha, (*chain.a[4:5],))


def _is_nominal(chain: Chain, alpha: Array, none: tuple[float, ...]) -> bool:
    """Whether rows have these twists exactly, and the lengths that have to be none are."""
    return chain.rows == alpha.size and bool(
        np.abs((*(chain.alpha - alpha), *chain.beta, *none)).max() < REACHED
    )


def _usual(chain: Chain, twists: Array) -> tuple[Chain, Array]:
    """The chain with those z axes reversed that bring its twists nearest to the given ones.

    Reversing the z axis of a frame changes a twist by half a turn, and negates angle and offset d
    of the row that follows. Returns the chain, and (J+1,) the sign of each frame's z axis.
    """
    if chain.rows != twists.size:
        return chain, np.ones(chain.rows + 1)
    turned, alpha = np.zeros(chain.rows + 1), np.empty(chain.rows)  # half turns of each frame
    for i, twist in enumerate(twists):
        alpha[i] = _wrapped(chain.alpha[i] + np.pi * turned[i])
        turned[i + 1] = abs(_wrapped(alpha[i] - twist)) > np.pi / 2.0
        alpha[i] = _wrapped(alpha[i] - np.pi * turned[i + 1])
    sign = 1.0 - 2.0 * turned
    d, theta = sign[:-1] * chain.d, sign[:-1] * chain.theta
    return Chain(chain.a, d, alpha, theta, chain.beta), sign


def _wrapped(angle: Array) -> Array:
    """[rad] between -pi and pi."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))


def _reaching(chain: Chain, branches: Array, poses: Array) -> Array:
    """The branches (S, N, 6) [rad]; NaN where they do not take their pose."""
    reached = forward(chain, branches.reshape(-1, chain.rows)).poses()
    off = np.abs(reached.reshape(-1, *poses.shape) - poses).max(axis=(2, 3))
    branches[~(off < REACHED)] = np.nan
    return branches


def _held(ratio: Array, beyond: float) -> Array:
    """A sine or cosine; NaN outside -1 to 1, but as far inside where it is `beyond` at most."""
    inside = np.where(np.abs(ratio) > 1.0, np.sign(ratio) * (1.0 - beyond), ratio)
    return np.where(np.abs(ratio) > 1.0 + beyond, np.nan, inside)


def _planar(
    x: Array, y: Array, upper: float, fore: float, beyond: float, elbows: Sequence[float] = ELBOWS
) -> Iterator[tuple[Array, Array]]:
    """Both angles [rad] of two links from the origin to (x, y), elbow + and -."""
    cosine = (x**2 + y**2 - upper**2 - fore**2) / (2.0 * upper * fore)
    for elbow in elbows:
        bend = elbow * np.arccos(_held(cosine, beyond))
        inner = np.arctan2(fore * np.sin(bend), upper + fore * np.cos(bend))
        yield np.arctan2(y, x) - inner, bend


def _spherical(chain: Chain, poses: Array, beyond: float) -> Array:
    """(8, N, 6) [rad] in front, then with the shoulder turned away from the wrist behind it."""
    sides = (_in_front(chain, poses, beyond, side) for side in (1.0, -1.0))
    return np.concatenate(tuple(sides))


def _in_front(
    chain: Chain,
    poses: Array,
    beyond: float = 0.0,
    side: float = 1.0,
    elbows: Sequence[float] = ELBOWS,
) -> Array:
    """(4, N, 6) [rad] of the arm with spherical wrist."""
    rotation, wrist = poses[:, :3, :3], _before_last(chain, poses)
    shoulder = np.arctan2(side * wrist[:, 1], side * wrist[:, 0])
    forward_reach = side * np.hypot(wrist[:, 0], wrist[:, 1]) - chain.a[0]
    down = chain.d[0] - wrist[:, 2]  # the angles of the arm are measured downwards
    fore_angle = np.arctan2(chain.d[3], chain.a[2])
    fore = float(np.hypot(chain.a[2], chain.d[3]))
    solutions = []
    for theta2, bend in _planar(forward_reach, down, chain.a[1], fore, beyond, elbows):
        arm = np.stack((shoulder, theta2, bend - fore_angle), axis=1) - chain.theta[:3]
        solutions += _wrists(chain, rotation, arm)
    return np.stack(solutions)


def _wrists(chain: Chain, rotation: Array, arm: Array) -> list[Array]:
    forearm = forward(_rows(chain, slice(3)), arm).rotation().transpose(2, 0, 1)
    rest = forearm.transpose(0, 2, 1) @ rotation  # Rz(t4) Ry(-s t5) Rz(t6)
    s = np.sign(chain.alpha[3])
    out = []
    for side in (1.0, -1.0):
        tilt = side * np.arctan2(np.hypot(rest[:, 0, 2], rest[:, 1, 2]), rest[:, 2, 2])
        theta4 = np.arctan2(side * rest[:, 1, 2], side * rest[:, 0, 2])
        theta6 = np.arctan2(side * rest[:, 2, 1], -side * rest[:, 2, 0])
        wrist = np.stack((theta4, -s * tilt, theta6), axis=1) - chain.theta[3:]
        out.append(np.concatenate((arm, _wrapped(wrist)), axis=1))
    return out


def _parallel(chain: Chain, poses: Array, beyond: float) -> Array:
    """(8, N, 6) [rad] of the arm with parallel axes 2, 3 and 4."""
    x, y = _before_last(chain, poses)[:, :2].T
    away = np.arcsin(_held(chain.d[1:4].sum() / np.hypot(x, y), beyond))
    solutions: list[Array] = []
    for shoulder in (away, np.pi - away):
        theta1 = np.arctan2(y, x) + shoulder
        axis = np.stack((np.sin(theta1), -np.cos(theta1), np.zeros_like(theta1)), axis=1)
        u, v, w = np.einsum("nji,nj->in", poses[:, :3, :3], axis)  # axes 2 to 4 in the tool's frame
        for side in (1.0, -1.0):
            theta5 = side * np.arctan2(np.hypot(u, v), w)
            theta6 = np.arctan2(-side * v, side * u)
            ends = np.stack((theta1, theta5, theta6), axis=1) - chain.theta[[0, 4, 5]]
            solutions += _parallel_arms(chain, poses, ends, beyond)
    return np.stack(solutions)


def _parallel_arms(chain: Chain, poses: Array, ends: Array, beyond: float) -> Iterator[Array]:
    """Both (N, 6) [rad] of axes 1, 5 and 6 at `ends` (N, 3) [rad]."""
    first = forward(_rows(chain, slice(1)), ends[:, :1]).poses()
    last = forward(_rows(chain, slice(4, 6)), ends[:, 1:]).poses()
    plane = np.linalg.inv(first) @ poses @ np.linalg.inv(last)  # frame 4 in frame 1
    heading = np.arctan2(plane[:, 1, 0], plane[:, 0, 0])
    x, y = plane[:, :2, 3].T - chain.a[3] * np.stack((np.cos(heading), np.sin(heading)))
    for theta2, bend in _planar(x, y, chain.a[1], chain.a[2], beyond):
        arm = np.stack((theta2, bend, heading - theta2 - bend), axis=1) - chain.theta[1:4]
        yield _wrapped(np.concatenate((ends[:, :1], arm, ends[:, 1:]), axis=1))


def _before_last(chain: Chain, poses: Array) -> Array:
    """(N, 3) [m] origin of frame 5, by the last row."""
    rotation, tip = poses[:, :3, :3], poses[:, :3, 3]
    return np.asarray(tip - chain.a[5] * rotation[:, :, 0] - chain.d[5] * rotation[:, :, 2])


def _rows(chain: Chain, rows: slice) -> Chain:
    return Chain(*(getattr(chain, field.name)[rows] for field in fields(chain)))
