"""Normal equations of the whitened loop closure at one value of the unknowns.

Signed residuals of every recording, added up with the Gaussian priors. The Jacobian is formed block
by block and dropped again, unless it is asked for: all at once it would be the largest thing in
memory. The columns of the tension's knots are a slope times a spline and are never formed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk

from cell.arrays import Array
from cell.geometry import Parameter
from ident.estimator.model import Evaluation, Model
from ident.estimator.noise import ExcessNoise
from ident.estimator.whitening import Whitening

BLOCK_SAMPLES = 1500


@dataclass(frozen=True, eq=False)
class JacobianBlock:
    """Whitened derivatives at some samples of one recording, the tension's knots left out."""

    samples: slice
    index: NDArray[np.intp]  # (p,) into the unknowns
    values: Array  # (p, E, n)
    slope: Array | None  # (E, n) per newton of tension; None where the tension is no unknown

    def scores(self, vector: Array, model: Model, k: int) -> Array:
        """(P, n) each unknown's column times a whitened vector (E, n), sample by sample."""
        out, knots = np.zeros((model.unknowns.count, vector.shape[1])), model.unknowns.own[k].knots
        out[self.index] = (self.values * vector).sum(axis=1)
        if self.slope is not None and knots is not None:
            splines = model.recordings[k].splines[:, self.samples]
            out[knots] = (splines * (self.slope * vector).sum(axis=0)).toarray()
        return out


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The normal equations at x, and what they were made of; costs include the prior."""

    x: Array  # (P,)
    evaluations: tuple[Evaluation, ...]  # one a recording
    weights: tuple[Whitening, ...]
    residuals: tuple[Array, ...]  # (E, N) each, whitened
    normal: Array  # (P, P)
    gradient: Array  # (P,) of half the cost
    cost: float
    blocks: tuple[tuple[JacobianBlock, ...], ...] = ()  # of each recording, where they were kept

    @property
    def equations(self) -> int:
        return sum(r.size for r in self.residuals)

    @property
    def data_cost(self) -> float:
        """Sum of squares of the whitened residuals."""
        return float(sum((r * r).sum() for r in self.residuals))


def normal_equations(
    model: Model,
    x: Array,
    ballbars: Sequence[Array],
    excess: ExcessNoise,
    *,
    weights: Sequence[Whitening] = (),
    previous: Sequence[Evaluation] = (),
    keep_blocks: bool = False,
) -> NormalEquations:
    """Normal equations of all recordings and the prior at x (P,).

    ballbars : (N, 5) [rad] of each recording, where its unmeasured joints start. weights : of each
    recording, to be kept. previous : evaluations nearby (Model.evaluate). keep_blocks : whether the
    Jacobian is kept, so that `at_trial` can reuse it.
    """
    solved = [
        model.solved(
            x,
            k,
            ballbar,
            excess,
            weights=weights[k] if weights else None,
            previous=previous[k] if previous else None,
        )
        for k, ballbar in enumerate(ballbars)
    ]
    residuals = tuple(weight(point.closure.error) for point, weight in solved)
    out = NormalEquations(
        x=x,
        evaluations=tuple(point for point, _ in solved),
        weights=tuple(weight for _, weight in solved),
        residuals=residuals,
        normal=np.diag(model.unknowns.sigma**-2.0),
        gradient=(x - model.unknowns.mean) / model.unknowns.sigma**2,
        cost=_prior_cost(model, x) + float(sum((r * r).sum() for r in residuals)),
    )
    blocks = []
    for k, residual in enumerate(residuals):
        own = []
        for block in jacobian(model, out, k):
            add_normal(model, k, block, out.normal)
            out.gradient[:] += gradient_of(model, k, block, residual[:, block.samples])
            own += [block] if keep_blocks else []
        blocks.append(tuple(own))
    return replace(out, blocks=tuple(blocks)) if keep_blocks else out


@dataclass(frozen=True, eq=False)
class Trial:
    """The cost at a trial step, under the weights of the normal equations that it was made from."""

    x: Array  # (P,)
    cost: float
    evaluations: tuple[Evaluation, ...]
    residuals: tuple[Array, ...]


def trial(model: Model, equations: NormalEquations, step: Array) -> Trial:
    """The posterior cost after a step (P,), weights and unmeasured joints as they are."""
    x = model.unknowns.moved(equations.x, step)
    points = tuple(
        model.evaluate(x, k, point.ballbar, point, hold_loads=True)
        for k, point in enumerate(equations.evaluations)
    )
    residuals = tuple(
        weight(point.closure.error) for point, weight in zip(points, equations.weights, strict=True)
    )
    cost = _prior_cost(model, x) + float(sum((r * r).sum() for r in residuals))
    return Trial(x, cost, points, residuals)


def at_trial(model: Model, equations: NormalEquations, accepted: Trial) -> NormalEquations:
    """The normal equations at an accepted trial with the Jacobian and weights of the old ones."""
    gradient = (accepted.x - model.unknowns.mean) / model.unknowns.sigma**2
    for k, (blocks, residual) in enumerate(zip(equations.blocks, accepted.residuals, strict=True)):
        for block in blocks:
            gradient += gradient_of(model, k, block, residual[:, block.samples])
    return replace(
        equations,
        x=accepted.x,
        evaluations=accepted.evaluations,
        residuals=accepted.residuals,
        gradient=gradient,
        cost=accepted.cost,
    )


def jacobian(
    model: Model,
    equations: NormalEquations,
    k: int,
    *,
    firsts: Sequence[int] = (),
    from_the_end: bool = False,
) -> Iterator[JacobianBlock]:
    """Whitened derivatives of recording k, block after block in order of time.

    firsts : first sample of each block, increasing; by default blocks are of one size.
    from_the_end : the last block first, for sums over all samples behind an instant.
    """
    layout, samples, own = model.unknowns, model.recordings[k], model.unknowns.own[k]
    point, weights, x = equations.evaluations[k], equations.weights[k], equations.x
    parameters = layout.fixed.table.parameters
    geometric = [parameters[i] for i in (*layout.shared, *own.parameters)]
    parts = [slice(0, layout.shared.size), own.geometry, layout.coefficients]
    if layout.gain is not None:
        parts.append(slice(layout.gain, layout.gain + 1))
    parts += [part for part in (own.clock, own.steps) if part is not None]
    index = np.concatenate([np.arange(part.start, part.stop) for part in parts])
    channels = [c.channel for correction in model.corrections for c in correction.coefficients]
    columns = weights(point.columns) if channels else ()
    varied = dict(zip(point.varied, weights(point.varied_columns), strict=True))
    regressors = [signal for signals in point.regressors for signal in signals]
    shift = weights(point.time_column) if own.clock is not None else None
    slope = None
    if point.state is not None and (layout.gain is not None or own.knots is not None):
        slope = weights(model.tension_column(x, point))
    steps = samples.after_clock_steps() if own.steps is not None else ()
    edges = [*(firsts or range(0, samples.times.size, BLOCK_SAMPLES)), samples.times.size]
    blocks = [slice(first, stop) for first, stop in pairwise(edges)]
    for block in reversed(blocks) if from_the_end else blocks:
        values = np.empty((index.size, weights.matrix.shape[0], block.stop - block.start))
        weights.part(block).jacobian(point.closure.part(block), geometric, values[: len(geometric)])
        rows = iter(values[len(geometric) :])
        for channel, regressor in zip(channels, regressors, strict=True):
            column = varied[channel] if isinstance(channel, Parameter) else columns[channel]
            np.multiply(column[:, block], regressor[block], out=next(rows))
        if layout.gain is not None and slope is not None:
            np.multiply(slope[:, block], samples.tension[block], out=next(rows))
        if shift is not None:
            next(rows)[:] = shift[:, block]
            np.multiply(shift[:, block], samples.times[block], out=next(rows))
            for after in steps:
                np.multiply(shift[:, block], after[block], out=next(rows))
        yield JacobianBlock(block, index, values, None if slope is None else slope[:, block])


def _prior_cost(model: Model, x: Array) -> float:
    return float((((x - model.unknowns.mean) / model.unknowns.sigma) ** 2).sum())


def gradient_of(model: Model, k: int, block: JacobianBlock, residual: Array) -> Array:
    """(P,) of half the cost of one block with residuals (E, n)."""
    out, knots = np.zeros(model.unknowns.count), model.unknowns.own[k].knots
    out[block.index] = block.values.reshape(block.index.size, -1) @ residual.reshape(-1)
    if block.slope is not None and knots is not None:
        splines = model.recordings[k].splines[:, block.samples]
        out[knots] = splines @ (block.slope * residual).sum(axis=0)
    return out


def add_normal(model: Model, k: int, block: JacobianBlock, normal: Array) -> None:
    """Adds the products of one block's columns to the normal matrix (P, P); in place."""
    flat, knots = block.values.reshape(block.index.size, -1), model.unknowns.own[k].knots
    half = dsyrk(1.0, flat.T, trans=1)  # the upper triangle
    normal[np.ix_(block.index, block.index)] += half + np.triu(half, 1).T
    if block.slope is None or knots is None:
        return
    splines = model.recordings[k].splines[:, block.samples]
    mixed = splines @ np.einsum("pen,en->np", block.values, block.slope)
    normal[knots, block.index] += mixed
    normal[block.index, knots] += mixed.T
    normal[knots, knots] += (
        (splines * (block.slope * block.slope).sum(axis=0)) @ splines.T
    ).toarray()
