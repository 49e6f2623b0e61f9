"""Loop closure: the signed mismatch between the two ways to the tool, and its derivatives.

At every sample the tool frame is reached through the robot, R(q), and through the ball-bar, B(b). The residual is what
the ball-bar says minus what the robot says, `e = [p_B - p_R, log(R_B R_R^T)]`, six signed numbers in base coordinates.
Signed components keep the Jacobian alive at the solution; the thesis's scalar costs (eqs. 2.2-2.4), squared once more by
least squares, make it vanish there.

Ball-bar joints without encoder are free: what they can move is removed by the left null space of their columns (in the
whitened metric), so 0, 2, 4 or 5 encoders are one code path with 1, 3, 5 or 6 equations a sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.chain import Array, Frames, joint_screws, screw
from cell.geometry import BAR_ROWS, Geometry, Parameter, bar_frames, parameter_screw, robot_frames
from cell.inverse import bar_angles, bar_roll
from cell.rotation import inverse_left_jacobian, rotvec_from_matrix


@dataclass(frozen=True, eq=False)
class Closure:
    """The mismatch of N samples and everything its derivatives need."""

    geometry: Geometry
    robot: Frames
    bar: Frames
    error: Array  # (6, N) [m, m, m, rad, rad, rad]


def close_loop(geometry: Geometry, q: Array, b: Array) -> Closure:
    """Mismatch at robot angles q (N, 6) and ball-bar angles b (N, 5) [rad], before the zeros in btheta are added."""
    robot, bar = robot_frames(geometry, q), bar_frames(geometry, b)
    turned = np.einsum("ikn,jkn->ijn", bar.rotation(), robot.rotation())
    return Closure(geometry, robot, bar, np.concatenate((bar.tip - robot.tip, rotvec_from_matrix(turned))))


def _of_bar(closure: Closure, motion: Array) -> Array:
    """(..., 6, N) change of the mismatch for a motion of the ball-bar's tool frame."""
    motion[..., 3:, :] = inverse_left_jacobian(closure.error[3:], motion[..., 3:, :])
    return motion


def _of_robot(closure: Closure, motion: Array) -> Array:
    motion[..., 3:, :] = inverse_left_jacobian(-closure.error[3:], motion[..., 3:, :])
    return np.negative(motion, out=motion)


def parameter_jacobian(closure: Closure, parameters: Sequence[Parameter]) -> Array:
    """(P, 6, N) derivative of the mismatch with respect to geometric parameters [m or rad per unit]."""
    out = np.empty((len(parameters), 6, closure.error.shape[1]))
    for k, parameter in enumerate(parameters):
        out[k] = parameter_screw(closure.geometry, closure.robot, closure.bar, parameter)
    for side, of in (("robot", _of_robot), ("bar", _of_bar)):
        chosen = [k for k, p in enumerate(parameters) if (p.side == "robot") == (side == "robot")]
        for first, last in _runs(chosen):
            of(closure, out[first:last])
    return out


def _runs(indices: list[int]) -> list[tuple[int, int]]:
    """Stretches (first, one past last) of consecutive indices."""
    starts = [i for n, i in enumerate(indices) if n == 0 or indices[n - 1] != i - 1]
    ends = [i + 1 for n, i in enumerate(indices) if n == len(indices) - 1 or indices[n + 1] != i + 1]
    return list(zip(starts, ends, strict=True))


def robot_joint_jacobian(closure: Closure) -> Array:
    """(6, 6, N) derivative of the mismatch with respect to each robot joint angle."""
    return _of_robot(closure, joint_screws(closure.robot))


def bar_joint_jacobian(closure: Closure) -> Array:
    """(5, 6, N) derivative of the mismatch with respect to each ball-bar joint angle."""
    return _of_bar(closure, joint_screws(closure.bar))


def rod_jacobian(closure: Closure) -> Array:
    """(6, N) derivative of the mismatch with respect to the rod length."""
    return _of_bar(closure, screw(closure.bar, "d", 2))


def covariance(closure: Closure, joint_sigma: Array, encoder_sigma: Array, rod_sigma: float) -> Array:
    """(6, 6, N) covariance of the mismatch that noise on the angles and a yielding rod induce (Gauss-Helmert).

    joint_sigma : (6,) [rad]; encoder_sigma : (5,) [rad], 0 where no encoder is fitted; rod_sigma : [m].
    `C = Jq Sq Jq' + Jb Sb Jb' + Jl Sl Jl' + floor`; errors in variables, so both logs count as measured.
    """
    columns = np.concatenate(
        (
            robot_joint_jacobian(closure) * joint_sigma[:, None, None],
            bar_joint_jacobian(closure) * encoder_sigma[:, None, None],
            rod_jacobian(closure)[None] * rod_sigma,
        )
    )
    spread = columns.transpose(2, 1, 0)
    out = (spread @ spread.transpose(0, 2, 1)).transpose(1, 2, 0)
    floor = FLOOR_SIGMA**2
    for i in range(6):
        out[i, i] += floor
    return out


FLOOR_SIGMA = 1e-7  # [m, rad] rounding of counts and times; keeps C positive definite where noise leaves a direction free


@dataclass(frozen=True, eq=False)
class Whitening:
    """Frozen weights of one linearisation: Cholesky factor of C, and the reflections that remove free joints."""

    factor: Array  # (6, 6, N) lower triangular
    reflections: NDArray[np.float64]  # (m, 6, N) unit Householder vectors, m = joints without encoder
    triangle: Array  # (m, m, N) what the free joints' columns become; upper triangular

    @property
    def equations(self) -> int:
        return 6 - len(self.reflections)

    def __call__(self, columns: Array) -> Array:
        """Whitened columns (..., 6, N) with the free directions removed: (..., 6 - m, N)."""
        return self._reflected(columns)[..., self.reflections.shape[0] :, :]

    def free_step(self, error: Array) -> Array:
        """(m, N) [rad] change of the joints without encoder that best absorbs a mismatch (6, N)."""
        m = self.reflections.shape[0]
        head = self._reflected(error)[:m]
        step = np.zeros_like(head)
        for i in range(m - 1, -1, -1):
            rest = head[i] - (self.triangle[i, i + 1 :] * step[i + 1 :]).sum(axis=0)
            step[i] = rest / self.triangle[i, i]
        return -step

    def _reflected(self, columns: Array) -> Array:
        out = solve_lower(self.factor, columns)
        for vector in self.reflections:
            out -= 2.0 * vector * (vector * out).sum(axis=-2, keepdims=True)
        return out


def whitening(covariances: Array, free_columns: Array) -> Whitening:
    """Weights from C (6, 6, N) and the columns (m, 6, N) of the ball-bar joints that carry no encoder."""
    factor = cholesky(covariances)
    columns = solve_lower(factor, free_columns)
    m, _, n = free_columns.shape
    vectors = np.zeros((m, 6, n))
    for k in range(m):
        head = columns[k, k:]
        norm = np.sqrt((head * head).sum(axis=0))
        vector = vectors[k, k:]
        vector[:] = head
        vector[0] += np.where(head[0] < 0.0, -norm, norm)
        vector /= np.maximum(np.sqrt((vector * vector).sum(axis=0)), np.finfo(float).tiny)
        columns[k:] -= 2.0 * vectors[k] * (vectors[k] * columns[k:]).sum(axis=1, keepdims=True)
    triangle = columns[:, :m].transpose(1, 0, 2).copy()
    for i in range(m):  # a joint that turns nothing (a singular pose) is left where it is
        size = np.abs(triangle[i, i])
        triangle[i, i, size < 1e-9 * max(float(np.median(size)), np.finfo(float).tiny)] = np.inf
    return Whitening(factor, vectors, triangle)


def cholesky(matrices: Array) -> Array:
    """Lower factors of (6, 6, N) positive definite matrices, all samples at once."""
    lower = np.zeros_like(matrices)
    for j in range(6):
        rest = matrices[j:, j] - (lower[j:, :j] * lower[j, :j]).sum(axis=1)
        lower[j:, j] = rest / np.sqrt(rest[0])
    return lower


def solve_lower(lower: Array, columns: Array) -> Array:
    """L^-1 times columns (..., 6, N), forward substitution over all samples at once."""
    out = np.empty_like(columns)
    for i in range(6):
        rest = columns[..., i, :].copy()
        for j in range(i):
            rest -= lower[i, j] * out[..., j, :]
        out[..., i, :] = rest / lower[i, i]
    return out


def complete_bar_angles(geometry: Geometry, q: Array, measured: Array, joints: tuple[int, ...]) -> Array:
    """(N, 5) ball-bar angles: measured where there is an encoder, from the robot's pose where there is none.

    measured : (N, E) [rad], columns for `joints` (1..5). The unmeasured ones are those of an ideal ball-bar that holds the
    tool where the nominal robot puts it, so they are starting values for `Whitening.free_step`.
    """
    columns = [j - 1 for j in joints]
    b = np.zeros((q.shape[0], BAR_ROWS))
    b[:, columns] = measured
    if len(joints) == BAR_ROWS:
        return b
    zeros = geometry.bar.theta
    poses = robot_frames(geometry, q).poses()
    ideal = bar_angles(poses, geometry.origin)
    total = b + zeros
    for pair in ((0, 1), (3, 4)):
        if not set(pair) <= set(columns):
            total[:, pair] = ideal[:, pair]
    if 2 not in columns:
        total[:, 2] = bar_roll(poses[:, :3, :3], total[:, 0], total[:, 1], total[:, 3], total[:, 4])
    free = [j for j in range(BAR_ROWS) if j not in columns]
    b[:, free] = total[:, free] - zeros[free]
    return b
