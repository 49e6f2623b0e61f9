"""Inverse kinematics in closed form for nominal machines, by Newton's method for imperfect ones.

Robot: both machines have an offset shoulder, a parallel upper arm and a spherical wrist, `alpha =
(-pi/2, 0, -pi/2, s*pi/2, -s*pi/2, 0)` with s = +1 (IRB 2400) or -1 (NJ 220). The wrist is decoupled
(Pieper's method) and solved as ZYZ angles.
Ball-bar: the rod's direction u in the base and v in the tool frame are `u_x + i u_y = -sin(b2)
exp(i b1)`, `u_z = cos(b2)` and `-v_x + i v_y = -sin(b4) exp(i b5)`, `v_z = cos(b4)`.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.chain import Chain, Frames, forward, joint_screws
from cell.errors import FailureError, InputError
from cell.rotation import rotvec_from_matrix

REACHED = 1e-9  # [m, rad] of a pose that fewer than six joints take, far above rounding
# [rad] twists of the arms that have a closed form, s = +1; those of an identified robot are close
_ARM_ALPHA = np.array([-1.0, 0.0, -1.0, 1.0, -1.0, 0.0]) * (np.pi / 2.0)
_ARM_TOLERANCE = 0.1
# [rad] twists of the ball-bar, thesis sec. 2.2
BAR_ALPHA = np.array([1.0, -1.0, 1.0, -1.0, 0.0]) * (np.pi / 2.0)


class UnreachableError(FailureError):
    """A pose that the mechanism cannot take."""


def has_arm_structure(chain: Chain) -> bool:
    """Whether a robot is of the structure that has a closed form."""
    mirrored = _ARM_ALPHA * (1.0, 1.0, 1.0, -1.0, -1.0, 1.0)
    return chain.rows == 6 and any(
        np.allclose(chain.alpha, alpha, rtol=0.0, atol=_ARM_TOLERANCE)
        for alpha in (_ARM_ALPHA, mirrored)
    )


def has_closed_form(chain: Chain) -> bool:
    """Whether `robot_branches` holds for a chain: nominal rows of that structure, no offset beside.

    The axes of an arm that is built alike may miss one another: then its wrist is not decoupled.
    """
    offsets = [chain.a[3], chain.a[4], chain.d[1] + chain.d[2], chain.d[4], *chain.beta]
    return (
        has_arm_structure(chain)
        and bool(np.abs(np.abs(chain.alpha) - np.abs(_ARM_ALPHA)).max() < REACHED)
        and bool(np.abs(offsets).max() < REACHED)
    )


def robot_branches(chain: Chain, poses: Array, *, behind: bool = False) -> Array:
    """Joint angles of the nominal robot in its four configurations with the arm in front.

    poses : (N, 4, 4) tool frames in the base frame. behind : the four with the shoulder turned away
        from the wrist, which reaches back over it.

    Returns (4, N, 6) [rad] in the order elbow up and wrist +, up and -, down and +, down and -; NaN
    where a pose is out of reach, or where the wrist is exactly singular. Raises InputError for a
    robot of another structure (cell.numerical_inverse).
    """
    if not has_closed_form(chain):
        raise InputError(
            "angles in closed form are those of nominal robots of six axes with parallel axes 2 "
            "and 3 and a spherical wrist, and this robot is built otherwise"
        )
    rotation, tip = poses[:, :3, :3], poses[:, :3, 3]
    wrist = tip - chain.a[5] * rotation[:, :, 0] - chain.d[5] * rotation[:, :, 2]
    side = -1.0 if behind else 1.0
    shoulder = np.arctan2(side * wrist[:, 1], side * wrist[:, 0])
    forward_reach = side * np.hypot(wrist[:, 0], wrist[:, 1]) - chain.a[0]
    up = wrist[:, 2] - chain.d[0]
    upper, fore = chain.a[1], np.hypot(chain.a[2], chain.d[3])
    fore_angle = np.arctan2(chain.d[3], chain.a[2])
    cosine = (forward_reach**2 + up**2 - upper**2 - fore**2) / (2.0 * upper * fore)
    cosine[np.abs(cosine) > 1.0] = np.nan
    solutions = []
    # + folds the forearm forward: the angles of the arm are measured downwards from the horizontal.
    for elbow in (1.0, -1.0):
        bend = elbow * np.arccos(cosine)
        inner = np.arctan2(fore * np.sin(bend), upper + fore * np.cos(bend))
        theta2 = np.arctan2(-up, forward_reach) - inner
        theta3 = bend - fore_angle
        arm = np.stack((shoulder, theta2, theta3), axis=1) - chain.theta[:3]
        solutions += _wrists(chain, rotation, arm)
    branches = np.stack(solutions)
    reached = forward(chain, branches.reshape(-1, 6)).poses().reshape(4, *poses.shape)
    off = np.abs(reached - poses).max(axis=(2, 3))
    branches[~(off < REACHED)] = np.nan
    return branches


def arm_branches(chain: Chain, poses: Array) -> Array | None:
    """All configurations of `robot_branches`, also where axes are counted in the other direction.

    poses : (N, 4, 4) tool frames in the base frame.

    Returns (8, N, 6) [rad], NaN where a configuration does not exist; None for a robot of another
    structure.
    """
    usual, sign = _usual(chain)
    if not has_closed_form(usual):
        return None
    ends = poses.copy()
    ends[:, :3, 1:3] *= sign[-1]
    q = [robot_branches(usual, ends, behind=behind) for behind in (False, True)]
    return np.asarray(np.concatenate(q) * sign[:-1])


def has_arm_branches(chain: Chain) -> bool:
    """Whether `arm_branches` holds for a chain."""
    return has_closed_form(_usual(chain)[0])


def _usual(chain: Chain) -> tuple[Chain, Array]:
    """The chain with those z axes reversed that bring its twists nearest to the structure's.

    Reversing the z axis of a frame changes a twist by half a turn, and negates angle and offset d
    of the row that follows. Returns the chain, and (J+1,) the sign of each frame's z axis.
    """
    if chain.rows != _ARM_ALPHA.size:
        return chain, np.ones(chain.rows + 1)
    turned, alpha = np.zeros(chain.rows + 1), np.empty(chain.rows)  # half turns of each frame
    for i, twist in enumerate(_ARM_ALPHA):
        alpha[i] = _wrapped(chain.alpha[i] + np.pi * turned[i])
        turned[i + 1] = abs(_wrapped(alpha[i] - twist)) > np.pi / 2.0
        alpha[i] = _wrapped(alpha[i] - np.pi * turned[i + 1])
    sign = 1.0 - 2.0 * turned
    d, theta = sign[:-1] * chain.d, sign[:-1] * chain.theta
    return Chain(chain.a, d, alpha, theta, chain.beta), sign


def _wrapped(angle: float) -> float:
    """[rad] between -pi and pi."""
    return float(np.angle(np.exp(1j * angle)))


def _wrists(chain: Chain, rotation: Array, arm: Array) -> list[Array]:
    first = Chain(*(getattr(chain, field.name)[:3] for field in fields(chain)))
    forearm = forward(first, arm).rotation().transpose(2, 0, 1)
    rest = forearm.transpose(0, 2, 1) @ rotation  # Rz(t4) Ry(-s t5) Rz(t6)
    s = np.sign(chain.alpha[3])
    out = []
    for side in (1.0, -1.0):
        tilt = side * np.arctan2(np.hypot(rest[:, 0, 2], rest[:, 1, 2]), rest[:, 2, 2])
        theta4 = np.arctan2(side * rest[:, 1, 2], side * rest[:, 0, 2])
        theta6 = np.arctan2(side * rest[:, 2, 1], -side * rest[:, 2, 0])
        wrist = np.stack((theta4, -s * tilt, theta6), axis=1) - chain.theta[3:]
        out.append(np.concatenate((arm, np.arctan2(np.sin(wrist), np.cos(wrist))), axis=1))
    return out


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
    target_rotation, target_tip = poses[:, :3, :3].transpose(1, 2, 0), poses[:, :3, 3].T
    for _ in range(iterations):
        frames = forward(chain, q)
        error = pose_error(target_rotation, target_tip, frames)
        jacobian = joint_screws(frames).transpose(2, 1, 0)
        try:
            step = _newton_step(jacobian, error)
        except np.linalg.LinAlgError:
            raise UnreachableError(_singular(jacobian, q)) from None
        # a step of more than 0.3 rad is a sign of a singularity, not of progress
        q += np.clip(step, -0.3, 0.3)
        reached = chain.rows >= 6 or np.abs(error).max() < REACHED
        if np.abs(step).max() < tolerance and reached:
            return q
    bad = int(np.abs(step).max(axis=1).argmax())
    raise UnreachableError(
        f"inverse kinematics: pose {bad} of {len(q)} (counted from 0) is not reached in "
        f"{iterations} steps; {np.linalg.norm(error[:3, bad]) * 1e3:.3g} mm are left. Move it into "
        "the reach of the arm, or start closer to it."
    )


def _newton_step(jacobian: Array, error: Array) -> Array:
    """(N, J) [rad] step of least squares and least length; jacobian : (N, 6, J), error : (6, N)."""
    if jacobian.shape[1] == jacobian.shape[2]:
        return np.asarray(np.linalg.solve(jacobian, error.T[:, :, None])[:, :, 0])
    return np.asarray(np.einsum("njk,kn->nj", np.linalg.pinv(jacobian), error))


def _singular(jacobian: Array, q: Array) -> str:
    """Says which sample cannot be solved for; jacobian : (N, 6, 6), one of them singular."""
    bad = int(np.abs(np.linalg.det(jacobian)).argmin())
    angles = " ".join(f"{angle:.1f}" for angle in np.degrees(q[bad]))
    return (
        f"inverse kinematics: pose {bad} of {len(q)} (counted from 0) leads to a singular posture "
        f"of the robot, joints at {angles} deg. Move the start or the pose away from it."
    )


def refine_reachable(
    chain: Chain, q: Array, poses: Array, *, tolerance: float = 1e-13
) -> tuple[Array, NDArray[np.bool_]]:
    """As `refine`, for the poses that the chain can take: angles (K, J) [rad], and which (N,)."""
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
