"""Whitening of the loop-closure error: weights from its covariance, unmeasured joints eliminated.

The covariance of the error follows from the noise on both sides (errors in variables, Gauss-Helmert
model): `C = Jq Sq Jq' + Jb Sb Jb' + Jl Sl Jl' + floor`. With C = L L' the rows of L^-1 make the
error white. What the ball-bar joints without encoder can move is removed by the left null space of
their whitened columns, found by Householder reflections, so 0, 2, 4 or 5 encoders are one code path
with 1, 3, 5 or 6 equations a sample.

All factorisations run over the samples at once, component first (6, 6, N): numpy's batched routines
want the samples first, and the transposition alone costs more than these loops over six rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Parameter
from ballbar.cell.rotation import inverse_left_jacobian
from ballbar.ident.estimator.closure import Closure, runs_of_one_side
from ballbar.ident.estimator.target_closure import TargetClosure

# [m, rad] rounding of counts and times; keeps C positive definite where noise leaves a direction
# free
FLOOR_SIGMA = 1e-7
SINGULAR = 1e-9  # of the median: a joint whose column is shorter turns nothing at this pose


def covariance(columns: Array) -> Array:
    """(6, 6, N) covariance of the loop-closure error [m, rad].

    columns : (K, 6, N) [m, rad] change of the error for one standard deviation of each source.
    """
    out = np.einsum("kin,kjn->ijn", columns, columns)
    for i in range(6):
        out[i, i] += FLOOR_SIGMA**2
    return np.asarray(out)


@dataclass(frozen=True, eq=False)
class Whitening:
    """Weights of N samples: what takes a loop-closure error to independent unit noise.

    With m unmeasured joints the whitened error has E = 6 - m components.
    """

    matrix: Array  # (E, 6, N) left null space of the unmeasured joints' columns, whitened
    absorbing: Array  # (m, 6, N) the other rows: what the unmeasured joints can absorb
    triangle: Array  # (m, m, N) upper triangular: the unmeasured joints' columns in those rows
    singular: NDArray[np.bool_]  # (m, N) joints that turn nothing and are left where they are

    def __call__(self, columns: Array) -> Array:
        """Whitened columns (..., E, N) of columns (..., 6, N), unmeasured directions removed."""
        return _product(self.matrix, columns)

    def scaled(self, factor: Array) -> Whitening:
        """The weights with each sample's multiplied by a factor (N,)."""
        return replace(self, matrix=self.matrix * factor)

    def part(self, samples: slice) -> Whitening:
        """The weights of some of the samples."""
        return Whitening(
            self.matrix[..., samples],
            self.absorbing[..., samples],
            self.triangle[..., samples],
            self.singular[..., samples],
        )

    def jacobian(
        self,
        closure: Closure | TargetClosure,
        parameters: Sequence[Parameter],
        out: Array | None = None,
    ) -> Array:
        """(P, E, N) whitened `parameter_jacobian`, without forming that; out : to fill."""
        out = np.empty((len(parameters), *self.matrix.shape[::2])) if out is None else out
        of_robot, of_bar = self._of_robot_motion(closure), self._of_bar_motion(closure)
        for first, last, is_robot in runs_of_one_side(parameters):
            screws = np.empty((last - first, 6, out.shape[2]))
            for screw, parameter in zip(screws, parameters[first:last], strict=True):
                closure.screw(parameter, screw)
            matrix = of_robot if is_robot else of_bar
            np.einsum("ejn,pjn->pen", matrix, screws, out=out[first:last])
        return out

    def unmeasured_step(self, error: Array) -> Array:
        """(m, N) [rad] change of the unmeasured joints that best absorbs an error (6, N)."""
        rest = _product(self.absorbing, error)
        step = np.zeros_like(rest)
        for i in range(len(rest) - 1, -1, -1):
            head = rest[i] - (self.triangle[i, i + 1 :] * step[i + 1 :]).sum(axis=0)
            turning = ~self.singular[i]
            step[i, turning] = head[turning] / self.triangle[i, i, turning]
        return -step

    def _of_robot_motion(self, closure: Closure | TargetClosure) -> Array:
        """(E, 6, N) whitened change of the error per motion of the robot's tool frame."""
        return -self._turned(closure.error[3:])

    def _of_bar_motion(self, closure: Closure | TargetClosure) -> Array:
        """(E, 6, N) whitened change of the error per motion of the ball-bar's tool frame."""
        return self._turned(-closure.error[3:])

    def _turned(self, angle: Array) -> Array:
        """The matrix times `J_l(-angle)^-1`, which is `J_l(angle)^-1` applied to its rows."""
        turning = inverse_left_jacobian(angle, self.matrix[:, 3:])
        return np.concatenate((self.matrix[:, :3], turning), axis=1)


def whitening(covariances: Array, unmeasured: Array) -> Whitening:
    """Weights of N samples.

    covariances : (6, 6, N) of the error [m, rad]. unmeasured : (m, 6, N) its change per radian of
    each unmeasured joint [m, rad].
    """
    m = len(unmeasured)
    rows = inverse_lower(cholesky(covariances)).transpose(1, 0, 2).copy()
    columns = _product(rows, unmeasured)
    for k in range(m):  # Householder reflections
        head = columns[k, k:]
        norm = np.sqrt((head * head).sum(axis=0))
        vector = head.copy()
        vector[0] += np.where(head[0] < 0.0, -norm, norm)
        vector /= np.maximum(np.sqrt((vector * vector).sum(axis=0)), np.finfo(float).tiny)
        columns[k:, k:] -= 2.0 * vector * (vector * columns[k:, k:]).sum(axis=1, keepdims=True)
        rows[k:] -= 2.0 * vector[:, None] * (vector[:, None] * rows[k:]).sum(axis=0)
    triangle = columns[:, :m].transpose(1, 0, 2).copy()
    size = np.abs(triangle[np.arange(m), np.arange(m)])
    typical = np.maximum(np.median(size, axis=1, keepdims=True), np.finfo(float).tiny)
    return Whitening(rows[m:], rows[:m], triangle, size < SINGULAR * typical)


def cholesky(matrices: Array) -> Array:
    """(6, 6, N) lower factors of positive definite matrices (6, 6, N)."""
    lower = np.zeros_like(matrices)
    for j in range(6):
        rest = matrices[j:, j] - (lower[j:, :j] * lower[j, :j]).sum(axis=1)
        lower[j:, j] = rest / np.sqrt(rest[0])
    return lower


def inverse_lower(lower: Array) -> Array:
    """(6, 6, N) columns of the inverses of lower factors (6, 6, N), by forward substitution."""
    out = np.zeros_like(lower)
    for i in range(6):
        out[i, i] = 1.0
        for j in range(i):
            out[: j + 1, i] -= lower[i, j] * out[: j + 1, j]
        out[: i + 1, i] /= lower[i, i]
    return out


def _product(matrix: Array, columns: Array) -> Array:
    """(..., E, N) matrix (E, 6, N) times columns (..., 6, N), sample by sample."""
    return np.asarray(np.einsum("ejn,...jn->...en", matrix, columns))
