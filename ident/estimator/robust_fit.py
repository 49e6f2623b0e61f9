"""Robust maximum a posteriori fit of still poses: iteratively reweighted Gauss-Newton.

Weights of poses whose whitened residual is long fall as in Huber 1964; those very far off are left
out. What the model leaves unexplained is estimated along with it, as one variance of position and
one of rotation: with P unknowns of which the data determine p, the mean square of the residuals
times `n / (n - p)`; on real robots it is ten times the noise of the instrument (docs/real_robots).
The priors of the robot's parameters and of the corrections' coefficients have the tails of
Student's distribution, so that a joint whose zero was lost is not held at its catalogue value, nor
the sag under a heavy tool near none (Lange, Little & Taylor 1989: both are weights of an
iteration).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.fit import Fit, WhitenedLoopClosure, fit
from ballbar.ident.estimator.gauss_newton import Stop, inverse, minimise
from ballbar.ident.estimator.model import Model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import NormalEquations, normal_equations
from ballbar.ident.estimator.priors import with_tails
from ballbar.ident.estimator.unknowns import Unknowns
from ballbar.ident.estimator.variance_components import OF_POSES, likeliest

HUBER = 3.0  # Huber's threshold, in root mean squares of a pose's whitened residual
GROSS = 10.0  # in the same: a pose further off is left out (docs/real_robots)
MEDIAN = 0.9  # of the root mean square of three normal numbers
ROUNDS = 15  # of new variances and weights
SETTLED = 0.01  # relative change of the variances' roots that ends them
NEGLIGIBLE = 1e-3  # decrease of the cost that ends a search, per degree of freedom
MAX_ITERATIONS = 15  # of a search
START = ExcessNoise(position=1e-3, rotation=1e-3)  # before a residual is known
FURTHEST = 0.3  # [m, rad] of the same: a start by joints whose zeros were lost
LEAST = ExcessNoise(position=1e-7, rotation=1e-7)


def fit_robustly(
    model: Model, x: Array, excess: ExcessNoise = START, *, left_out: NDArray[np.intp] | None = None
) -> Fit:
    """Fit a model of still poses from x (P,).

    left_out : poses, by their place in the table, that shall not count.
    """
    counting = np.ones(model.poses.size)
    counting[[] if left_out is None else left_out] = 0.0
    robust = counts = np.split(counting, np.cumsum([p.size for p in model.parts])[:-1])
    declared = model.unknowns
    stated = np.concatenate((declared.machine, declared.sizes))
    model = replace(model, unknowns=widened(declared, x, declared.sizes))
    iterations, converged = 0, False
    for _ in range(ROUNDS):
        problem = WhitenedLoopClosure(model, x, _no_bars(model), excess, robust=robust)
        minimum = minimise(problem, Stop(decrease=NEGLIGIBLE), max_iterations=MAX_ITERATIONS)
        linear, x = minimum.equations, minimum.equations.x
        iterations += minimum.iterations
        before, excess = excess, unexplained(model, linear, excess)
        robust = [r * c for r, c in zip(robust_weights(linear), counts, strict=True)]
        model = replace(model, unknowns=widened(declared, x, stated))
        converged = minimum.converged or minimum.stuck
        settled = all(
            abs(after - old) <= SETTLED * old
            for old, after in (
                (before.position, excess.position),
                (before.rotation, excess.rotation),
            )
        )
        if converged and settled:
            break
    linear = equations_at(model, x, excess, robust)
    return Fit(model, linear, inverse(linear.normal), excess, iterations, converged)


def fit_unweighted(model: Model, x: Array, excess: ExcessNoise) -> Fit:
    """The minimum from x (P,), every pose in full, the unexplained part given."""
    robust = [np.ones(part.size) for part in model.parts]
    return fit(
        model,
        x,
        _no_bars(model),
        excess,
        negligible=NEGLIGIBLE,
        max_iterations=MAX_ITERATIONS,
        freeze_after=None,
        robust=robust,
    )


def equations_at(
    model: Model, x: Array, excess: ExcessNoise, robust: Sequence[Array]
) -> NormalEquations:
    """Normal equations of still poses at x (P,); robust : as of NormalEquations."""
    return normal_equations(model, x, _no_bars(model), excess, robust=robust)


def _no_bars(model: Model) -> list[Array]:
    return [np.zeros((part.size, 0)) for part in model.parts]


def stacked(parts: Sequence[Array]) -> Array:
    """(..., E, N) arrays of all groups one after the other; absent equations are zero."""
    rows = max(part.shape[-2] for part in parts)

    def padded(part: Array) -> Array:
        missing = [(0, 0)] * part.ndim
        missing[-2] = (0, rows - part.shape[-2])
        return np.pad(part, missing) if missing[-2][1] else part

    return np.concatenate([padded(part) for part in parts], axis=-1)


def robust_weights(linear: NormalEquations, first: int = 0) -> list[Array]:
    """(N,) square root of Huber's weight of each group's poses, by the scale of all residuals.

    first : part from which on the still poses are.
    """
    lengths = whitened_lengths(linear)[first:]
    scale = max(1.0, median_scale(lengths))
    return [
        np.sqrt(np.minimum(1.0, HUBER * scale / np.maximum(v, 1e-9))) * (v < GROSS * scale)
        for v in lengths
    ]


def whitened_lengths(linear: NormalEquations) -> list[Array]:
    """(N,) root mean square of each pose's whitened residual, robust weights left out."""
    return [
        np.sqrt((weights(point.closure.error) ** 2).sum(axis=0) / len(weights.matrix))
        for point, weights in zip(linear.evaluations, linear.weights, strict=True)
    ]


def median_scale(lengths: Sequence[Array]) -> float:
    """Scale of whitened lengths that a few wrong poses do not move: 1 for white noise."""
    return float(np.median(np.concatenate(lengths))) / MEDIAN


def widened(declared: Unknowns, x: Array, chosen: NDArray[np.intp]) -> Unknowns:
    """The unknowns, of what files state those chosen, with priors in Student's distribution."""
    sigma = declared.sigma.copy()
    sigma[chosen] = with_tails(sigma[chosen], x[chosen] - declared.mean[chosen])
    return replace(declared, sigma=sigma)


def determined(linear: NormalEquations, layout: Unknowns) -> float:
    """Number of unknowns that the data determine, in addition to what the priors tell."""
    return float(layout.count - np.trace(inverse(linear.normal) / layout.sigma[:, None] ** 2))


def unexplained(model: Model, linear: NormalEquations, before: ExcessNoise) -> ExcessNoise:
    """Position and rotation variance of the residual beyond what the sensors explain.

    By largest likelihood where some directions are measured much better than others.
    """
    spare = max(0.05, 1.0 - determined(linear, model.unknowns) / linear.equations)
    if any(group.factor is not None for group in model.poses.groups):
        lengths = whitened_lengths(linear)
        limit = GROSS * median_scale(lengths)
        counts = tuple(r * (v < limit) for r, v in zip(linear.robust, lengths, strict=True))
        counting = replace(linear, robust=counts)
        return likeliest(model, counting, before, OF_POSES, spare, FURTHEST)
    position = rotation = 0.0
    count = turns = 0.0
    for point, robust in zip(linear.evaluations, linear.robust, strict=True):
        weight = robust**2
        square = point.closure.error**2
        noise = (point.noise_columns(ExcessNoise()) ** 2).sum(axis=0)  # (6, N)
        position += float((weight * (square[:3].sum(axis=0) / spare - noise[:3].sum(axis=0))).sum())
        count += point.still.kind.directions * float(weight.sum())
        if point.still.kind.target_turns:
            turning = square[3:].sum(axis=0) / spare - noise[3:].sum(axis=0)
            rotation += float((weight * turning).sum())
            turns += 3.0 * float(weight.sum())
    return ExcessNoise(
        position=float(np.sqrt(max(position / count, LEAST.position**2))),
        rotation=float(np.sqrt(max(rotation / turns, LEAST.rotation**2))) if turns else 0.0,
    )
