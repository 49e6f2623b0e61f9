"""Rotations over many samples: logarithm, exponential, Jacobian; quaternions. Sample index last.

Sources: Murray, Li & Sastry 1994, sec. 2.2 (exponential, logarithm); Barfoot 2017, eq. 7.76
(inverse left Jacobian).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array

_SMALL = 1e-4  # [rad] below it the series is exact to rounding: next term is phi^4/360 ~ 3e-19
_NEAR_HALF_TURN = 3.0  # [rad] beyond it the skew part loses the axis


def even_directions(count: int) -> Array:
    """(count, 3) unit vectors spread evenly over a sphere: a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - height * height)
    return np.column_stack((across * np.cos(turn), across * np.sin(turn), height))


def rotvec_from_matrix(rotation: Array) -> Array:
    """(3, N) [rad] rotation vectors of (3, 3, N) rotation matrices, angle within [0, pi]."""
    skew = 0.5 * np.stack(
        (
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        )
    )
    sine = np.sqrt((skew * skew).sum(axis=0))
    angle = np.arctan2(sine, 0.5 * (rotation[0, 0] + rotation[1, 1] + rotation[2, 2] - 1.0))
    scale = np.where(
        angle < _SMALL, 1.0 + angle * angle / 6.0, angle / np.where(sine == 0.0, 1.0, sine)
    )
    rotvec = scale * skew
    far = angle > _NEAR_HALF_TURN
    if far.any():
        rotvec[:, far] = Rotation.from_matrix(rotation[:, :, far].transpose(2, 0, 1)).as_rotvec().T
    return np.asarray(rotvec)


def matrix_from_rotvec(rotvec: Array) -> Array:
    """(3, 3, N) rotation matrices of (3, N) [rad] rotation vectors."""
    return np.asarray(Rotation.from_rotvec(np.array(rotvec.T)).as_matrix()).transpose(1, 2, 0)


def inverse_left_jacobian(rotvec: Array, vectors: Array) -> Array:
    """Rate (..., 3, N) of rotation vectors whose rotations are turned on the left: J_l(phi)^-1 w.

    rotvec : (3, N) [rad] phi. vectors : (..., 3, N) angular velocities w in base coordinates. For
        rotations turned on the right, J_l(-phi)^-1 w, pass `-rotvec`.
    """
    square = (rotvec * rotvec).sum(axis=0)
    angle = np.sqrt(square)
    small = angle < 1e-2  # [rad] the closed form cancels below; series error 1e-10 * phi^2
    factor = 1.0 / 12.0 + square / 720.0
    if not small.all():
        safe = np.where(small, 1.0, angle)
        half = 0.5 * safe
        factor = np.where(small, factor, (1.0 - half / np.tan(half)) / (safe * safe))
    x, y, z = rotvec
    xx, yy, zz = factor * x * x, factor * y * y, factor * z * z
    xy, xz, yz = factor * x * y, factor * x * z, factor * y * z
    a, b, c = 0.5 * x, 0.5 * y, 0.5 * z
    rest = 1.0 - (xx + yy + zz)
    matrix = np.array(
        ((rest + xx, xy + c, xz - b), (xy - c, rest + yy, yz + a), (xz + b, yz - a, rest + zz))
    )
    return np.asarray(np.einsum("ijn,...jn->...in", matrix, vectors))


def left_jacobian(rotvec: Array) -> Array:
    """(3, 3) J_l(phi): angular velocity in base coordinates per rate of phi (3,) [rad]."""
    columns = inverse_left_jacobian(rotvec[:, None], np.eye(3)[:, :, None])[:, :, 0]
    return np.asarray(np.linalg.inv(columns.T))


def roll_pitch_yaw(rotation: Array) -> Array:
    """(3,) [rad] roll, pitch, yaw of a rotation matrix (3, 3) = Rz(yaw) Ry(pitch) Rx(roll).

    Yaw and pitch are those of what is left without the roll, so that they are exact to rounding
    also where the pitch is nearly a quarter turn and the roll by itself is not determined.
    """
    roll = float(np.arctan2(rotation[2, 1], rotation[2, 2]))
    cos, sin = np.cos(roll), np.sin(roll)
    rest = rotation @ np.array([[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]])
    pitch, yaw = np.arctan2(-rest[2, 0], rest[2, 2]), np.arctan2(-rest[0, 1], rest[1, 1])
    return np.array([roll, pitch, yaw])


def quat_wxyz(rotation: Array) -> Array:
    """(4,) unit quaternion of a rotation matrix (3, 3), scalar part first as MuJoCo wants it.

    Its largest component is computed first (Shepperd's method); the result is to the last digit
    that of MuJoCo's `mju_mat2Quat`.
    """
    x, y, z = np.diag(rotation)
    product = rotation + rotation.T  # becomes 4 q q' of q = x y z, then of w x y z
    product[[0, 1, 2], [0, 1, 2]] = 1.0 + x - y - z, 1.0 - x + y - z, 1.0 - x - y + z
    axial = rotation[[2, 0, 1], [1, 2, 0]] - rotation[[1, 2, 0], [2, 0, 1]]
    product = np.block([[np.array(1.0 + x + y + z), axial], [axial[:, None], product]])
    k = 0 if x + y + z > 0.0 else 3 - int(np.argmax((z, y, x)))
    largest = 0.5 * np.sqrt(product[k, k])
    quat = 0.25 * product[k] / largest
    quat[k] = largest
    return np.asarray(quat)
