"""Joint errors that a search has found one after another, weighed against their neighbours.

What a forward search took first it chose while the others were missing, so each order is replaced
where another one of its joint explains more beside all that came after it, and left out where it
explains nothing any more (sequential replacement: Miller 2002). On a joint that moves by
a part of a turn several orders explain the recordings equally well and differ everywhere else. All
of these are unknowns: the variance that is expected of the error is divided among them in
proportion to their likelihoods (model averaging: Hoeting et al. 1999). The data tell their sum
where they are, and the covariance holds what nobody knows outside.

With the residual r of a fit without these errors, J of its other unknowns, of inverse normal
matrix C, and the columns A of all candidates, a set S of orders lowers the cost by

    g_S' K_SS^-1 g_S,    K = A' A - A' J C J' A + 1 / prior^2,    g = A' r - A' J C (J' r + p)

where p is the gradient of the prior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.ident.corrections.joint_harmonics import PRIOR
from ballbar.ident.estimator.linear_model import LinearModel
from ballbar.ident.estimator.order_search import THRESHOLD, wave_columns

BETTER = 0.3  # chi-square, in `widening`, below which two orders are equally good
LIKELY = 0.05  # likelihood over that of the best from which an order may as well be the one
LEAST = 2e-6  # [rad] of one of several: six such together are LITTLE_RIPPLE

Pair = tuple[int, float]  # joint from 0, cycles a turn


@dataclass(frozen=True)
class RevisedOrder:
    """One joint error, and the orders that it may have as well."""

    number: int  # of the error in the search, from 0
    sizes: dict[Pair, float]  # [rad] amplitude expected of the order, first, and of each other one


@dataclass(frozen=True, eq=False)
class _Gains:
    """By how much sets of candidates lower the cost of a fit."""

    matrix: Array  # (2C, 2C)
    vector: Array  # (2C,)

    def sizes(self, chosen: Sequence[int]) -> Array:
        """(S,) [rad] amplitude of each of the candidates, numbers from 0."""
        places = _places(chosen)
        own = self.matrix[np.ix_(places, places)]
        amplitudes = np.linalg.solve(own, self.vector[places])
        return np.asarray(np.linalg.norm(amplitudes.reshape(-1, 2), axis=1))

    def beside(self, chosen: Sequence[int]) -> tuple[float, Array]:
        """Decrease of chi-square by candidates, and (C,) by these and any other one."""
        places, count = _places(chosen), len(self.vector) // 2
        cross = self.matrix[places]
        right = np.column_stack((self.vector[places], cross))
        solved = np.linalg.solve(cross[:, places], right)
        level = float(self.vector[places] @ solved[:, 0])
        score = (self.vector - cross.T @ solved[:, 0]).reshape(count, 2)
        pairs = np.arange(2 * count).reshape(count, 2)
        own = self.matrix[pairs[:, :, None], pairs[:, None]]
        rest = cross[:, pairs], solved[:, 1:][:, pairs]
        left = own - np.einsum("pci,pcj->cij", *rest)
        left[list(chosen)] = np.eye(2)
        score[list(chosen)] = 0.0
        added = np.linalg.solve(left, score[..., None])[..., 0]
        return level, np.asarray(level + (score * added).sum(axis=1))


def _places(chosen: Sequence[int]) -> NDArray[np.intp]:
    return np.ravel([(2 * c, 2 * c + 1) for c in chosen]).astype(np.intp)


@dataclass(frozen=True, eq=False)
class _Search:
    """Sets of candidates, one in the place of each error: its number to the candidate's."""

    gains: _Gains
    joints: NDArray[np.intp]  # (C,) of the candidates

    def beside(self, chosen: Mapping[int, int], out: Sequence[int]) -> tuple[float, Array]:
        """Decrease without some of one joint, and (C,) with each of its candidates instead."""
        left = [c for k, c in chosen.items() if k not in out]
        level, levels = self.gains.beside(left)
        levels[self.joints != self.joints[chosen[out[0]]]] = -np.inf
        levels[left] = -np.inf
        return level, levels

    def exchanged(self, chosen: dict[int, int], least: float) -> dict[int, int]:
        """The set with other candidates in the places of one or two of a joint, while that helps.

        least : decrease of chi-square that is a better set.
        """
        level = self.gains.beside([*chosen.values()])[0]
        places = [
            out
            for count in (1, 2)
            for out in combinations(chosen, count)
            if len({self.joints[chosen[k]] for k in out}) == 1
        ]
        while True:
            best, new = max((self._regrown(chosen, out) for out in places), key=itemgetter(0))
            if best < level + least:
                return chosen
            level, chosen = best, new

    def _regrown(self, chosen: dict[int, int], out: Sequence[int]) -> tuple[float, dict[int, int]]:
        """Decrease with the best candidates, one after another, in the place of some."""
        new, level = dict(chosen), 0.0
        for n, k in enumerate(out):
            levels = self.beside(new, out[n:])[1]
            new[k] = int(levels.argmax())
            level = float(levels[new[k]])
        return level, new

    def needed(self, chosen: dict[int, int], least: float) -> dict[int, int]:
        """The set without what brings less than this decrease of chi-square."""
        level, chosen = self.gains.beside([*chosen.values()])[0], dict(chosen)
        while chosen:
            best, k = max((self.beside(chosen, (k,))[0], k) for k in chosen)
            if best < level - least:
                break
            level = best
            del chosen[k]
        return chosen

    def shares(self, chosen: Mapping[int, int], k: int, widening: float) -> Array:
        """(C,) probabilities of the candidates in one place, those that hardly may be it at 0."""
        levels = self.beside(chosen, (k,))[1]
        share = np.exp(0.5 * np.minimum(0.0, levels - levels[chosen[k]]) / widening)
        share[share < LIKELY] = 0.0
        return np.asarray(share / share.sum())


def revised_orders(
    model: LinearModel,
    own: NDArray[np.intp],
    values: Array,
    selected: Sequence[Pair],
    rivals: Sequence[Pair],
    widening: float,
) -> list[RevisedOrder]:
    """The joint errors that a search has selected, revised.

    own : (2F,) their amplitudes among the unknowns. values : (2F,) [rad] of them. rivals : what may
    stand in their place. widening : of variances over those of white noise.
    """
    pairs = [*selected, *rivals]
    gains = _gains(model, own, values, wave_columns(model, pairs))
    search = _Search(gains, np.array([joint for joint, _ in pairs]))
    chosen = search.exchanged(dict(enumerate(range(len(selected)))), BETTER * widening)
    enough = 2.0 * np.log(len(pairs)) + THRESHOLD  # as of the search
    chosen, out = search.needed(chosen, enough * widening), []
    for (k, first), size in zip(chosen.items(), gains.sizes([*chosen.values()]), strict=True):
        each = size * np.sqrt(search.shares(chosen, k, widening))
        also = [int(m) for m in np.flatnonzero(each > LEAST) if m != first]
        out.append(RevisedOrder(k, {pairs[m]: float(each[m]) for m in (first, *also)}))
    return out


def _gains(model: LinearModel, own: NDArray[np.intp], values: Array, waves: Array) -> _Gains:
    """waves : (C, 2, E, N) columns of the candidates."""
    flat, others = waves.reshape(-1, *model.residual.shape), np.ones(len(model.prior_normal), bool)
    others[own] = False
    steps = np.zeros((1, others.size))
    steps[0, own] = -values
    residual = model.residual + model.combined(steps)[0]
    normal = (model.gram() + model.prior_normal)[np.ix_(others, others)]
    gradient = model.prior_gradient - model.prior_normal[:, own] @ values
    gradient = (gradient + model.products(residual[None])[:, 0])[others]
    mixed = model.products(flat)[others]
    taken = np.linalg.solve(normal, np.column_stack((mixed, gradient)))
    raw = flat.reshape(len(flat), -1)
    matrix = raw @ raw.T - mixed.T @ taken[:, :-1] + np.eye(len(raw)) / PRIOR**2
    return _Gains(matrix, raw @ residual.ravel() - mixed.T @ taken[:, -1])
