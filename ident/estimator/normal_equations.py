"""Normal equations of the whitened loop closure at one value of the unknowns.

Signed residuals of every recording, added up with the Gaussian priors. The Jacobian is formed block
by block and dropped again, unless it is asked for: all at once it would be the largest thing in
memory. The columns of the tension's knots are a slope times a spline and are never formed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, repeat

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Parameter
from ballbar.cell.poses import KnownDistance
from ballbar.ident.estimator.model import Evaluation, Model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.estimator.whitening import Whitening

BLOCK_SAMPLES = 1500


@dataclass(frozen=True, eq=False)
class JacobianBlock:
    """Whitened derivatives at some samples of one recording, the tension's knots left out."""

    samples: slice
    index: NDArray[np.intp]  # (p,) into the unknowns
    values: Array  # (p, E, n)
    slope: Array | None  # (E, n) per newton of tension; None where the tension is no unknown

    def with_knots(self, model: Model, k: int) -> tuple[NDArray[np.intp], Array]:
        """Indices (q,) of all unknowns of recording k that the block tells of, and (q, E, n)
        their columns, those of the tension's knots formed.
        """
        knots = model.unknowns.knots(k)
        if self.slope is None or knots is None:
            return self.index, self.values
        splines = model.recordings[k].splines[:, self.samples]
        rows = np.flatnonzero(np.diff(splines.indptr))  # those that reach so far
        columns = splines[rows].toarray()[:, None] * self.slope
        return np.r_[self.index, knots.start + rows], np.concatenate((self.values, columns))

    def scores(self, vector: Array, model: Model, k: int) -> Array:
        """(P, n) each unknown's column times a whitened vector (E, n), sample by sample."""
        out, knots = np.zeros((model.unknowns.count, vector.shape[1])), model.unknowns.knots(k)
        out[self.index] = np.einsum("pen,en->pn", self.values, vector)
        if self.slope is not None and knots is not None:
            splines = model.recordings[k].splines[:, self.samples]
            out[knots] = (splines * (self.slope * vector).sum(axis=0)).toarray()
        return out

    def products(self, vector: Array, signals: Array, model: Model, k: int) -> Array:
        """(P, K) `scores` summed up with signals (K, n); those of knots are never formed."""
        out, knots = np.zeros((model.unknowns.count, len(signals))), model.unknowns.knots(k)
        out[self.index] = np.einsum("pen,en->pn", self.values, vector) @ signals.T
        if self.slope is not None and knots is not None:
            splines = model.recordings[k].splines[:, self.samples]
            out[knots] = splines @ ((self.slope * vector).sum(axis=0) * signals).T
        return out


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The normal equations at x, and what they were made of; costs include the prior."""

    x: Array  # (P,)
    evaluations: tuple[Evaluation, ...]  # of each recording, then of each group of still poses
    weights: tuple[Whitening, ...]
    residuals: tuple[Array, ...]  # (E, N) each, whitened, robust weights included
    normal: Array  # (P, P)
    gradient: Array  # (P,) of half the cost
    cost: float
    blocks: tuple[tuple[JacobianBlock, ...], ...] = ()  # of each part, where they were kept
    # (N,) square root of each sample's robust weight, of every part; empty where all count in full
    robust: tuple[Array, ...] = ()

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
    robust: Sequence[Array] = (),
) -> NormalEquations:
    """Normal equations of all parts and the prior at x (P,).

    ballbars : (N, 5) [rad] of each part, where its unmeasured joints start. weights : of each
    part, to be kept. previous : evaluations nearby (Model.evaluate). keep_blocks : whether the
    Jacobian is kept, so that `at_trial` can reuse it. robust : as of NormalEquations.
    """
    each = zip(ballbars, weights or repeat(None), previous or repeat(None), strict=False)
    solved = [
        model.solved(x, k, ballbar, excess, weights=weight, previous=point)
        for k, (ballbar, weight, point) in enumerate(each)
    ]
    residuals = _residuals([p for p, _ in solved], [w for _, w in solved], robust)
    out = NormalEquations(
        x=x,
        evaluations=tuple(point for point, _ in solved),
        weights=tuple(weight for _, weight in solved),
        residuals=residuals,
        normal=np.diag(model.unknowns.sigma**-2.0),
        gradient=(x - model.unknowns.mean) / model.unknowns.sigma**2,
        cost=_prior_cost(model, x) + float(sum((r * r).sum() for r in residuals)),
        robust=tuple(robust),
    )
    for known in model.distances:
        row, value = known_distance(model, x, known)
        out.normal[:] += np.outer(row, row)
        out.gradient[:] += row * value
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
    residuals = _residuals(points, equations.weights, equations.robust)
    cost = _prior_cost(model, x) + float(sum((r * r).sum() for r in residuals))
    return Trial(x, cost, points, residuals)


def at_trial(model: Model, equations: NormalEquations, accepted: Trial) -> NormalEquations:
    """The normal equations at an accepted trial with the Jacobian and weights of the old ones."""
    gradient = (accepted.x - model.unknowns.mean) / model.unknowns.sigma**2
    for known in model.distances:
        row, value = known_distance(model, accepted.x, known)
        gradient += row * value
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
    """Whitened derivatives of part k, block after block in order of time.

    firsts : first sample of each block, increasing; by default blocks are of one size.
    from_the_end : the last block first, for sums over all samples after an instant.
    """
    point, weights = equations.evaluations[k], equations.weights[k]
    if equations.robust:
        weights = weights.scaled(equations.robust[k])
    return _blocks(model, equations.x, k, point, weights, firsts, from_the_end=from_the_end)


def whole_jacobian(model: Model, x: Array, k: int, point: Evaluation, weights: Whitening) -> Array:
    """(P, E, N) derivative of the weighted error of part k, knots of a tension included."""
    out = np.zeros((model.unknowns.count, weights.matrix.shape[0], point.samples.size))
    for block in _blocks(model, x, k, point, weights):
        index, columns = block.with_knots(model, k)
        out[index, :, block.samples] = columns
    return out


def _blocks(
    model: Model,
    x: Array,
    k: int,
    point: Evaluation,
    weights: Whitening,
    firsts: Sequence[int] = (),
    *,
    from_the_end: bool = False,
) -> Iterator[JacobianBlock]:
    layout, part = model.unknowns, model.parts[k]
    parameters = layout.fixed.table.parameters
    own_parameters, own_geometry = part.own_geometry(layout, k)
    own_columns, slope = part.own_columns(layout, x, k, point, weights), None
    if isinstance(part, Samples) and (layout.gain is not None or layout.knots(k) is not None):
        if point.state is not None:
            slope = weights(model.tension_column(x, point))
        if layout.gain is not None:
            gain = np.zeros(point.closure.error.shape[1:]) if slope is None else slope
            own_columns.insert(
                0, (slice(layout.gain, layout.gain + 1), (gain * part.tension)[None])
            )
    geometric = [parameters[i] for i in (*layout.shared, *own_parameters)]
    parts = [slice(0, layout.shared.size), own_geometry, layout.coefficients]
    parts += [place for place, _ in own_columns]
    index = np.concatenate([np.arange(part.start, part.stop) for part in parts])
    channels = [c.channel for correction in model.corrections for c in correction.coefficients]
    columns = weights(point.columns) if channels else ()
    varied = dict(zip(point.varied, weights(point.varied_columns), strict=True))
    regressors = [signal for signals in point.regressors for signal in signals]
    edges = [*(firsts or range(0, part.size, BLOCK_SAMPLES)), part.size]
    blocks = [slice(first, stop) for first, stop in pairwise(edges)]
    for block in reversed(blocks) if from_the_end else blocks:
        values = np.empty((index.size, weights.matrix.shape[0], block.stop - block.start))
        weights.part(block).jacobian(point.closure.part(block), geometric, values[: len(geometric)])
        row = len(geometric)
        for channel, regressor in zip(channels, regressors, strict=True):
            column = varied[channel] if isinstance(channel, Parameter) else columns[channel]
            np.multiply(column[:, block], regressor[block], out=values[row])
            row += 1
        for _, own in own_columns:
            values[row : row + len(own)] = own[..., block]
            row += len(own)
        yield JacobianBlock(block, index, values, None if slope is None else slope[:, block])


def _residuals(
    points: Sequence[Evaluation], weights: Sequence[Whitening], robust: Sequence[Array]
) -> tuple[Array, ...]:
    """(E, N) weighted loop-closure error of every part."""
    white = tuple(w(point.closure.error) for point, w in zip(points, weights, strict=True))
    return tuple(r * f for r, f in zip(white, robust, strict=True)) if robust else white


def _prior_cost(model: Model, x: Array) -> float:
    """Cost of the priors and of the known distances between seats."""
    cost = float((((x - model.unknowns.mean) / model.unknowns.sigma) ** 2).sum())
    return cost + sum(known_distance(model, x, known)[1] ** 2 for known in model.distances)


def known_distance(model: Model, x: Array, known: KnownDistance) -> tuple[Array, float]:
    """Derivative (P,) and value of a known distance's residual, in its standard deviations."""
    layout, row = model.unknowns, np.zeros(model.unknowns.count)
    first, second = (layout.seat(x, seat).origin for seat in known.seats)
    apart = second - first
    length = float(np.linalg.norm(apart))
    row[layout.seats[known.seats[0]].start :][:3] = -apart / length / known.sigma
    row[layout.seats[known.seats[1]].start :][:3] = apart / length / known.sigma
    return row, (length - known.length) / known.sigma


def gradient_of(model: Model, k: int, block: JacobianBlock, residual: Array) -> Array:
    """(P,) of half the cost of one block with residuals (E, n)."""
    out, knots = np.zeros(model.unknowns.count), model.unknowns.knots(k)
    out[block.index] = block.values.reshape(block.index.size, -1) @ residual.reshape(-1)
    if block.slope is not None and knots is not None:
        splines = model.recordings[k].splines[:, block.samples]
        out[knots] = splines @ (block.slope * residual).sum(axis=0)
    return out


def products(model: Model, k: int, blocks: Sequence[JacobianBlock], vector: Array) -> Array:
    """(P,) columns of recording k times a whitened vector (E, N); blocks : all of it."""
    return np.asarray(sum(gradient_of(model, k, b, vector[:, b.samples]) for b in blocks))


def add_normal(model: Model, k: int, block: JacobianBlock, normal: Array) -> None:
    """Adds the products of one block's columns to the normal matrix (P, P); in place."""
    knots = model.unknowns.knots(k)
    normal[np.ix_(block.index, block.index)] += squared(block.values)
    if block.slope is None or knots is None:
        return
    splines = model.recordings[k].splines[:, block.samples]
    mixed = splines @ np.einsum("pen,en->np", block.values, block.slope)
    normal[knots, block.index] += mixed
    normal[block.index, knots] += mixed.T
    normal[knots, knots] += (
        (splines * (block.slope * block.slope).sum(axis=0)) @ splines.T
    ).toarray()


def squared(columns: Array) -> Array:
    """(p, p) products of columns (p, E, n) with each other."""
    half = dsyrk(1.0, columns.reshape(len(columns), -1).T, trans=1)  # the upper triangle
    return np.asarray(half + np.triu(half, 1).T)
