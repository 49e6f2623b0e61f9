"""A fit linearised at its estimate, for tests of what else may be in its residual.

Knots of a tension reach over a second each: their columns are splines times one slope, and are
formed only where somebody asks for all columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ballbar.cell.arrays import Array


@dataclass(frozen=True, eq=False)
class SplineColumns:
    """Unknowns whose columns are splines times one slope: the knots of a tension."""

    index: NDArray[np.intp]  # (K,) into the unknowns
    splines: csr_array  # (K, N)
    slope: Array  # (E, N)


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A fit linearised at its estimate, whitened: N samples with E equations each."""

    jacobian: Array  # (D, E, N) of the residual, by all P unknowns but the knots
    residual: Array  # (E, N)
    joints: Array  # (J, E, N) of the residual, per radian of each joint's gear
    angles: Array  # (J, N) [rad] of the gears; of most robots these are the joints
    prior_gradient: Array  # (P,) of half the prior's cost
    prior_normal: Array  # (P, P)
    regions: NDArray[np.intp]  # (N,) folds of the cross-validation
    # (N,) number from 0 of the group that counts once, because errors within it are equal: several
    # targets at one pose, a block of time of a log
    groups: NDArray[np.intp]
    few: bool = False  # whether groups are some tens only, for which the test must allow
    knots: SplineColumns | None = None

    @property
    def dense(self) -> NDArray[np.intp]:
        """(D,) indices of the unknowns that are no knots."""
        every = np.arange(len(self.prior_gradient))
        return every if self.knots is None else np.delete(every, self.knots.index)

    @cached_property
    def columns(self) -> Array:
        """(P, E, N) of all unknowns."""
        return self.combined(np.eye(len(self.prior_gradient)))

    def products(self, columns: Array) -> Array:
        """(P, C) of the columns of the unknowns with others (C, E, N)."""
        out = np.empty((len(self.prior_gradient), len(columns)))
        flat = columns.reshape(len(columns), -1)
        out[self.dense] = self.jacobian.reshape(len(self.jacobian), -1) @ flat.T
        if (knots := self.knots) is not None:
            out[knots.index] = knots.splines @ (columns * knots.slope).sum(axis=1).T
        return out

    def combined(self, steps: Array) -> Array:
        """(C, E, N) sums of the columns of the unknowns times steps (C, P)."""
        out = np.tensordot(steps[:, self.dense], self.jacobian, axes=1)
        if (knots := self.knots) is not None:
            out += (knots.splines.T @ steps[:, knots.index].T).T[:, None] * knots.slope
        return np.asarray(out)

    def gram(self) -> Array:
        """(P, P) products of the columns of the unknowns."""
        out = np.empty((len(self.prior_gradient),) * 2)
        out[:, self.dense] = self.products(self.jacobian)
        if (knots := self.knots) is not None:
            out[:, knots.index] = out[knots.index].T
            weighted = knots.splines * (knots.slope**2).sum(axis=0)
            out[np.ix_(knots.index, knots.index)] = (weighted @ knots.splines.T).toarray()
        return out
