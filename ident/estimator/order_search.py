"""Search by evidence for joint errors of whole orders that no data sheet lists.

Candidates are the cosine and sine of `n q_j` for every joint j and order n. In each step the
candidates are ranked by a score test whose variance is that of the poses' own scores (sandwich
form: White 1982; a pose's equations, and what is alike within it, count once). Of the best ones
that is taken which lowers the blocked cross-validated residual most; the search ends when none
lowers it by `GAIN`. Both work on the linearised model, so that everything follows from Gram
matrices that are formed once. Method and settings: docs/real_robots, orders.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.linalg.blas import dgemm

from cell.arrays import Array

ORDERS = 40  # highest order of the candidates
# Of the score test, above twice the logarithm of the number of candidates: no order in 120 tables
# of white noise at 60 to 600 poses; 6 finds one in them, 12 ends searches on lengths too early
# (docs/real_robots).
THRESHOLD = 8.0
TRIED = 24  # candidates cross-validated in each step; with 4 some searches end too early
GAIN = 0.005  # of the cross-validated sum of squares; less is no evidence
LARGEST = 60  # pairs; real robots needed 40


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A fit linearised at its estimate, whitened: N poses with E equations each."""

    jacobian: Array  # (P, E, N) of the residual
    residual: Array  # (E, N)
    joints: Array  # (J, E, N) of the residual, per radian of each joint
    angles: Array  # (J, N) [rad] of the joints
    prior_gradient: Array  # (P,) of half the prior's cost
    prior_normal: Array  # (P, P)
    regions: NDArray[np.intp]  # (N,) folds of the cross-validation
    # (N,) number of the pose from 0: the errors of several targets at one pose are alike
    poses: NDArray[np.intp]


@dataclass(frozen=True)
class JointOrder:
    """One joint error that the data ask for."""

    joint: int  # from 0
    order: int
    score: float  # of the test, chi-square with two degrees of freedom where there is none
    gain: float  # share of the cross-validated sum of squares that it took away
    aliases: tuple[int, ...]  # other orders that these angles hardly tell from it


@dataclass(frozen=True, eq=False)
class OrderSearch:
    """The outcome of a search."""

    orders: tuple[JointOrder, ...]
    spectrum_before: Array  # (J, ORDERS) score of every candidate before the search
    spectrum_after: Array  # (J, ORDERS) and after it

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Joint, from 0, and order of each."""
        return [(o.joint, o.order) for o in self.orders]


def search_orders(model: LinearModel, prior: float, *, highest: int = ORDERS) -> OrderSearch:
    """Joint errors that the data ask for, the strongest first.

    prior : [rad] standard deviation of each amplitude.
    """
    candidates = _candidates(model, highest)
    grams = _Grams(model, candidates, prior)
    scores = _Scores(model, candidates, prior)
    limit = 2.0 * np.log(len(candidates)) + THRESHOLD
    taken: list[int] = []
    orders: list[JointOrder] = []
    first = scores.tests()
    level, tests = grams.plain(), first
    while len(taken) < LARGEST:
        ranked = [c for c in np.argsort(-tests)[:TRIED] if tests[c] > limit and c not in taken]
        if not ranked:
            break
        levels = grams.cross_validated(taken, ranked)
        best = int(np.argmin(levels))
        gain = 1.0 - float(levels[best]) / level
        if gain < GAIN:
            break
        chosen, level = int(ranked[best]), float(levels[best])
        taken.append(chosen)
        joint, order = divmod(chosen, highest)
        orders.append(
            JointOrder(
                joint, order + 1, float(tests[chosen]), float(gain), scores.aliases(chosen, highest)
            )
        )
        scores.take(chosen)
        tests = scores.tests()
    shape = (len(model.joints), highest)
    return OrderSearch(tuple(orders), first.reshape(shape), tests.reshape(shape))


def _candidates(model: LinearModel, highest: int) -> Array:
    """(C, 2, N E) columns of every pair of joint and order, joint after joint."""
    n = np.arange(1, highest + 1)
    out = np.empty((len(model.joints), highest, 2, *model.residual.shape))
    for j, (column, angle) in enumerate(zip(model.joints, model.angles, strict=True)):
        waves = np.stack((np.cos(n[:, None] * angle), np.sin(n[:, None] * angle)), axis=1)
        np.multiply(column, waves[:, :, None], out=out[j])
    return out.reshape(len(model.joints) * highest, 2, -1)


ALIAS = 0.98  # correlation of two candidates' columns from which data hardly tell them apart


class _Scores:
    """Score tests of all candidates against the model as it grows."""

    def __init__(self, model: LinearModel, candidates: Array, prior: float) -> None:
        self._raw, self._shape, self._prior = candidates, model.residual.shape, prior
        present = model.jacobian.reshape(len(model.jacobian), -1)
        normal = cho_factor(present @ present.T + model.prior_normal)
        flat = candidates.reshape(-1, present.shape[1])
        rest = flat - cho_solve(normal, present @ flat.T).T @ present
        self._rest: Array = rest.reshape(candidates.shape)  # what the model cannot take over
        self._residual = model.residual.reshape(-1)
        self._order = np.argsort(model.poses, kind="stable")
        self._starts = np.flatnonzero(np.diff(model.poses[self._order], prepend=-1))

    def tests(self) -> Array:
        """(C,) of each candidate: s' V^-1 s, V from the scores of single poses."""
        equations, poses = self._shape
        rest = self._rest.reshape(len(self._rest), 2, equations, poses)
        each = np.einsum("cien,en->cin", rest, self._residual.reshape(equations, poses))
        if len(self._starts) < poses:
            each = np.add.reduceat(each[:, :, self._order], self._starts, axis=2)
        score = each.sum(axis=2)
        variance = np.einsum("cin,cjn->cij", each, each)
        variance += 1e-12 * np.trace(variance, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        variance += np.finfo(float).tiny * np.eye(2)
        return np.asarray(
            np.einsum("ci,ci->c", score, np.linalg.solve(variance, score[..., None])[..., 0])
        )

    def take(self, chosen: int) -> None:
        """The chosen candidate becomes part of the model."""
        raw, own = self._raw[chosen], self._rest[chosen].copy()
        schur = raw @ own.T + np.eye(2) / self._prior**2
        self._residual = self._residual - np.linalg.solve(schur, raw @ self._residual) @ own
        flat = self._rest.reshape(-1, raw.shape[1])
        dgemm(-1.0, own.T, np.linalg.solve(schur, raw @ flat.T), 1.0, flat.T, overwrite_c=1)

    def aliases(self, chosen: int, highest: int) -> tuple[int, ...]:
        """Orders of the same joint whose columns are nearly combinations of the chosen ones."""
        joint, order = divmod(chosen, highest)
        own = np.linalg.qr(self._rest[chosen].T)[0]  # (R, 2)
        others = self._rest[joint * highest : (joint + 1) * highest]
        within = ((others @ own) ** 2).sum(axis=(1, 2))
        whole = np.maximum((others**2).sum(axis=(1, 2)), np.finfo(float).tiny)
        alike = np.flatnonzero(within / whole > ALIAS**2)
        return tuple(int(k) + 1 for k in alike if k != order)


class _Grams:
    """Gram matrices of model and candidates in every fold, for cross-validation."""

    def __init__(self, model: LinearModel, candidates: Array, prior: float) -> None:
        present = model.jacobian.reshape(len(model.jacobian), -1)
        self._present = len(present)
        columns = np.concatenate((present, candidates.reshape(-1, present.shape[1])))
        fold_of = np.tile(model.regions, model.residual.shape[0])
        residual = model.residual.reshape(-1)
        self._folds: list[tuple[Array, Array, float]] = []
        for fold in range(model.regions.max() + 1):
            own = np.ascontiguousarray(columns[:, fold_of == fold])
            rest = residual[fold_of == fold]
            self._folds.append((own @ own.T, own @ rest, float(rest @ rest)))
        self._gram: Array = np.sum([gram for gram, _, _ in self._folds], axis=0)
        self._gradient: Array = np.sum([gradient for _, gradient, _ in self._folds], axis=0)
        count = self._present
        self._gram[:count, :count] += model.prior_normal
        self._gradient[:count] += model.prior_gradient
        self._gram[np.arange(count, len(columns)), np.arange(count, len(columns))] += prior**-2.0

    def plain(self) -> float:
        """Sum of squares left in the folds left out, without any candidate."""
        total, base = 0.0, np.arange(self._present)
        for gram, gradient, square in self._folds:
            left, slope = self._gram - gram, self._gradient - gradient
            step = -np.linalg.solve(left[np.ix_(base, base)], slope[base])
            held = gram[np.ix_(base, base)]
            total += square + float(2.0 * step @ gradient[base] + step @ held @ step)
        return total

    def cross_validated(self, taken: list[int], tried: list[int]) -> Array:
        """(T,) sum of squares left in the folds left out, with each of the T candidates tried."""
        base = np.r_[np.arange(self._present), self._columns(taken)]
        pairs, t = self._columns(tried), len(tried)
        own = pairs.reshape(t, 2)
        total = np.zeros(t)
        for gram, gradient, square in self._folds:
            left, slope = self._gram - gram, self._gradient - gradient
            factor = np.linalg.cholesky(left[np.ix_(base, base)])
            right = np.column_stack((slope[base], left[np.ix_(base, pairs)]))
            half = solve_triangular(factor, right, lower=True, check_finite=False)
            whole = solve_triangular(factor.T, half, lower=False, check_finite=False)
            side = half[:, 1:].reshape(-1, t, 2)
            schur = left[own[:, :, None], own[:, None, :]] - np.einsum("pti,ptj->tij", side, side)
            rest = slope[own] - np.einsum("pti,p->ti", side, half[:, 0])
            added = -np.linalg.solve(schur, rest[..., None])[..., 0]  # (T, 2)
            moved = np.einsum("pti,ti->pt", whole[:, 1:].reshape(-1, t, 2), added)
            steps = -whole[:, :1] - moved  # (P, T)
            held = gram[np.ix_(base, base)] @ steps
            across = np.einsum("pti,ti->pt", gram[np.ix_(base, pairs)].reshape(-1, t, 2), added)
            total += square + 2.0 * (gradient[base] @ steps + (gradient[own] * added).sum(axis=1))
            total += (steps * (held + 2.0 * across)).sum(axis=0)
            total += np.einsum("ti,tij,tj->t", added, gram[own[:, :, None], own[:, None]], added)
        return total

    def _columns(self, candidates: list[int]) -> NDArray[np.intp]:
        each = np.asarray(candidates, dtype=np.intp)
        return (self._present + 2 * each[:, None] + np.arange(2)).reshape(-1)
