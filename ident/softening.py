"""Knees of gears that are softer under a small load, found by evidence.

A complete fit is linearised at its estimate (ballbar.ident.joint_errors.linearised), and every
gear's column is tried with knees all over its load: a score test whose variance is that of blocks
of time. The best one joins the model, until none is sure. A knee must be right within a tenth, or
the answer is not better than without (notes/identification sec. 7): so each fit with the second
slope tells how far to move the knees, by the derivative of the column with the knee.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.ident.complete_fit import needs_loads, refit
from ballbar.ident.corrections.gear_softening import GEAR_SOFTENING, gear_softening, knees_of
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.linear_model import LinearModel
from ballbar.ident.estimator.order_search import left_out, of_few
from ballbar.ident.estimator.time_blocks import block_sums
from ballbar.ident.joint_errors import linearised, thinning
from ballbar.ident.options import Listener

KNEES = 16  # tried of each gear
LOWEST, HIGHEST = 0.02, 0.7  # of the gear's largest load
# Of the score test, chi-square with one degree of freedom: above twice the logarithm of the number
# of candidates as in ballbar.ident.joint_errors, more than unlisted ripple of sound gears brings
# (up to 14)
THRESHOLD = 20.0
MOVES = 3  # of the knees, each with a fit
MOVED = 0.02  # relative; less is no move
FURTHEST = 0.4  # relative, of one move
NO_PRIOR = 1.0  # [rad/(N m)] far beyond any gear
# Widths of the backlash's transition up to which a knee is too much like the backlash
APART = 12.0

Knees = list[tuple[int, float]]


def fit_softening(cell: Cell, fit: Fit, listener: Listener) -> Fit:
    """A complete fit with the softer first slopes that the data ask for; the same if with none.

    The same too for a robot whose file states no gears: no slope is known that could be softer.
    """
    if cell.robot.gears is None:
        return fit
    listener.progress("searching gears that are softer below a knee")
    knees = search_knees(fit)
    for _ in range(MOVES if knees else 0):
        listener.progress(f"fitting again with {len(knees)} knees")
        fit = refit(fit, [gear_softening(cell.robot, knees)], listener)
        moved = moved_knees(fit)
        far = max(abs(new / old - 1.0) for (_, new), (_, old) in zip(moved, knees, strict=True))
        if far < MOVED:
            break
        knees = moved
    return fit


def search_knees(fit: Fit) -> Knees:
    """Gear, from 0, and knee [N m] of every softening that the residual shows, the surest first."""
    if not needs_loads(fit.model.corrections):
        return []
    model, load = linearised(fit), _loads(fit)
    limits = [
        (gear, float(knee))
        for gear, largest in enumerate(np.abs(load).max(axis=1))
        for knee in np.geomspace(LOWEST, HIGHEST, KNEES) * largest
        if knee > APART * fit.model.gearing.transition[gear]
    ]
    if not limits:
        return []
    columns = np.stack(
        [-model.joints[gear] * np.clip(load[gear], -knee, knee) for gear, knee in limits]
    )
    residual, rest = _beyond(model, columns)
    knees: Knees = []
    threshold = 2.0 * np.log(len(limits)) + THRESHOLD
    while True:
        tests = _tests(model, rest, residual)
        tests[[gear in dict(knees) for gear, _ in limits]] = 0.0
        best = int(tests.argmax())
        if tests[best] < threshold:
            return knees
        knees.append(limits[best])
        own = rest[best].copy()
        length = float(own @ own)
        residual = residual - own * (own @ residual / length)
        rest = rest - np.outer(rest @ own / length, own)


def moved_knees(fit: Fit) -> Knees:
    """The knees of a fit's softening, moved to where the residual wants them."""
    (correction,) = (c for c in fit.model.corrections if c.name == GEAR_SOFTENING)
    knees = knees_of(c.name for c in correction.coefficients)
    values = dict(zip(fit.model.unknowns.names, fit.x.tolist(), strict=True))
    model, load = linearised(fit), _loads(fit)
    columns = np.stack(
        [
            -model.joints[gear]
            * (values[c.name] * np.sign(load[gear]) * (np.abs(load[gear]) > knee))
            for (gear, knee), c in zip(knees, correction.coefficients, strict=True)
        ]
    )
    residual, rest = _beyond(model, columns)
    size = np.sqrt((rest * rest).sum(axis=1))
    size = np.where(size > 0.0, size, 1.0)  # a knee that no load reaches stays
    steps = -np.linalg.lstsq(rest.T / size, residual, rcond=1e-6)[0] / size
    return [
        (gear, knee * float(1.0 + np.clip(step / knee, -FURTHEST, FURTHEST)))
        for (gear, knee), step in zip(knees, steps, strict=True)
    ]


def _loads(fit: Fit) -> Array:
    """(J, N) [N m] loads of the gears at the samples of `linearised`."""
    parts = []
    for point, _, _ in fit.recorded:
        assert point.state is not None
        parts.append(point.state.loads.gears(point.state.tension)[:, :: thinning(fit)])
    return np.concatenate(parts, axis=1)


def _beyond(model: LinearModel, columns: Array) -> tuple[Array, Array]:
    """The residual (R,), and columns (C, E, N) less what the model's unknowns could do for them,
    as (C, R).
    """
    factor = cho_factor(model.gram() + model.prior_normal)
    taken = model.combined(cho_solve(factor, model.products(columns)).T)
    return model.residual.reshape(-1), (columns - taken).reshape(len(columns), -1)


def _tests(model: LinearModel, rest: Array, residual: Array) -> Array:
    """(C,) squared scores over their variance, that of the scores of blocks of time.

    0 where a gear would have to be stiffer below its knee, as none is. Blocks are few, so the
    variance and the distribution are those of ballbar.ident.estimator.order_search.
    """
    score, information = (
        block_sums(values.reshape(len(rest), *model.residual.shape).sum(axis=1), model.groups)
        for values in (rest * residual, rest * rest)
    )
    each = left_out(score[:, None], information[:, None, None], NO_PRIOR)[:, 0]
    variance = np.maximum((each * each).sum(axis=1), np.finfo(float).tiny)
    softer = np.maximum(-score.sum(axis=1), 0.0)
    return of_few(softer**2 / variance, score.shape[1])
