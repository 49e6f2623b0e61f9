"""Selection of poses by their information: greedy start, exchange, refinement of the angles.

Minimised is `trace(R' N^-1 R)`, the mean square TCP error: an A-optimal design weighted by the
workspace (Atkinson, Donev & Tobias 2007, ch. 10-12). A pose with rows A changes it by
`trace((I +- A C A')^-1 A C R R' C A')`, C = N^-1. The greedy start is D-optimal, `log det N`:
before seats and targets are determined no single pose lowers the TCP error. What a model leaves
unexplained is the same when a pose is repeated, so poses stay APART.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from ident.estimator.gauss_newton import inverse

APART = np.radians(10.0)  # [rad] of at least one axis, between any two poses
SWEEPS = 1  # of exchanges; further ones gain less than the refinement of the angles


@dataclass(frozen=True, eq=False)
class Design:
    """A problem of selection: K candidates."""

    axes: Array  # (K, J) [rad]
    rows: Array  # (K, E, P) whitened
    prior: Array  # (P, P)
    root: Array  # (P, P) [m]

    def normal(self, selected: NDArray[np.intp]) -> Array:
        """(P, P) information of selected poses and prior."""
        flat = self.rows[selected].reshape(-1, self.rows.shape[2])
        return self.prior + flat.T @ flat

    def objective(self, selected: NDArray[np.intp]) -> float:
        """[m^2] mean square TCP error after the selected poses."""
        return float(np.trace(self.root.T @ inverse(self.normal(selected)) @ self.root))

    def allowed(self, selected: NDArray[np.intp]) -> NDArray[np.bool_]:
        """(K,) candidates that are far enough from all selected ones."""
        out = np.ones(len(self.axes), dtype=bool)
        for k in selected:
            out &= np.abs(self.axes - self.axes[k]).max(axis=1) >= APART
        return out


def decrease(rows: Array, covariance: Array, root: Array, sign: float = 1.0) -> Array:
    """(K,) [m^2] decrease of the objective by each pose added; with sign -1, increase if removed.

    rows : (K, E, P). covariance : (P, P) without, or for a removal with, the pose. root : (P, P).
    """
    k, e, p = rows.shape
    half = (rows.reshape(-1, p) @ covariance).reshape(k, e, p)
    inner = np.eye(e) + sign * half @ rows.transpose(0, 2, 1)
    outer = (half.reshape(-1, p) @ root).reshape(k, e, -1)
    square = outer @ outer.transpose(0, 2, 1)
    return np.asarray(np.trace(np.linalg.solve(inner, square), axis1=1, axis2=2))


def greedy(design: Design, count: int) -> NDArray[np.intp]:
    """(count,) candidates, each the one that raises the determinant most."""
    selected = np.zeros(0, dtype=np.intp)
    allowed = np.ones(len(design.axes), dtype=bool)
    while selected.size < count and allowed.any():
        covariance = inverse(design.normal(selected))
        spread = design.rows @ covariance @ design.rows.transpose(0, 2, 1)
        gain = np.linalg.slogdet(np.eye(spread.shape[1]) + spread)[1]
        best = int(np.where(allowed, gain, -np.inf).argmax())
        selected = np.append(selected, best)
        allowed &= np.abs(design.axes - design.axes[best]).max(axis=1) >= APART
    return selected


def exchanged(
    design: Design, selected: NDArray[np.intp], going: Callable[[], bool] = lambda: True
) -> NDArray[np.intp]:
    """The selected poses, each in turn exchanged for the candidate that gains most.

    going : asked before every exchange whether to go on.
    """
    selected = selected.copy()
    for _ in range(SWEEPS):
        covariance = inverse(design.normal(selected))
        loss = decrease(design.rows[selected], covariance, design.root, -1.0)
        for place in np.argsort(loss):  # first what is missed least
            if not going():
                return selected
            selected[place] = _best(design, np.delete(selected, place))
    return selected


def _best(design: Design, others: NDArray[np.intp]) -> int:
    """The candidate that gains most beside the others."""
    gain = decrease(design.rows, inverse(design.normal(others)), design.root)
    return int(np.where(design.allowed(others), gain, -np.inf).argmax())
