"""A fit taken apart into blocks of time: what each block says of the unknowns.

About the estimate the cost of a block is a parabola to first order, so what the fit would be
without some of them, and how well it would explain those, costs a few solutions of the normal
equations. Neighbours in time share what the model lacks, so whole blocks are left out (blocked
cross-validation, Roberts et al. 2017).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.normal_equations import BLOCK_SAMPLES, jacobian, squared
from ballbar.ident.estimator.observations import FollowedPoses
from ballbar.ident.estimator.samples import Samples

BLOCK = 3.0  # [s] longer than residuals are correlated: the path's own motion, the tension's knots
LENGTH = 6.0  # [s] of a block: longer than residuals are correlated (notes/identification sec. 7)
FOLDS = 5  # every fifth block is left out at once
NONE = np.empty(0, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Block:
    """The data's part of the normal equations of a block of time, or of several."""

    recording: int  # from 0, of the first sample
    start: float  # [s] of the first sample
    index: NDArray[np.intp]  # (p,) unknowns that the block tells of
    normal: Array  # (p, p)
    gradient: Array  # (p,) of half the cost
    cost: float


@dataclass(frozen=True, eq=False)
class TimeBlocks:
    """The data's part of a fit's normal equations, block by block in order of time."""

    fit: Fit
    blocks: tuple[Block, ...]  # B
    covariance: Array  # (P, P) of the fit to all blocks

    @cached_property
    def recording(self) -> NDArray[np.intp]:
        """(B,) from 0."""
        return np.array([block.recording for block in self.blocks])

    @cached_property
    def whole(self) -> Block:
        """All blocks as one."""
        return self.added(np.ones(len(self.blocks), dtype=np.bool_))

    def added(self, part: NDArray[np.bool_]) -> Block:
        """A part (B,) of the blocks as one block, which tells of all unknowns."""
        count = self.fit.x.size
        normal, gradient, cost = np.zeros((count, count)), np.zeros(count), 0.0
        chosen = [self.blocks[b] for b in np.flatnonzero(part)]
        for block in chosen:
            normal[np.ix_(block.index, block.index)] += block.normal
            gradient[block.index] += block.gradient
            cost += block.cost
        first = chosen[0]
        return Block(first.recording, first.start, np.arange(count), normal, gradient, cost)

    def held_out_cost(self, absent: NDArray[np.intp]) -> float:
        """Cost of blocks that the fit was not made from, of the fit without some unknowns.

        absent : indices of the unknowns that stay at their priors' means. The knots of the tension
        belong to a block's own time; they are fitted there, under their priors.
        """
        return sum(fold.cost(absent) for fold in self.folds)

    @cached_property
    def folds(self) -> list[BlocksLeftOut]:
        """The folds of a cross-validation, each left out of the fit."""
        knots = [np.r_[own.knots] for own in self.fit.model.unknowns.own if own.knots is not None]
        local = np.concatenate([NONE, *knots])
        fold = np.concatenate([np.arange(n) for n in np.bincount(self.recording)]) % FOLDS
        return [BlocksLeftOut(self, self.added(fold == k), local) for k in range(FOLDS)]

    def changed(self, part: Block, group: NDArray[np.intp]) -> tuple[float, Array]:
        """Decrease of the cost if a group of unknowns may differ in a part; and by how far.

        A score test: `h' W^-1 h` with h the group's gradient in that part and
        `W = N - N C N + prior` what it says of the group beyond all other blocks of the fit.
        """
        own, _, step = self._apart(part, group)
        return float(step @ own @ step), step

    def freed(self, part: NDArray[np.bool_], group: NDArray[np.intp]) -> TimeBlocks:
        """The blocks at the fit in which a group of unknowns differs in a part of them (B,)."""
        own, mixed, step = self._apart(self.added(part), group)
        shared, apart = self.covariance @ mixed.T, np.zeros(self.fit.x.size)
        apart[group] = step
        blocks = [
            replace(b, gradient=b.gradient + b.normal @ (inside * apart - shared @ step)[b.index])
            for b, inside in zip(self.blocks, part, strict=True)
        ]
        covariance = self.covariance + shared @ np.linalg.solve(own, shared.T)
        return replace(self, blocks=tuple(blocks), covariance=covariance)

    def _apart(self, part: Block, group: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """For a part: W (G, G) as above, normal matrix (G, P), and the group's step (G,)."""
        mixed = part.normal[group]
        own = mixed[:, group] - mixed @ self.covariance @ mixed.T
        own += np.diag(self.fit.model.unknowns.sigma[group] ** -2.0)
        step = np.asarray(-np.linalg.solve(own, part.gradient[group]), dtype=np.float64)
        return own, mixed, step


class BlocksLeftOut:
    """Blocks that are left out, beside the fit that is made from the others."""

    def __init__(self, blocks: TimeBlocks, left: Block, local: NDArray[np.intp]) -> None:
        """left : the blocks, as one. local : indices of the unknowns that are fitted to them in the
        end; their priors count.
        """
        layout, known = blocks.fit.model.unknowns, blocks.fit.by_poses
        self._weight, self._off = layout.sigma**-2.0, blocks.fit.x - layout.mean
        self._left, self._local = left, local
        self._others = lu_factor(blocks.whole.normal - left.normal + known[0])
        gradient = blocks.whole.gradient - left.gradient + known[1]
        self._step = -lu_solve(self._others, gradient)
        self._own = left.normal[np.ix_(local, local)] + np.diag(self._weight[local])
        self._factor = lu_factor(self._own)

    def cost(self, absent: NDArray[np.intp] = NONE) -> float:
        """Cost of the blocks; absent : indices of unknowns that stay at their priors' means."""
        left, local, step = self._left, self._local, self._step.copy()
        if absent.size:
            columns = lu_solve(self._others, np.eye(step.size)[:, absent])
            away = -self._off[absent] - step[absent]
            step += columns @ np.linalg.solve(columns[absent], away)
        step[local] = 0.0
        slope = self._weight[local] * self._off[local]
        step[local] = -lu_solve(self._factor, (left.gradient + left.normal @ step)[local] + slope)
        prior = (2.0 * slope + self._weight[local] * step[local]) @ step[local]
        return float(left.cost + (2.0 * left.gradient + left.normal @ step) @ step + prior)

    def expected(self) -> float:
        """Cost that the uncertainty of the fit to the others adds, on average."""
        normal, local = self._left.normal, self._local
        shared = np.setdiff1d(np.arange(len(normal)), local)
        covariance = lu_solve(self._others, np.eye(len(normal)))[np.ix_(shared, shared)]
        mixed = normal[np.ix_(shared, local)]
        absorbed = mixed @ lu_solve(self._factor, mixed.T)
        return float(np.sum(covariance * (normal[np.ix_(shared, shared)] - absorbed)))


def each_block(fit: Fit, length: float, *, followed: bool = False) -> Iterator[Block]:
    """The blocks of `length` [s] of a fit in order of time; none spans two recordings.

    followed : whether those of what followed the robot come too, after the recordings.
    """
    model, linear = fit.model, fit.linear
    for k, part in enumerate(model.parts):
        if (isinstance(part, FollowedPoses) and followed) or isinstance(part, Samples):
            times = part.times
        else:
            continue
        number, residual = block_numbers(times, length), linear.residuals[k]
        edges = np.searchsorted(number, np.arange(number[-1] + 2)).tolist()
        wide = edges[: -1 : max(1, BLOCK_SAMPLES * len(edges) // times.size)]
        for block in jacobian(model, linear, k, firsts=wide):
            index, columns = block.with_knots(model, k)
            begin, end = block.samples.start, block.samples.stop
            for first, stop in pairwise(e for e in edges if begin <= e <= end):
                own, rest = columns[..., first - begin : stop - begin], residual[:, first:stop]
                used = own.any(axis=(1, 2))
                own, cost = own[used], float((rest * rest).sum())
                gradient = own.reshape(len(own), -1) @ rest.reshape(-1)
                yield Block(k, float(times[first]), index[used], squared(own), gradient, cost)


def time_blocks(fit: Fit, length: float = LENGTH) -> TimeBlocks:
    """A fit in blocks of `length` [s]; no block spans two recordings."""
    return TimeBlocks(fit, tuple(each_block(fit, length)), fit.covariance)


def block_numbers(times: Array, block: float = BLOCK) -> NDArray[np.intp]:
    """(N,) number of each sample's block of time, from 0.

    times : (N,) [s], increasing. block : [s] its length.
    """
    return np.cumsum(np.diff(np.floor((times - times[0]) / block), prepend=0.0) > 0)


def block_sums(values: Array, numbers: NDArray[np.intp]) -> Array:
    """(K, B) sums of values (K, N) over blocks of time; numbers : (N,) block of each, from 0."""
    out = np.zeros((int(numbers.max()) + 1, len(values)))
    np.add.at(out, numbers, values.T)
    return out.T
