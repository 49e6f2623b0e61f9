"""Inverse kinematics of ideal ball-bars in closed form, of any chain by Newton's method.

Ball-bar: the rod's direction u in the base and v in the tool frame are `u_x + i u_y = -sin(b2)
exp(i b1)`, `u_z = cos(b2)` and `-v_x + i v_y = -sin(b4) exp(i b5)`, `v_z = cos(b4)`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, Frames, forward, joint_screws
from ballbar.cell.errors import FailureError
from ballbar.cell.rotation import rotvec_from_matrix

REACHED = 1e-9  # [m, rad] of a pose that fewer than six joints take, far above rounding
# [rad] twists of the ball-bar, thesis sec. 2.2
BAR_ALPHA = np.array([1.0, -1.0, 1.0, -1.0, 0.0]) * (np.pi / 2.0)


class UnreachableError(FailureError):
    """A pose that the mechanism cannot take."""


def bar_angles(
    poses: Array, origin: Array, *, flipped: tuple[bool, bool] = (False, False)
) -> Array:
    """(N, 5) [rad] angles, not unwrapped, of an ideal ball-bar that holds the tool at each pose.

    poses : (N, 4, 4) tool frames. origin : (3,) [m] centre of the sphere. flipped : whether b2 and
        b4 are negative, which gives the four configurations of gimbal and universal joint.
    """
    rotation, tip = poses[:, :3, :3], poses[:, :3, 3]
    rod = tip - origin
    u = rod / np.linalg.norm(rod, axis=1, keepdims=True)
    v = np.einsum("nij,ni->nj", rotation, u)
    b1, b2 = _pair(u[:, 0], u[:, 1], u[:, 2], flipped[0])
    b5, b4 = _pair(-v[:, 0], v[:, 1], v[:, 2], flipped[1])
    return np.stack((b1, b2, bar_roll(rotation, b1, b2, b4, b5), b4, b5), axis=1)


def _pair(x: Array, y: Array, z: Array, flipped: bool) -> tuple[Array, Array]:
    sign = -1.0 if flipped else 1.0
    return np.arctan2(-sign * y, -sign * x), sign * np.arctan2(np.hypot(x, y), z)


def bar_roll(rotation: Array, b1: Array, b2: Array, b4: Array, b5: Array) -> Array:
    """(N,) [rad] angle b3 about the rod of an ideal ball-bar, from R = G(b1, b2) Rz(b3) K(b4, b5).

    rotation : (N, 3, 3) of the tool frame in the base. b1, b2, b4, b5 : (N,) [rad].
    """
    gimbal = _turned(BAR_ALPHA[:2], b1, b2)
    universal = _turned(BAR_ALPHA[2:], np.zeros_like(b4), b4, b5)
    about_rod = gimbal.transpose(0, 2, 1) @ rotation @ universal.transpose(0, 2, 1)
    return np.arctan2(about_rod[:, 1, 0], about_rod[:, 0, 0])


def _turned(alpha: Array, *angles: Array) -> Array:
    zero = np.zeros(alpha.size)
    frames = forward(Chain(zero, zero, alpha, zero, zero), np.stack(angles, axis=1))
    return frames.rotation().transpose(2, 0, 1)


def refine(
    chain: Chain, q: Array, poses: Array, *, iterations: int = 20, tolerance: float = 1e-13
) -> Array:
    """Joint angles that bring a chain exactly to each pose, by Newton steps from a start close by.

    More than six joints take the shortest steps, fewer reach only some poses.

    q : (N, J) [rad] start; poses : (N, 4, 4) tool frames in the base frame.

    Returns (N, J) [rad]. Raises UnreachableError when a pose is not reached, or when a joint
    Jacobian on the way is singular.
    """
    q = q.copy()
    if not q.size:
        return q
    target_rotation, target_tip = poses[:, :3, :3].transpose(1, 2, 0), poses[:, :3, 3].T
    for _ in range(iterations):
        frames = forward(chain, q)
        error = pose_error(target_rotation, target_tip, frames)
        jacobian = joint_screws(frames).transpose(2, 1, 0)
        try:
            if chain.rows == len(error):
                step = np.linalg.solve(jacobian, error.T[:, :, None])[:, :, 0]
            else:  # of least squares and least length
                step = np.einsum("njk,kn->nj", np.linalg.pinv(jacobian), error)
        except np.linalg.LinAlgError:
            bad = int(np.abs(np.linalg.det(jacobian)).argmin())
            angles = " ".join(f"{angle:.1f}" for angle in np.degrees(q[bad]))
            what = f"leads to a singular posture of the robot, joints at {angles} deg."
            remedy = "Move the start or the pose away from it."
            raise UnreachableError(f"{_pose(bad, q)} {what} {remedy}") from None
        # a step of more than 0.3 rad is a sign of a singularity, not of progress
        q += np.clip(step, -0.3, 0.3)
        reached = chain.rows >= 6 or np.abs(error).max() < REACHED
        if np.abs(step).max() < tolerance and reached:
            return q
    bad = int(np.abs(step).max(axis=1).argmax())
    left = np.linalg.norm(error[:3, bad]) * 1e3
    what = f"is not reached in {iterations} steps; {left:.3g} mm are left."
    remedy = "Move it into the reach of the arm, or start closer to it."
    raise UnreachableError(f"{_pose(bad, q)} {what} {remedy}")


def _pose(k: int, q: Array) -> str:
    return f"inverse kinematics: pose {k} of {len(q)} (counted from 0)"


def refine_reachable(
    chain: Chain, q: Array, poses: Array, *, tolerance: float = 1e-13
) -> tuple[Array, NDArray[np.bool_]]:
    """Angles (K, J) [rad] of `refine` at the poses that the chain takes; which of them (N,)."""
    try:
        return refine(chain, q, poses, tolerance=tolerance), np.ones(len(q), dtype=bool)
    except UnreachableError:
        reached, angles = np.zeros(len(q), dtype=bool), np.empty((0, chain.rows))
        for k in range(len(q)):
            try:
                refined = refine(chain, q[k : k + 1], poses[k : k + 1], tolerance=tolerance)
            except UnreachableError:
                continue
            reached[k], angles = True, np.concatenate((angles, refined))
        return angles, reached


def pose_error(rotation: Array, tip: Array, frames: Frames) -> Array:
    """(6, N) [m, rad] pose error of the last frame: target tip minus its tip, and rotation vector.

    rotation : (3, 3, N), tip : (3, N) [m] target pose. The rotation vector turns the frame onto it.
    """
    turned = np.einsum("ikn,jkn->ijn", rotation, frames.rotation())
    return np.concatenate((tip - frames.tip, rotvec_from_matrix(turned)))
