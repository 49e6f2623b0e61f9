"""Search by evidence for periodic joint errors that no data sheet lists.

Candidates are the cosine and sine of `n q_j` for joints j and orders n: cycles a turn, by default
the whole ones. The slope of a joint's own angle may stand beside them as order 0: over a part of a
turn a wrong ratio and few cycles a turn look the same, so they compete. In each step the
candidates are ranked by a score test whose variance is that of the poses' own scores (sandwich
form: White 1982; a pose's equations, and what is equal within it, count once). Neighbouring samples
of a log are autocorrelated: there the scores of a block of time count once (Liang & Zeger 1986). Of
the best candidates that is taken which lowers the blocked cross-validated residual most; the search
ends when none lowers it by `GAIN`. Both work on the linearised model, so that everything follows
from Gram matrices that are formed once. Method and settings: docs/real_robots, orders.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.linalg.blas import dgemm

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.linear_model import LinearModel

ORDERS = 40  # highest order of the candidates
# Of the score test, above twice the logarithm of the number of candidates: no order in 140 tables
# of white noise at 60 to 600 poses; 8 finds one in them, 12 ends searches on lengths too early
# (docs/real_robots).
THRESHOLD = 9.0
TRIED = 24  # candidates cross-validated in each step; with 4 some searches end too early
GAIN = 0.005  # of the cross-validated sum of squares; less is no evidence
LARGEST = 60  # pairs; real robots needed 40
SLOPE = 0  # order of a wrong ratio
# [rad] at a prior of the amplitudes: a slope of 1e-3 (ballbar.ident.corrections.gear_ratio) is as
# likely as an amplitude of 3e-4 rad
_SLOPES = 1e-3 / 3e-4
HIGHEST = 150.0  # order of the peaks that are looked for: a reducer's teeth
_PEAKS = 3  # of each joint
_BESIDE = 0.15  # [cycles a turn] closer to a candidate it is that one


@dataclass(frozen=True)
class JointOrder:
    """One joint error that the data ask for."""

    joint: int  # from 0
    order: float  # cycles a turn
    score: float  # of the test, chi-square with two degrees of freedom where there is none
    gain: float  # share of the cross-validated sum of squares that it took away
    aliases: tuple[float, ...]  # other orders that these angles hardly tell from it


@dataclass(frozen=True, eq=False)
class OrderSearch:
    """The outcome of a search."""

    orders: tuple[JointOrder, ...]
    spectrum_before: Array  # (J, ORDERS) score of every whole order before the search
    spectrum_after: Array  # (J, ORDERS) and after it

    @property
    def pairs(self) -> list[tuple[int, float]]:
        """Joint, from 0, and order of each."""
        return [(o.joint, o.order) for o in self.orders]


def whole_orders(joints: int) -> list[tuple[int, float]]:
    """Every pair of joint, from 0, and whole order up to ORDERS."""
    return [(joint, order) for joint in range(joints) for order in range(1, ORDERS + 1)]


def peak_orders(model: LinearModel, others: Sequence[tuple[int, float]]) -> list[tuple[int, float]]:
    """Pairs of joint, from 0, and order at which the residual has peaks apart from `others`.

    By the score over the joint's own column alone, as if no unknown of the model could stand for a
    part of it; steps are half of what the joint's range tells apart, and a quarter of that is no
    distance.
    """
    out = []
    for joint, (columns, angle) in enumerate(zip(model.joints, model.angles, strict=True)):
        score, weight = (columns * model.residual).sum(axis=0), (columns**2).sum(axis=0)
        step = np.pi / (2.0 * max(np.ptp(angle), 1.0))
        orders, once = np.arange(step, HIGHEST, step), np.exp(1j * step * angle)
        turn = np.cumprod(np.broadcast_to(once, (orders.size, once.size)), axis=0)
        power = np.abs(turn @ score) ** 2 / weight.sum()
        top = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
        for k in top[np.argsort(-power[top])[:_PEAKS]]:
            # the vertex of the parabola through the peak and its neighbours
            low, high, middle = power[k - 1], power[k + 1], power[k]
            vertex = 0.5 * (low - high) / (low - 2.0 * middle + high)
            order = round(float(orders[k] + vertex * step), 2)
            if all(j != joint or abs(order - o) > max(_BESIDE, 0.5 * step) for j, o in others):
                out.append((joint, order))
    return out


def search_orders(
    model: LinearModel,
    prior: float,
    pairs: Sequence[tuple[int, float]] | None = None,
    *,
    threshold: float = THRESHOLD,
) -> OrderSearch:
    """Joint errors that the data ask for, the strongest first.

    prior : [rad] standard deviation of each amplitude. pairs : joint, from 0, and order of every
    candidate; by default `whole_orders`. threshold : as `THRESHOLD`.
    """
    pairs = whole_orders(len(model.joints)) if pairs is None else pairs
    candidates = wave_columns(model, pairs)
    scores = _Scores(model, candidates, prior)
    limit = 2.0 * np.log(len(candidates)) + threshold
    taken: list[int] = []
    orders: list[JointOrder] = []
    tests = first = scores.tests()
    while len(taken) < LARGEST:
        ranked = [c for c in np.argsort(-tests)[:TRIED] if tests[c] > limit and c not in taken]
        if not ranked:
            break
        grams = _Grams(model, candidates[[*taken, *ranked]], prior)
        level, levels = grams.cross_validated(len(taken))
        best = int(np.argmin(levels))
        gain = 1.0 - float(levels[best]) / level
        if gain < GAIN:
            break
        chosen = int(ranked[best])
        taken.append(chosen)
        joint, order = pairs[chosen]
        same = [
            k
            for k, pair in enumerate(pairs)
            if pair[0] == joint and k != chosen and SLOPE not in (order, pair[1])
        ]
        aliases = tuple(pairs[k][1] for k in scores.aliases_of(chosen, same))
        orders.append(JointOrder(joint, order, float(tests[chosen]), float(gain), aliases))
        scores.take(chosen)
        tests = scores.tests()
    joints = len(model.joints)
    return OrderSearch(
        tuple(orders), _spectrum(pairs, first, joints), _spectrum(pairs, tests, joints)
    )


def _spectrum(pairs: Sequence[tuple[int, float]], tests: Array, joints: int) -> Array:
    """(J, ORDERS) scores of the whole orders, 0 where one is no candidate."""
    out = np.zeros((joints, ORDERS))
    for (joint, order), test in zip(pairs, tests, strict=True):
        if 0 < order <= ORDERS and order == round(order):
            out[joint, round(order) - 1] = test
    return out


def wave_columns(model: LinearModel, pairs: Sequence[tuple[int, float]]) -> Array:
    """(C, 2, E, N) columns of every pair of joint and order."""
    out = np.empty((len(pairs), 2, *model.residual.shape))
    for (joint, order), columns in zip(pairs, out, strict=True):
        angle = order * model.angles[joint]
        waves = np.stack((np.cos(angle), np.sin(angle)))
        if order == SLOPE:
            waves[0] = _SLOPES * (model.angles[joint] - model.angles[joint].mean())
        np.multiply(model.joints[joint], waves[:, None], out=columns)
    return out


ALIAS = 0.98  # correlation of two candidates' columns from which data hardly tell them apart


class _Scores:
    """Score tests of all candidates against the model as it grows."""

    def __init__(self, model: LinearModel, candidates: Array, prior: float) -> None:
        count, shape = len(candidates), model.residual.shape
        self._raw, self._shape, self._prior = candidates.reshape(count, 2, -1), shape, prior
        factor = cho_factor(model.gram() + model.prior_normal)
        mixed = model.products(candidates.reshape(2 * count, *shape))
        taken = model.combined(cho_solve(factor, mixed).T).reshape(self._raw.shape)
        self._rest: Array = self._raw - taken  # what the model cannot take over
        self._residual = model.residual.reshape(-1)
        self._order = np.argsort(model.groups, kind="stable")
        self._starts = np.flatnonzero(np.diff(model.groups[self._order], prepend=-1))
        self._few = model.few

    def tests(self) -> Array:
        """(C,) of each candidate: s' V^-1 s, V from the scores of the groups."""
        rest = self._rest.reshape(len(self._rest), 2, *self._shape)
        each = self._of_groups(np.einsum("cien,en->cin", rest, self._residual.reshape(self._shape)))
        score = each.sum(axis=2)
        if self._few:
            information = self._of_groups(np.einsum("cien,cjen->cijn", rest, rest, optimize=True))
            each = left_out(each, information, self._prior)
        variance = np.einsum("cin,cjn->cij", each, each)
        variance += 1e-12 * np.trace(variance, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        variance += np.finfo(float).tiny * np.eye(2)
        tests = np.einsum("ci,ci->c", score, np.linalg.solve(variance, score[..., None])[..., 0])
        return of_few(tests, self._starts.size) if self._few else np.asarray(tests)

    def _of_groups(self, each: Array) -> Array:
        """Sums (..., G) of (..., N) over the groups."""
        if len(self._starts) == each.shape[-1]:
            return each
        return np.asarray(np.add.reduceat(each[..., self._order], self._starts, axis=-1))

    def take(self, chosen: int) -> None:
        """The chosen candidate becomes part of the model."""
        raw, own = self._raw[chosen], self._rest[chosen].copy()
        schur = raw @ own.T + np.eye(2) / self._prior**2
        self._residual = self._residual - np.linalg.solve(schur, raw @ self._residual) @ own
        flat = self._rest.reshape(-1, raw.shape[1])
        dgemm(-1.0, own.T, np.linalg.solve(schur, raw @ flat.T), 1.0, flat.T, overwrite_c=1)

    def aliases_of(self, chosen: int, others: Sequence[int]) -> list[int]:
        """Other candidates whose columns are nearly combinations of the chosen ones."""
        own = np.linalg.qr(self._rest[chosen].T)[0]  # (R, 2)
        rest = self._rest[others]
        within = ((rest @ own) ** 2).sum(axis=(1, 2))
        whole = np.maximum((rest**2).sum(axis=(1, 2)), np.finfo(float).tiny)
        return [others[int(k)] for k in np.flatnonzero(within / whole > ALIAS**2)]


def left_out(scores: Array, information: Array, prior: float) -> Array:
    """(C, K, G) scores of the groups at the amplitudes that all other groups together give.

    Where groups are few, an error that is there would fill the variance of the test by itself, the
    more so the less similar they are. So the variance is that of the errors of prediction (CR3:
    Bell & McCaffrey 2002).

    scores : (C, K, G) of K columns a candidate. information : (C, K, K, G). prior : [rad] of the
    amplitudes.
    """
    identity = np.eye(scores.shape[1])
    whole = information.sum(axis=-1) + identity / prior**2  # (C, K, K)
    amplitude = np.linalg.solve(whole, scores.sum(axis=-1)[..., None])[..., 0]
    each = np.moveaxis(information, -1, 1)  # (C, G, K, K)
    left = scores.swapaxes(1, 2) - np.einsum("cgij,cj->cgi", each, amplitude)
    share = np.einsum("cgij,cjk->cgik", each, np.linalg.inv(whole))
    return np.asarray(np.linalg.solve(identity - share, left[..., None])[..., 0].swapaxes(1, 2))


def of_few(tests: Array, groups: int) -> Array:
    """Statistics `s' V^-1 s` of G groups as chi-squares of two degrees of freedom, equally likely.

    Of independent normal scores of similar groups, and V of the scores less their mean,
    `1 + s' V^-1 s / G` exceeds a value x with probability `x^(-(G - 2) / 2)` (Hotelling 1931).
    `left_out` makes V larger than that by the square of `G / (G - 1)`.
    """
    if groups < 3:
        return np.zeros_like(tests)
    return np.asarray((groups - 2) * np.log1p(tests * groups / (groups - 1) ** 2))


class _Grams:
    """Gram matrices of model and some candidates in every fold, for cross-validation."""

    def __init__(self, model: LinearModel, candidates: Array, prior: float) -> None:
        """candidates : (T, 2, E, N) columns."""
        present, residual = model.columns, model.residual.reshape(-1)
        self._present = count = len(present)
        columns = np.concatenate((present, candidates.reshape(-1, *present.shape[1:])))
        flat = columns.reshape(len(columns), -1)
        fold_of = np.tile(model.regions, len(model.residual))
        self._folds: list[tuple[Array, Array, float]] = []
        for fold in range(model.regions.max() + 1):
            own = np.ascontiguousarray(flat[:, fold_of == fold])
            rest = residual[fold_of == fold]
            self._folds.append((own @ own.T, own @ rest, float(rest @ rest)))
        self.whole: Array = np.sum([gram for gram, _, _ in self._folds], axis=0)
        self._gradient: Array = np.sum([gradient for _, gradient, _ in self._folds], axis=0)
        self.whole[:count, :count] += model.prior_normal
        self._gradient[:count] += model.prior_gradient
        self.whole[np.arange(count, len(columns)), np.arange(count, len(columns))] += prior**-2.0

    def cross_validated(self, taken: int) -> tuple[float, Array]:
        """Sum of squares left in the folds left out, and (T,) with each of the last T candidates.

        taken : how many of the first ones are part of the model.
        """
        base, pairs = np.split(np.arange(len(self.whole)), [self._present + 2 * taken])
        t = pairs.size // 2
        own = pairs.reshape(t, 2)
        level, total = 0.0, np.zeros(t)
        for gram, gradient, square in self._folds:
            left, slope = self.whole - gram, self._gradient - gradient
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
            own_gram, alone = gram[np.ix_(base, base)], -whole[:, 0]
            level += square + float((2.0 * gradient[base] + own_gram @ alone) @ alone)
            held = own_gram @ steps
            across = np.einsum("pti,ti->pt", gram[np.ix_(base, pairs)].reshape(-1, t, 2), added)
            total += square + 2.0 * (gradient[base] @ steps + (gradient[own] * added).sum(axis=1))
            total += (steps * (held + 2.0 * across)).sum(axis=0)
            total += np.einsum("ti,tij,tj->t", added, gram[own[:, :, None], own[:, None]], added)
        return level, total
