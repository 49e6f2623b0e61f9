"""Periodic joint errors and wrong ratios of a recorded robot that its file does not list.

Both are found by evidence, and stand against each other.

The complete fit is linearised at its estimate and searched as still poses are
(ballbar.ident.estimator.order_search). Neighbouring samples are autocorrelated: the scores of a
block of time count once. Each search is followed by the complete fit with all orders so far: only
what it has explained lets the noise levels fall and smaller errors show. In the end all are revised
together (ballbar.ident.estimator.order_revision).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.sparse import block_diag, csr_array

from ballbar.cell.descriptions import Cell, Robot
from ballbar.ident.complete_fit import refit
from ballbar.ident.corrections.base import BAR, GEAR
from ballbar.ident.corrections.gear_ratio import GEAR_RATIO, gear_ratio, gears_of
from ballbar.ident.corrections.gear_ripple import harmonic_orders
from ballbar.ident.corrections.joint_harmonics import (
    JOINT_HARMONICS,
    PRIOR,
    joint_harmonics,
    orders_of,
)
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.linear_model import LinearModel, SplineColumns
from ballbar.ident.estimator.normal_equations import jacobian
from ballbar.ident.estimator.order_revision import RevisedOrder, revised_orders
from ballbar.ident.estimator.order_search import (
    ORDERS,
    SLOPE,
    JointOrder,
    OrderSearch,
    peak_orders,
    search_orders,
    whole_orders,
)
from ballbar.ident.estimator.regions import joint_regions
from ballbar.ident.estimator.robust_fit import stacked
from ballbar.ident.estimator.time_blocks import NONE, block_numbers
from ballbar.ident.model_choice import coefficients_of, variance_factor
from ballbar.ident.options import Listener
from ballbar.ident.result import Identification
from ballbar.ident.verdict import Status

SEARCHES = 3  # each followed by a complete fit
REVISIONS = 3  # each followed by a complete fit, at most
SEARCHED = 4000  # samples, evenly taken, that a search needs at most
# As order_search.THRESHOLD; blocks of time are few and differ, so a little more is asked: with 8 a
# second, false order was found beside a true one in logs of a minute.
THRESHOLD = 12.0
MOTOR_TURNS = (1.0, 2.0)  # cycles a turn of the motor that are candidates too
SAME_ORDER = 1e-3  # [cycles a turn]
HIGHEST_REVISED = 2 * ORDERS  # order that may stand in the place of a found one: odd harmonics too


def may_have_joint_errors(result: Identification) -> bool:
    """Whether a complete fit leaves something that joint errors may be.

    Or the robot's file lists none at all. A large one of a single order may pass for noise, which
    then has too much of what all orders together would show.
    """
    gears, status = result.robot.cell.robot.gears, result.verdict.status
    listed = gears is not None and any(gears.harmonics) and result.fit.coloured == 1.0
    passes = status in (Status.GOOD, Status.UNCERTAIN) and not listed
    return passes or status in (Status.SUSPECT, Status.MISFIT)


def fit_joint_errors(
    cell: Cell, fit: Fit, listener: Listener
) -> tuple[Fit, tuple[JointOrder, ...]]:
    """A complete fit with the joint errors that the data ask for; and these, in order of search.

    fit : without joint errors. What it left out was judged beside what they leave over, and is back
    in the fits with them.
    """
    orders: list[JointOrder] = []
    for _ in range(SEARCHES):
        listener.progress("searching joint errors")
        search = search_joint_errors(fit, cell)
        if not search.orders:
            break
        orders += search.orders
        listener.progress(f"fitting again with {len(orders)} joint errors")
        extras = []
        if periodic := [(o.joint, o.order) for o in orders if o.order != SLOPE]:
            extras.append(joint_harmonics(periodic))
        if wrong := [o.joint for o in orders if o.order == SLOPE]:
            extras.append(gear_ratio(cell, (), sorted(wrong)))
        extras += [correction for part in fit.left_out for correction in part.corrections]
        fit = refit(replace(fit, left_out=()), extras, listener)
    return _revised(cell, fit, [o for o in orders if o.order != SLOPE], listener)


def _revised(
    cell: Cell, fit: Fit, orders: Sequence[JointOrder], listener: Listener
) -> tuple[Fit, tuple[JointOrder, ...]]:
    """The fit with joint errors as they stand beside each other, and with orders that may as well
    be theirs.

    A fit that the search has bent with wrong orders shows only when refitted which it can do
    without.
    """
    for _ in range(REVISIONS):
        if not orders:
            break
        pairs = [(o.joint, o.order) for o in orders]
        own = next(c for c in fit.model.corrections if c.name == JOINT_HARMONICS)
        at, rivals = np.r_[coefficients_of(fit, own)], _rivals(cell.robot, pairs)
        model, widening = linearised(fit), variance_factor(fit)
        revised = revised_orders(model, at, fit.x[at], pairs, rivals, widening)
        if not revised:  # what the search has found by regions stands
            break
        every = list(dict.fromkeys(pair for each in revised for pair in each.sizes))
        first = [(orders[r.number], [order for _, order in r.sizes]) for r in revised]
        orders = [replace(o, order=n[0], aliases=tuple(sorted(n[1:]))) for o, n in first]
        if every == orders_of(c.name for c in own.coefficients):
            break
        listener.progress(f"fitting again with {len(revised)} revised joint errors")
        fit = refit(fit, [joint_harmonics(every, _deviations(revised))], listener)
    return fit, tuple(orders)


def _rivals(robot: Robot, pairs: Sequence[tuple[int, float]]) -> list[tuple[int, float]]:
    """Orders of the same joints that may stand in the places of these."""
    known = [*pairs, *((gear, order) for gear, order, _ in harmonic_orders(robot))]
    return [
        (joint, float(order))
        for joint in sorted({joint for joint, _ in pairs})
        for order in range(1, HIGHEST_REVISED + 1)
        if not any(joint == j and abs(order - o) < SAME_ORDER for j, o in known)
    ]


def _deviations(revised: Sequence[RevisedOrder]) -> dict[tuple[int, float], float]:
    """[rad] standard deviations of the amplitudes of orders that share errors: sine and cosine have
    half of the variance each.
    """
    squares: dict[tuple[int, float], float] = {}
    for pair, size in (item for r in revised if len(r.sizes) > 1 for item in r.sizes.items()):
        squares[pair] = squares.get(pair, 0.0) + 0.5 * size**2
    return {pair: float(np.sqrt(square)) for pair, square in squares.items()}


def search_joint_errors(fit: Fit, cell: Cell) -> OrderSearch:
    """Joint errors that a complete fit leaves in its residual, the strongest first."""
    known = [
        pair
        for correction in fit.model.corrections
        for pair in (
            orders_of(c.name for c in correction.coefficients)
            if correction.name == JOINT_HARMONICS
            else [(gear, order) for gear, order, _ in harmonic_orders(cell.robot)]
            if correction.name == "gear_ripple"
            else [(gear, SLOPE) for gear in gears_of(c.name for c in correction.coefficients)]
            if correction.name == GEAR_RATIO
            else ()
        )
    ]
    model, pairs = linearised(fit), candidate_orders(cell.robot, known)
    pairs += peak_orders(model, [*pairs, *known])
    return search_orders(model, PRIOR, pairs, threshold=THRESHOLD)


def candidate_orders(robot: Robot, known: Sequence[tuple[int, float]]) -> list[tuple[int, float]]:
    """Whole orders of every gear's turn, the first of its motor's, and the slope of its ratio.

    Without the known ones.
    """
    pairs = [*whole_orders(robot.joints), *((gear, SLOPE) for gear in range(robot.joints))]
    for gear, ratio in enumerate(1.0 / np.abs(np.diag(robot.transmission))):
        if abs(ratio - 1.0) > SAME_ORDER:
            pairs += [(gear, turns * float(ratio)) for turns in MOTOR_TURNS]
    return [
        (gear, order)
        for gear, order in pairs
        if not any(gear == g and abs(order - o) < SAME_ORDER for g, o in known)
    ]


def thinning(fit: Fit) -> int:
    """Step between the samples of a fit that enter `linearised`."""
    return -(-sum(r.times.size for r in fit.model.recordings) // SEARCHED)


def linearised(fit: Fit) -> LinearModel:
    """A complete fit at its estimate, the samples of all recordings beside each other."""
    model, layout, (normal, gradient) = fit.model, fit.model.unknowns, fit.by_poses
    step, points = thinning(fit), [point for point, _, _ in fit.recorded]
    logged = [np.asarray(p.recording.robot.spline(p.robot_time))[::step] for p in points]
    blocks = [block_numbers(point.recording.times[::step]) for point in points]
    firsts = np.cumsum([0, *(int(block[-1]) + 1 for block in blocks)])
    whitened = [weights(point.columns[GEAR:BAR]) for point, weights, _ in fit.recorded]
    residual = stacked([residual for _, _, residual in fit.recorded])
    columns, slope, begin = np.zeros((layout.count, *residual.shape)), np.zeros_like(residual), 0
    for k, recording in enumerate(model.recordings):
        for block in jacobian(model, fit.linear, k):
            at = slice(begin + block.samples.start, begin + block.samples.stop)
            columns[block.index, : block.values.shape[1], at] = block.values
            slope[: block.values.shape[1], at] = 0.0 if block.slope is None else block.slope
        begin += recording.size
    index = np.concatenate([NONE, *(np.r_[own.knots] for own in layout.own if own.knots)])
    splines = csr_array(block_diag([recording.splines for recording in model.recordings]))
    every = [np.arange(r.size) % step == 0 for r in model.recordings]
    picked: Any = slice(None) if step == 1 else np.flatnonzero(np.concatenate(every))
    return LinearModel(
        jacobian=np.delete(columns, index, axis=0)[..., picked],
        residual=residual[:, picked],
        joints=stacked(whitened)[..., picked],
        angles=np.concatenate([q @ model.gearing.to_gear for q in logged]).T,
        prior_gradient=gradient,
        prior_normal=normal,
        regions=joint_regions(np.concatenate(logged)),
        groups=np.concatenate([k + block for k, block in zip(firsts, blocks, strict=False)]),
        few=True,
        knots=SplineColumns(index, splines[:, picked], slope[:, picked]),
    )
