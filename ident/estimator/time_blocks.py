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
class TimeBlocks:
    """The data's part of a fit's normal equations, block by block in order of time."""

    fit: Fit
    recording: NDArray[np.intp]  # (B,) from 0
    start: Array  # (B,) [s] of the first sample
    normal: Array  # (B, P, P)
    gradient: Array  # (B, P) of half the cost
    cost: Array  # (B,)
    covariance: Array  # (P, P) of the fit to all blocks

    def held_out_cost(self, absent: NDArray[np.intp]) -> float:
        """Cost of blocks that the fit was not made from, of the fit without some unknowns.

        absent : indices of the unknowns that stay at their priors' means. The knots of the tension
        belong to a block's own time; they are fitted there, under their priors.
        """
        knots = [np.r_[own.knots] for own in self.fit.model.unknowns.own if own.knots is not None]
        local, folds = np.concatenate([NONE, *knots]), self.folds
        return sum(folds.left_out(np.arange(FOLDS) == k, local, absent) for k in range(FOLDS))

    @cached_property
    def folds(self) -> TimeBlocks:
        """The folds of a cross-validation, each as one block."""
        fold = np.concatenate([np.arange(n) for n in np.bincount(self.recording)]) % FOLDS
        return self.added(*(fold == k for k in range(FOLDS)))

    def added(self, *parts: NDArray[np.bool_]) -> TimeBlocks:
        """Parts (B,) of the blocks, each as one block."""
        share = np.array(parts, dtype=float)
        normal, gradient, cost = (
            np.tensordot(share, values, axes=1)
            for values in (self.normal, self.gradient, self.cost)
        )
        first = [int(np.argmax(part)) for part in parts]
        return replace(
            self,
            recording=self.recording[first],
            start=self.start[first],
            normal=normal,
            gradient=gradient,
            cost=cost,
        )

    def left_out(
        self, left: NDArray[np.bool_], local: NDArray[np.intp], absent: NDArray[np.intp] = NONE
    ) -> float:
        """Cost of some blocks (B,) of the fit that is made from the others.

        local : indices of the unknowns that are fitted to the blocks that were left out; their
        priors count. absent : as above.
        """
        layout = self.fit.model.unknowns
        weight = layout.sigma**-2.0
        slope = weight * (self.fit.x - layout.mean)
        known, pulled = self.fit.by_poses
        away = np.zeros(layout.count)
        away[absent] = layout.mean[absent] - self.fit.x[absent]
        free = np.setdiff1d(np.arange(layout.count), absent)
        whole, pull = self.normal.sum(axis=0), self.gradient.sum(axis=0)
        normal, gradient = (v[left].sum(axis=0) for v in (self.normal, self.gradient))
        step = _step(whole - normal + known, pull - gradient + pulled, away, free)
        step = _step(normal + np.diag(weight), gradient + slope, step, local)
        prior = (2.0 * slope[local] + weight[local] * step[local]) @ step[local]
        data = self.cost[left].sum() + (2.0 * gradient + normal @ step) @ step
        return float(data + prior)

    def expected(self, left: NDArray[np.bool_], local: NDArray[np.intp]) -> float:
        """Cost that the uncertainty of the fit to the others adds to `left_out`, on average."""
        count = self.fit.model.unknowns.count
        weight, shared = self.fit.model.unknowns.sigma**-2.0, np.setdiff1d(np.arange(count), local)
        whole, normal = self.normal.sum(axis=0), self.normal[left].sum(axis=0)
        covariance = np.linalg.inv(whole - normal + self.fit.by_poses[0])[np.ix_(shared, shared)]
        mixed, own = normal[np.ix_(shared, local)], normal[np.ix_(local, local)]
        absorbed = mixed @ np.linalg.solve(own + np.diag(weight[local]), mixed.T)
        return float(np.sum(covariance * (normal[np.ix_(shared, shared)] - absorbed)))

    def changed(self, part: NDArray[np.bool_], group: NDArray[np.intp]) -> tuple[float, Array]:
        """Decrease of the cost if a group of unknowns may differ in a part (B,); and by how far.

        A score test: `h' W^-1 h` with h the group's gradient in that part and
        `W = N - N C N + prior` what it says of the group beyond all other blocks of the fit.
        """
        own, _, step = self._apart(part, group)
        return float(step @ own @ step), step

    def freed(self, part: NDArray[np.bool_], group: NDArray[np.intp]) -> TimeBlocks:
        """The blocks at the fit in which a group of unknowns differs in a part of them (B,)."""
        own, mixed, step = self._apart(part, group)
        shared = self.covariance @ mixed.T
        gradient = self.gradient - self.normal @ (shared @ step)
        gradient[part] += self.normal[part][:, :, group] @ step
        covariance = self.covariance + shared @ np.linalg.solve(own, shared.T)
        return replace(self, gradient=gradient, covariance=covariance)

    def _apart(
        self, part: NDArray[np.bool_], group: NDArray[np.intp]
    ) -> tuple[Array, Array, Array]:
        """For a part: W (G, G) as above, normal matrix (G, P), and the group's step (G,)."""
        place = np.ix_(part, group)
        mixed, gradient = self.normal[place].sum(axis=0), self.gradient[place].sum(axis=0)
        own = mixed[:, group] - mixed @ self.covariance @ mixed.T
        own += np.diag(self.fit.model.unknowns.sigma[group] ** -2.0)
        return own, mixed, -np.linalg.solve(own, gradient)


def _step(normal: Array, gradient: Array, step: Array, free: NDArray[np.intp]) -> Array:
    """A step (P,) whose elements `free` are those that minimise the cost, beside its others."""
    out = step.copy()
    out[free] = 0.0
    slope = (gradient + normal @ out)[free]
    out[free] = -np.linalg.solve(normal[np.ix_(free, free)], slope)
    return out


@dataclass(frozen=True, eq=False)
class Block:
    """The data's part of the normal equations of one block of time."""

    recording: int  # from 0
    start: float  # [s] of the first sample
    index: NDArray[np.intp]  # (p,) unknowns that the block tells of
    normal: Array  # (p, p)
    gradient: Array  # (p,) of half the cost
    cost: float


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
    blocks, count = list(each_block(fit, length)), fit.x.size
    out = TimeBlocks(
        fit=fit,
        recording=np.array([b.recording for b in blocks]),
        start=np.array([b.start for b in blocks]),
        normal=np.zeros((len(blocks), count, count)),
        gradient=np.zeros((len(blocks), count)),
        cost=np.array([b.cost for b in blocks]),
        covariance=fit.covariance,
    )
    for b, block in enumerate(blocks):
        out.normal[b][np.ix_(block.index, block.index)] = block.normal
        out.gradient[b, block.index] = block.gradient
    return out


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
