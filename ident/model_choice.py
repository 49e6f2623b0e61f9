"""Which corrections a complete fit keeps.

What a robot's file describes stays unless its coefficients are zero as far as the data can tell.
What few machines need enters only if a fit with it better explains blocks of time that it was not
made from (ballbar.ident.estimator.time_blocks): a residual can be white while the model is wrong,
and what a missing term leaves over passes for support of another.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.corrections import CORRECTIONS, ON_EVIDENCE, SUBSTITUTES, belongs_to_machine
from ballbar.ident.corrections.base import Correction
from ballbar.ident.corrections.gear_ratio import GEAR_RATIO
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.left_out import LeftOut, left_out
from ballbar.ident.estimator.step_faults import ENCODER_JUMPS
from ballbar.ident.estimator.time_blocks import NONE, time_blocks
from ballbar.ident.estimator.uncertainty import mean_autocorrelation
from ballbar.ident.least_sizes import not_by_chance

# Decrease of the held-out cost, in units of chi-square per degree of freedom, that a term must
# bring: one that the machine does not need brings -170 to 20 (notes/identification sec. 7).
DECREASE = 30.0
# Error of a gear's ratio that is one, and in standard deviations. Over a part of a turn an error of
# a joint with few cycles a turn looks like one: 1e-4 rad of the third order like 3e-4. On sound
# machines such a term came to 3.7e-4 and brought twice the TCP error; another count of teeth is
# 1e-3 or more.
RATIO, RATIO_SIGMAS = 6e-4, 5.0
# Autocorrelation of the complete model's residual (docs/validation, incomplete models): 0.2 to 0.5
# where nothing is missing (friction), 0.5 to 0.6 without a good plate's bending, 0.7 to 0.9 without
# ripple, encoder harmonics, backlash or compliance.
AUTOCORRELATED, AUTOCORRELATED_MISFIT = 0.6, 0.7
# A compliance or play is negative beyond so many deviations, and so much of its prior's: a rigid
# gear may come out a little on either side.
NEGATIVE, NOTHING = 2.0, 0.15


def needed_corrections(fit: Fit, tried: Sequence[Correction]) -> list[Correction]:
    """Corrections out of `tried` that the prediction of held-out time needs, in their order.

    The best of them joins, until none brings enough.
    """
    blocks, needed = time_blocks(fit), set[str]()
    places = {c.name: np.r_[coefficients_of(fit, c)] for c in tried}
    possible = [c.name for c in tried if c.name != GEAR_RATIO or _wrong_ratio(fit, c)]
    limit = DECREASE * max(1.0, fit.chi2_per_dof)

    def cost(names: set[str]) -> float:
        absent = [place for name, place in places.items() if name not in names]
        return blocks.held_out_cost(np.concatenate([NONE, *absent]))

    least = cost(needed)
    while costs := {name: cost({*needed, name}) for name in possible if name not in needed}:
        best = min(costs, key=costs.__getitem__)
        if least - costs[best] < limit:
            break
        least = costs[best]
        needed.add(best)
    return [c for c in tried if c.name in needed]


def _wrong_ratio(fit: Fit, ratios: Correction) -> bool:
    """Whether the ratio of some gear is off by more than slow errors of a sound joint look like."""
    place = coefficients_of(fit, ratios)
    sigma = np.sqrt(max(1.0, fit.chi2_per_dof) * np.diag(fit.covariance)[place])
    return bool((np.abs(fit.x[place]) > np.maximum(RATIO, RATIO_SIGMAS * sigma)).any())


def unsupported(result: Fit) -> set[str]:
    """Names of corrections whose coefficients are all zero as far as the data can tell.

    Neighbours with autocorrelation a leave `(1 - a) / (1 + a)` of the samples (Bartlett 1946). What
    may well be absent, with a mean of 0, is not supported where a compliance of it came out
    negative: it then stands for something else, and the robot is worse with it. Negative values are
    no support of it, nor of what is typical of robots and no file describes. Beside something
    systematic that no term has, nothing is seen to be absent: left out, it would be 0 for sure.
    """
    widening, out = variance_factor(result), set()
    negative = negative_coefficients(result, np.sqrt(widening * np.diag(result.covariance)))
    for correction in present(result):
        if mean_autocorrelation(result) > AUTOCORRELATED and correction.name not in ON_EVIDENCE:
            continue
        position = coefficients_of(result, correction)
        values, white = result.x[position].copy(), result.covariance[position, position]
        typical = correction.name in SUBSTITUTES
        absent = [c.never_negative and (typical or not c.mean) for c in correction.coefficients]
        values[absent] = np.maximum(values[absent], 0.0)
        impossible = any(c.name in negative and c.mean == 0.0 for c in correction.coefficients)
        if impossible or not not_by_chance(values, widening * white):
            out.add(correction.name)
    return out


def variance_factor(result: Fit) -> float:
    """Factor on variances of white noise, for the residual's size and its correlation in time."""
    correlation = min(0.9, max(0.0, mean_autocorrelation(result)))
    return result.chi2_per_dof * (1.0 + correlation) / (1.0 - correlation)


def candidates_left_out(result: Fit, idle: Collection[str]) -> tuple[LeftOut, ...]:
    """Corrections that a fit leaves out now and before, with the shifts that they may make.

    result : with the corrections of the names `idle`.
    """
    layout = result.model.unknowns
    gone = [
        c
        for c in present(result)
        if c.name in idle and c.name in CORRECTIONS and c.name not in ON_EVIDENCE
    ]
    if not gone:
        return result.left_out
    places = np.concatenate([np.r_[coefficients_of(result, c)] for c in gone])
    widening = variance_factor(result)
    part = left_out(layout.names, result.x, result.covariance, places, widening)
    return (*result.left_out, replace(part, corrections=tuple(gone)))


def negative_coefficients(result: Fit, sigma: Array) -> tuple[str, ...]:
    """Compliances and plays that came out negative beyond their uncertainty.

    sigma : (P,) standard deviations of the unknowns.
    """
    coefficients = [c for correction in result.model.corrections for c in correction.coefficients]
    first = result.model.unknowns.coefficients.start
    return tuple(
        c.name
        for i, c in enumerate(coefficients, first)
        if c.never_negative and result.x[i] < -max(NEGATIVE * sigma[i], NOTHING * c.sigma)
    )


def present(result: Fit) -> list[Correction]:
    """The corrections of a fit, encoder slips left out."""
    return [c for c in result.model.corrections if c.name != ENCODER_JUMPS]


def lasting(result: Fit) -> list[Correction]:
    """The corrections that belong to the machine: encoder slips belong to a recording."""
    return [c for c in result.model.corrections if belongs_to_machine(c)]


def coefficients_of(result: Fit, correction: Correction) -> slice:
    """Where a correction's coefficients stand in x. Raises KeyError if the fit has no such one."""
    first = result.model.unknowns.coefficients.start
    for other in result.model.corrections:
        count = len(other.coefficients)
        if other.name == correction.name:
            return slice(first, first + count)
        first += count
    raise KeyError(correction.name)
