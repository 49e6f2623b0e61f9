"""Standard DH rows of a mechanism whose joint axes are known as lines in space.

Consecutive axes are joined by their common normal (Denavit & Hartenberg 1955). Where that is not
unique, the choice is that of published tables: of parallel axes the normal through the current
origin, so d = 0; of intersecting axes a = 0; of collinear axes neither. The direction of x_i is the
one nearer to x_(i-1), so -90 < theta <= 90 deg, and at a right angle the one with a > 0.

Standard rows have four numbers where a pose has six. What they cannot hold is left as a constant
transform at either end: `T_base_tip = T_base_dh @ T_1 ... T_J @ T_flange_tip`. The height of the
base and its turn about axis 1 are in row 1 where the base's z is parallel to that axis, and
those of the tip in row J.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array, read_only
from ballbar.cell.chain import Chain, forward

TOLERANCE = 1e-9  # [m, or sine of an angle] less is rounding: parallel, intersecting
NEARLY_PARALLEL = 0.01  # [rad] sine of an angle below which rows become ill-conditioned: d = a/sine


@dataclass(frozen=True, eq=False)
class JointAxes:
    """The axes of J joints and the tip at joint angles zero, in the base frame."""

    point: Array  # (J, 3) [m] a point on each axis
    direction: Array  # (J, 3) unit vectors; a positive turn is right-handed about them
    T_base_tip: Array  # (4, 4) [m]

    def __post_init__(self) -> None:
        for name in ("point", "direction", "T_base_tip"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class DHForm:
    """Standard DH rows, and what is around them."""

    chain: Chain  # J rows; beta is zero
    sign: Array  # (J,) +1 or -1: DH joint angle = sign * angle about the given axis
    T_base_dh: Array  # (4, 4) [m] pose of the frame of row 1 in the base frame
    T_flange_tip: Array  # (4, 4) [m] pose of the tip in the frame of row J

    def __post_init__(self) -> None:
        for name in ("sign", "T_base_dh", "T_flange_tip"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def tip_poses(self, angles: Array) -> Array:
        """(N, 4, 4) [m] poses T_base_tip at angles (N, J) [rad] about the given axes."""
        poses = forward(self.chain, angles * self.sign).poses()
        return np.asarray(self.T_base_dh @ poses @ self.T_flange_tip)


class AxesError(ValueError):
    """The axes have no usable standard DH rows."""


@dataclass(eq=False)
class _Frame:
    """Origin and axes of the current DH frame, in the base frame."""

    origin: Array
    x: Array
    z: Array

    @property
    def pose(self) -> Array:
        pose = np.eye(4)
        pose[:3, :3] = np.stack((self.x, np.cross(self.z, self.x), self.z), axis=1)
        pose[:3, 3] = self.origin
        return pose


def dh_from_axes(axes: JointAxes) -> DHForm:
    """Standard DH rows of joint axes: points (J, 3) [m] and directions (J, 3).

    An axis that points against the one before it, the first against the base's z and the last
    against the tip's z is reversed and its joint angle counted negative, so that parallel axes have
    alpha = 0.

    Raises AxesError for two neighbours that are nearly, but not exactly, parallel.
    """
    z, sign = _aligned(axes)
    # row 1: the base frame itself where axis 1 is its z, otherwise on axis 1
    foot = axes.point[0] - (axes.point[0] @ z[0]) * z[0]
    frame = _Frame(np.where(np.abs(foot) < TOLERANCE, 0.0, foot), _square_to(z[0]), z[0])
    T_base_dh = frame.pose
    rows = []
    for i in range(len(z) - 1):
        row, frame = _next_row(frame, axes.point[i + 1], z[i + 1], i + 1)
        rows.append(row)
    row, frame = _last_row(frame, axes)
    rows.append(row)
    a, d, alpha, theta = np.array(rows).T
    chain = Chain(a, d, alpha, theta, np.zeros_like(a))
    T_flange_tip = _inverse(frame.pose) @ axes.T_base_tip
    return DHForm(chain, sign, _cleaned(T_base_dh), _cleaned(T_flange_tip))


def dh_from_modified(a: Array, d: Array, alpha: Array, theta: Array) -> DHForm:
    """Standard DH rows of modified ones, `Rx(alpha) Tx(a) Rz(theta + q) Tz(d)` (Craig 1989).

    a, d : (J,) [m]. alpha, theta : (J,) [rad]. Row i takes a and alpha of the modified row i+1;
    those of the first modified row become the transform of the base.
    """
    zero = np.zeros(1)
    chain = Chain(
        a=np.concatenate((a[1:], zero)),
        d=d,
        alpha=np.concatenate((alpha[1:], zero)),
        theta=theta,
        beta=np.zeros_like(a),
    )
    first = Chain(a[:1], zero, alpha[:1], zero, zero)
    return DHForm(chain, np.ones_like(a), forward(first, np.zeros((1, 1))).poses()[0], np.eye(4))


def _aligned(axes: JointAxes) -> tuple[Array, Array]:
    """Directions (J, 3) with parallel neighbours the same way, and the signs (J,) for it."""
    z = np.array(axes.direction / np.linalg.norm(axes.direction, axis=1)[:, None])
    given = z.copy()
    count = len(z)
    previous = np.array([0.0, 0.0, 1.0])
    for i in range(count):
        if _is_parallel(previous, z[i]) and previous @ z[i] < 0.0:
            z[i] = -z[i]
        previous = z[i]
    tip = axes.T_base_tip[:3, 2]
    bound = count > 1 and _is_parallel(z[-2], z[-1])  # its direction is that of its neighbour
    if not bound and _is_parallel(tip, z[-1]) and tip @ z[-1] < 0.0:
        z[-1] = -z[-1]
    return z, np.sign((z * given).sum(axis=1))


def _square_to(z: Array) -> Array:
    """The base's x axis without its part along z; its y axis where x is parallel to z."""
    x = np.array([1.0, 0.0, 0.0])
    if _is_parallel(x, z):
        x = np.array([0.0, 1.0, 0.0])
    x = x - (x @ z) * z
    return np.asarray(x / np.linalg.norm(x))


def _next_row(frame: _Frame, point: Array, z: Array, number: int) -> tuple[list[float], _Frame]:
    """Row `number` (from 1) to the next axis, as a, d, alpha, theta, and the frame behind it."""
    to_axis = point - frame.origin
    normal = np.cross(frame.z, z)
    sine = float(np.linalg.norm(normal))
    if sine < TOLERANCE:
        across = to_axis - (to_axis @ frame.z) * frame.z
        distance = float(np.linalg.norm(across))
        d = 0.0
        direction = frame.x if distance < TOLERANCE else across / distance
    elif sine < NEARLY_PARALLEL:
        raise AxesError(
            f"axes {number} and {number + 1} are {np.rad2deg(sine):.4g} deg from parallel, where "
            "standard DH rows are ill-conditioned. A nominal description has them parallel: write "
            "the angles of the joints' origins with all digits (1.570796, not 1.57), and leave out "
            "the calibrated values of a single robot."
        )
    else:
        direction = normal / sine
        distance = float(to_axis @ direction)
        # foot of the common normal on this axis: to_axis = d z + distance n - s z'
        d = float(np.cross(to_axis, z) @ direction) / sine
    if abs(distance) < TOLERANCE:
        distance = 0.0
    nearer = float(direction @ frame.x)
    backward = nearer < -TOLERANCE or (abs(nearer) <= TOLERANCE and distance < 0.0)
    x = -direction if backward else direction
    a = -distance if backward else distance
    row = [a, d, _turn(x, frame.z, z), _turn(frame.z, frame.x, x)]
    return row, _Frame(frame.origin + d * frame.z + a * x, x, z)


def _last_row(frame: _Frame, axes: JointAxes) -> tuple[list[float], _Frame]:
    """Row J, as a, d, alpha, theta, and its frame: along its axis up to the tip.

    And about it, if the tip's z axis is parallel to it; other turns are left to T_flange_tip.
    """
    T_base_tip = axes.T_base_tip
    d = float((T_base_tip[:3, 3] - frame.origin) @ frame.z)
    square = _is_parallel(T_base_tip[:3, 2], frame.z)  # then the tip's x is square to the axis
    x = T_base_tip[:3, 0] if square else frame.x
    row = [0.0, d, 0.0, _turn(frame.z, frame.x, x)]
    return row, _Frame(frame.origin + d * frame.z, x, frame.z)


def _turn(axis: Array, start: Array, end: Array) -> float:
    """[rad] angle about an axis from one unit vector square to it to another."""
    angle = float(np.arctan2(np.cross(start, end) @ axis, start @ end))
    return np.pi if angle < -np.pi + TOLERANCE else angle


def _is_parallel(u: Array, v: Array) -> bool:
    return float(np.linalg.norm(np.cross(u, v))) < TOLERANCE


def _inverse(pose: Array) -> Array:
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse


def _cleaned(pose: Array) -> Array:
    """A pose without rounding where it is the identity."""
    return np.eye(4) if np.abs(pose - np.eye(4)).max() < TOLERANCE else pose
