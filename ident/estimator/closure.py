"""Loop closure: the signed mismatch between the two ways to the tool, and its derivatives.

At every sample the tool frame is reached through the robot, R(q), and through the ball-bar, B(b). The residual is what
the ball-bar says minus what the robot says, `e = [p_B - p_R, log(R_B R_R^T)]`, six signed numbers in base coordinates.
Signed components keep the Jacobian alive at the solution; the thesis's scalar costs (eqs. 2.2-2.4), squared once more by
least squares, make it vanish there.

Ball-bar joints without encoder are free: what they can move is removed by the left null space of their columns (in the
whitened metric), so 0, 2, 4 or 5 encoders are one code path with 1, 3, 5 or 6 equations a sample.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from cell.chain import Array, Frames, joint_screws, screw
from cell.geometry import (
    BAR_ROWS,
    ROBOT_ROWS,
    Geometry,
    Parameter,
    bar_frames,
    parameter_screw,
    robot_frames,
)
from cell.inverse import bar_angles, bar_roll
from cell.rotation import inverse_left_jacobian, rotvec_from_matrix


@dataclass(frozen=True, eq=False)
class Closure:
    """The mismatch of N samples and everything its derivatives need."""

    geometry: Geometry
    robot: Frames
    bar: Frames
    error: Array  # (6, N) [m, m, m, rad, rad, rad]

    def part(self, samples: slice) -> Closure:
        """Some of the samples."""
        return Closure(
            self.geometry, self.robot.part(samples), self.bar.part(samples), self.error[:, samples]
        )


def close_loop(geometry: Geometry, q: Array, b: Array) -> Closure:
    """Mismatch at robot angles q (N, 6) and ball-bar angles b (N, 5) [rad], before the zeros in btheta are added."""
    robot, bar = robot_frames(geometry, q), bar_frames(geometry, b)
    turned = np.einsum("ikn,jkn->ijn", bar.rotation(), robot.rotation())
    return Closure(
        geometry, robot, bar, np.concatenate((bar.tip - robot.tip, rotvec_from_matrix(turned)))
    )


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
        parameter_screw(closure.geometry, closure.robot, closure.bar, parameter, out[k])
    for first, last, of_robot in _sides(parameters):
        (_of_robot if of_robot else _of_bar)(closure, out[first:last])
    return out


def _sides(parameters: Sequence[Parameter]) -> Iterator[tuple[int, int, bool]]:
    """Stretches of one side: first, one past last, and whether it is the robot."""
    first = 0
    for of_robot, some in groupby(parameters, key=lambda p: p.side == "robot"):
        last = first + sum(1 for _ in some)
        yield first, last, of_robot
        first = last


def robot_joint_jacobian(closure: Closure) -> Array:
    """(6, 6, N) derivative of the mismatch with respect to each robot joint angle."""
    return _of_robot(closure, joint_screws(closure.robot))


def bar_joint_jacobian(closure: Closure) -> Array:
    """(5, 6, N) derivative of the mismatch with respect to each ball-bar joint angle."""
    return _of_bar(closure, joint_screws(closure.bar))


def rod_jacobian(closure: Closure) -> Array:
    """(6, N) derivative of the mismatch with respect to the rod length."""
    return _of_bar(closure, screw(closure.bar, "d", 2))


def covariance(
    closure: Closure, joint_sigma: Array, encoder_sigma: Array, rod_sigma: float
) -> Array:
    """(6, 6, N) covariance of the mismatch that noise on the angles and a yielding rod induce (Gauss-Helmert).

    joint_sigma : (6,) [rad]; encoder_sigma : (5,) [rad], 0 where no encoder is fitted; rod_sigma : [m].
    `C = Jq Sq Jq' + Jb Sb Jb' + Jl Sl Jl' + floor`; errors in variables, so both logs count as measured.
    """
    columns = np.empty((ROBOT_ROWS + BAR_ROWS + 1, *closure.error.shape))
    np.multiply(robot_joint_jacobian(closure), joint_sigma[:, None, None], out=columns[:ROBOT_ROWS])
    np.multiply(
        bar_joint_jacobian(closure), encoder_sigma[:, None, None], out=columns[ROBOT_ROWS:-1]
    )
    np.multiply(rod_jacobian(closure), rod_sigma, out=columns[-1])
    out = np.einsum("kin,kjn->ijn", columns, columns)
    floor = FLOOR_SIGMA**2
    for i in range(6):
        out[i, i] += floor
    return np.asarray(out)


FLOOR_SIGMA = 1e-7  # [m, rad] rounding of counts and times; keeps C positive definite where noise leaves a direction free


@dataclass(frozen=True, eq=False)
class Whitening:
    """Frozen weights of one linearisation: what takes a mismatch to independent unit noise, free joints eliminated."""

    matrix: Array  # (6 - m, 6, N), m = joints without encoder: the left null space of their columns, in the whitened metric
    absorbing: Array  # (m, 6, N) the other rows: what the free joints can absorb
    triangle: Array  # (m, m, N) what the free joints' columns become in them; upper triangular

    def __call__(self, columns: Array) -> Array:
        """Whitened columns (..., 6, N) with the free directions removed: (..., 6 - m, N)."""
        return _applied(self.matrix, columns)

    def part(self, samples: slice) -> Whitening:
        """Some of the samples."""
        return Whitening(
            self.matrix[..., samples], self.absorbing[..., samples], self.triangle[..., samples]
        )

    def jacobian(
        self, closure: Closure, parameters: Sequence[Parameter], out: Array | None = None
    ) -> Array:
        """(P, 6 - m, N): what whitening makes of `parameter_jacobian`, without forming that; out : to write to."""
        out = np.empty((len(parameters), *self.matrix.shape[::2])) if out is None else out
        of_motion = self.of_robot(closure), self.of_bar(closure)
        for first, last, of_robot in _sides(parameters):
            screws = np.empty((last - first, 6, out.shape[2]))
            for k in range(first, last):
                parameter_screw(
                    closure.geometry, closure.robot, closure.bar, parameters[k], screws[k - first]
                )
            np.einsum("ejn,pjn->pen", of_motion[0 if of_robot else 1], screws, out=out[first:last])
        return out

    def of_robot(self, closure: Closure) -> Array:
        """(6 - m, 6, N) what takes a motion of the robot's tool frame to whitened change of the mismatch."""
        return -self._turned(closure.error[3:])

    def of_bar(self, closure: Closure) -> Array:
        """(6 - m, 6, N) the same of the ball-bar's."""
        return self._turned(-closure.error[3:])

    def _turned(self, angle: Array) -> Array:
        """The matrix times `J_l(-angle)^-1` on its right, which is `J_l(angle)^-1` on its rows."""
        return np.concatenate(
            (self.matrix[:, :3], inverse_left_jacobian(angle, self.matrix[:, 3:])), axis=1
        )

    def free_step(self, error: Array) -> Array:
        """(m, N) [rad] change of the joints without encoder that best absorbs a mismatch (6, N)."""
        head = _applied(self.absorbing, error)
        step = np.zeros_like(head)
        for i in range(len(head) - 1, -1, -1):
            rest = head[i] - (self.triangle[i, i + 1 :] * step[i + 1 :]).sum(axis=0)
            step[i] = rest / self.triangle[i, i]
        return -step


def whitening(covariances: Array, free_columns: Array) -> Whitening:
    """Weights from C (6, 6, N) and the columns (m, 6, N) of the ball-bar joints that carry no encoder."""
    m, _, n = free_columns.shape
    identity = np.broadcast_to(np.eye(6)[:, :, None], (6, 6, n))
    rows = solve_lower(cholesky(covariances), identity).transpose(1, 0, 2).copy()
    columns = _applied(rows, free_columns)
    for k in range(m):  # Householder reflections
        head = columns[k, k:]
        norm = np.sqrt((head * head).sum(axis=0))
        vector = head.copy()
        vector[0] += np.where(head[0] < 0.0, -norm, norm)
        vector /= np.maximum(np.sqrt((vector * vector).sum(axis=0)), np.finfo(float).tiny)
        columns[k:, k:] -= 2.0 * vector * (vector * columns[k:, k:]).sum(axis=1, keepdims=True)
        rows[k:] -= 2.0 * vector[:, None] * (vector[:, None] * rows[k:]).sum(axis=0)
    triangle = columns[:, :m].transpose(1, 0, 2).copy()
    for i in range(m):  # a joint that turns nothing (a singular pose) is left where it is
        size = np.abs(triangle[i, i])
        triangle[i, i, size < 1e-9 * max(float(np.median(size)), np.finfo(float).tiny)] = np.inf
    return Whitening(rows[m:], rows[:m], triangle)


def _applied(matrix: Array, columns: Array) -> Array:
    """Matrix (E, 6, N) times columns (..., 6, N), sample by sample: (..., E, N)."""
    return np.asarray(np.einsum("ejn,...jn->...en", matrix, columns))


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


def complete_bar_angles(
    geometry: Geometry, q: Array, measured: Array, joints: tuple[int, ...]
) -> Array:
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
