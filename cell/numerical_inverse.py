"""Inverse kinematics of arms without a closed form: tabulated starts, then damped Newton steps.

Of a table of random joint angles those whose poses are nearest to a target start the search. From
one pose to others the joints are led along a way of poses, all samples at once, so that neighbours
on a path stay in one configuration of the arm. Steps are damped least squares (Wampler 1986), of
more than six joints those of least length. Rotations count as lengths by half the chain's length.

A point on the flange, whose orientation is free, is reached by the same steps within the axis
limits. From starts all over joint space the solutions have orientations all over the possible ones,
which is what the poses of a ball-bar or a socket need.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, Frames, forward, joint_screws
from ballbar.cell.descriptions import Robot
from ballbar.cell.inverse import pose_error
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes

REACHED = 1e-9  # [m, rad] of an error that is zero but for rounding
TABLE = 30_000  # tabulated starts
NEAREST = 24  # of them from which a pose is searched
BRANCHES = 8  # a serial arm of today has no more configurations within a turn of each joint
SEARCH_STEPS, WAY_STEPS, LAST_STEPS = 14, 12, 4
DAMPING = 0.05  # of the scaled Jacobian, whose singular values are of the order of 1
LONGEST = 0.4  # [rad] of one step: beyond it the arm is no longer the linear one
APART = 0.05  # [rad] of a joint by which two solutions are different ones
_SEED = 1
POINT_STEPS = 60
POINT_CORRECTIONS = 12  # of an arm that differs a little from the chain; each gains two digits
POINT_DAMPING = 0.02  # [m] of the least squares: a hundredth of a usual arm's reach
POINT_LONGEST = 0.3  # [rad]
Position = Callable[[Array], Array]  # from joint angles (N, J) [rad] to places (N, 3) [m]


def length_of(chain: Chain) -> float:
    """[m] half the length of a chain, by which its rotations count as lengths."""
    return 0.5 * float(np.abs(chain.a).sum() + np.abs(chain.d).sum())


def scaled_jacobian(chain: Chain, frames: Frames) -> Array:
    """(N, 6, J) [-] motion of the tool per radian: shifts in lengths of the chain, then turns."""
    jacobian = joint_screws(frames).transpose(2, 1, 0).copy()
    jacobian[:, :3] /= length_of(chain)
    return jacobian


def dexterity(chain: Chain, q: Array) -> Array:
    """(N,) [-] smallest singular value of the scaled Jacobian: 0 at a singular posture.

    q : (N, J) [rad]. Source: Klein & Blaho 1987.
    """
    values = np.linalg.svd(scaled_jacobian(chain, forward(chain, q)), compute_uv=False)
    return np.asarray(values[:, -1])


def pose_branches(chain: Chain, poses: Array) -> Array:
    """Joint angles of the arm's configurations at each pose, as many as there are.

    poses : (N, 4, 4) tool frames in the base frame.

    Returns (BRANCHES, N, J) [rad] between -pi and pi, NaN where there is no further one.
    """
    n, joints = len(poses), chain.rows
    table = _table(*(v.tobytes() for v in (chain.a, chain.d, chain.alpha, chain.theta, chain.beta)))
    _, at = table.tree.query(_features(poses, length_of(chain)), k=NEAREST)
    q = table.q[at].reshape(n * NEAREST, joints)
    q = led(chain, q, lambda _: np.repeat(poses, NEAREST, axis=0), way=SEARCH_STEPS)
    q = np.angle(np.exp(1j * q)).reshape(n, NEAREST, joints)
    distinct = ~np.isnan(q).any(axis=2)
    for k in range(1, NEAREST):
        off = np.abs(np.angle(np.exp(1j * (q[:, :k] - q[:, k : k + 1])))).max(axis=2)
        distinct[:, k] &= ~((off < APART) & distinct[:, :k]).any(axis=1)
    order = np.argsort(~distinct, axis=1, kind="stable")[:, :BRANCHES]
    solutions = np.take_along_axis(q, order[:, :, None], axis=1)
    solutions[~np.take_along_axis(distinct, order, axis=1)] = np.nan
    return np.asarray(solutions.transpose(1, 0, 2))


def best_branches(robot: Robot, chain: Chain, poses: Array, *, count: int) -> Array:
    """(count, N, J) [rad] configurations of `pose_branches` that are best to begin a path with.

    Those within the axis ranges come first, then those far from a singular posture; NaN as there.
    """
    solutions = pose_branches(chain, poses)
    q = np.where(np.isnan(solutions), 0.0, solutions)
    axes = joints_to_axes(robot, in_range(robot, q[..., None, :])[..., 0, :])
    over = np.maximum(np.maximum(robot.axis_lower - axes, axes - robot.axis_upper), 0.0)
    far = dexterity(chain, q.reshape(-1, chain.rows)).reshape(q.shape[:2])
    score = np.where(np.isnan(solutions).any(axis=2), np.inf, over.sum(axis=2) - far)
    best = np.argsort(score, axis=0, kind="stable")[:count]
    return np.asarray(np.take_along_axis(solutions, best[:, :, None], axis=0))


def in_range(robot: Robot, q: Array, *, first: int = 0) -> Array:
    """(..., N, J) [rad] less the whole turns that bring each axis nearest to its range's centre.

    q : (..., N, J) [rad] joint angles along paths of N samples, each of which turns as a whole.
    first : axis, from 0, up to which they stay as they are.
    """
    axes = joints_to_axes(robot, q)
    centre = 0.5 * (robot.axis_lower + robot.axis_upper)
    off = 0.5 * (axes.max(axis=-2) + axes.min(axis=-2)) - centre
    turns = 2.0 * np.pi * np.round(off / (2.0 * np.pi))
    turns[..., :first] = 0.0
    return np.asarray(q - (turns @ robot.controller_to_joint)[..., None, :])


def turned_near(robot: Robot, q: Array, previous: Array) -> Array:
    """(N, J) [rad] less the whole turns that bring each axis nearest to where it was before.

    A turn less or more is taken where that one is outside the axis range. q, previous : (N, J)
    [rad] joint angles.
    """
    axes, turn = joints_to_axes(robot, q), 2.0 * np.pi
    turned = axes - turn * np.round((axes - joints_to_axes(robot, previous)) / turn)
    turned -= turn * np.ceil(np.maximum(turned - robot.axis_upper, 0.0) / turn)
    turned += turn * np.ceil(np.maximum(robot.axis_lower - turned, 0.0) / turn)
    return np.asarray(q + (turned - axes) @ robot.controller_to_joint)


def led(
    chain: Chain, q: Array, poses_at: Callable[[float], Array], *, way: int = WAY_STEPS
) -> Array:
    """Joint angles (N, J) [rad] at the end of a way of poses, NaN where they do not reach it.

    q : (N, J) [rad] near the way's beginning. poses_at : poses (N, 4, 4) at shares 0 to 1 of the
    way. way : number of its steps.
    """
    q = q.copy()
    for step in range(way + LAST_STEPS):
        last = step >= way
        poses = poses_at(1.0 if last else (step + 1) / way)
        frames, damping = forward(chain, q), 0.0 if step >= way + 1 else DAMPING
        q += damped_step(chain, frames, _error(frames, poses), damping=damping)
    frames = forward(chain, q)
    q[np.abs(_error(frames, poses_at(1.0))).max(axis=0) > REACHED] = np.nan
    return q


def polished(chain: Chain, q: Array, poses: Array, *, steps: int = 3) -> Array:
    """(N, J) [rad] joint angles at the poses (N, 4, 4) from close by; NaN where not reached."""
    return led(chain, q, lambda _: poses, way=steps - LAST_STEPS)


def damped_step(chain: Chain, frames: Frames, error: Array, *, damping: float = 0.0) -> Array:
    """(N, J) [rad] damped least-squares steps of at most LONGEST, less damped near the pose.

    frames : of the chain. error : (6, N) [m, rad] of the wanted poses from its last frame.
    """
    error = error.T.copy()
    error[:, :3] /= length_of(chain)
    return _shortened(_damped(scaled_jacobian(chain, frames), error, damping), LONGEST)


def _damped(columns: Array, error: Array, damping: float) -> Array:
    """(N, J) least-squares steps for errors (N, C), less damped the smaller the error.

    columns : (N, C, J) derivative of what the error is of.
    """
    size = np.minimum(1.0, 10.0 * np.linalg.norm(error, axis=1))
    square = columns @ columns.transpose(0, 2, 1)
    square += ((damping * size) ** 2 + 1e-12)[:, None, None] * np.eye(error.shape[1])
    pull = np.linalg.solve(square, error[..., None])[..., 0]
    return np.asarray(np.einsum("ncj,nc->nj", columns, pull))


def _shortened(step: Array, longest: float) -> Array:
    """(N, J) steps (N, J) of at most `longest`, in the same direction."""
    return np.asarray(step / np.maximum(np.abs(step).max(axis=1, keepdims=True) / longest, 1.0))


def _error(frames: Frames, poses: Array) -> Array:
    """(6, N) [m, rad] of the last frame from the poses (N, 4, 4)."""
    return pose_error(poses[:, :3, :3].transpose(1, 2, 0), poses[:, :3, 3].T, frames)


def point_columns(chain: Chain, point: Array, q: Array) -> tuple[Array, Array]:
    """Place (N, 3) [m] of a point on the flange, and its derivative (N, 3, J) [m/rad].

    point : (3,) [m] in the flange's frame. q : (N, J) [rad].
    """
    frames = forward(chain, q)
    place = frames.tip.T + np.einsum("ijn,j->ni", frames.rotation(), point)
    arm = place.T[None] - frames.origin[:-1]  # (J, 3, N)
    return place, np.cross(frames.z[:-1], arm, axis=1).transpose(2, 1, 0)


def reach_points(
    robot: Robot,
    chain: Chain,
    *,
    point: Array,
    q: Array,
    wanted: Array,
    lower: Array,
    upper: Array,
    position: Position | None = None,
    tolerance: float = 1e-9,
) -> tuple[Array, NDArray[np.bool_]]:
    """Joint angles that bring a point on the flange to the wanted places.

    chain : DH rows of the arm. point : (3,) [m] in the flange's frame. q : (N, J) [rad] start.
    wanted : (N, 3) [m] in the base frame. lower, upper : (J,) [rad] limits of the axis angles.
    position : place of the point at joint angles, of an arm that differs a little from `chain`; by
        default that of `chain`. tolerance : [m]

    Returns joint angles (N, J) [rad] and which of them reach their place (N,).
    """
    axes = np.clip(joints_to_axes(robot, q), lower, upper)
    if position is not None:  # which takes longer, so that most of the way is the chain's
        nearly, _ = reach_points(
            robot, chain, point=point, q=q, wanted=wanted, lower=lower, upper=upper
        )
        axes = joints_to_axes(robot, nearly)
    reached = np.zeros(len(axes), dtype=bool)
    for _ in range(POINT_STEPS if position is None else POINT_CORRECTIONS):
        (missing,) = np.nonzero(~reached)
        if not missing.size:
            break
        before = axes[missing]
        angles = controller_to_joints(robot, before)
        place, columns = point_columns(chain, point, angles)
        error = wanted[missing] - (place if position is None else position(angles))
        reached[missing] = np.abs(error).max(axis=1) < tolerance
        columns = columns @ robot.controller_to_joint.T  # per radian of the axes
        step = _damped(columns, error, POINT_DAMPING)
        # an axis at its limit cannot help, and the others take its part
        stuck = ((before <= lower) & (step < 0.0)) | ((before >= upper) & (step > 0.0))
        step = np.where(stuck, 0.0, _damped(columns * ~stuck[:, None], error, POINT_DAMPING))
        step = _shortened(step, POINT_LONGEST)
        axes[missing] = np.where(reached[missing, None], before, before + step)
        axes = np.clip(axes, lower, upper)
    return controller_to_joints(robot, axes), reached


@dataclass(frozen=True, eq=False)
class _Table:
    """Random joint angles (T, J) [rad], and a tree of their poses."""

    q: Array
    tree: cKDTree


@lru_cache(maxsize=4)
def _table(*rows: bytes) -> _Table:
    chain = Chain(*(np.frombuffer(row) for row in rows))
    q = np.random.default_rng(_SEED).uniform(-np.pi, np.pi, (TABLE, chain.rows))
    return _Table(q, cKDTree(_features(forward(chain, q).poses(), length_of(chain))))


def _features(poses: Array, length: float) -> Array:
    """(N, 12) [-] numbers whose distance is that of poses: place by the length, then rotation."""
    turned = poses[:, :3, :3].reshape(len(poses), 9) / np.sqrt(2.0)
    return np.concatenate((poses[:, :3, 3] / length, turned), axis=1)
