"""Conformity of the TCP error with a tolerance by a named decision rule.

The TCP error of a robot is known as a distribution: draws of what the identification leaves
uncertain, added to the distance between the robot's model and the identified one (JCGM 101:2008).
The measured value is the mean of the draws, its coverage interval holds the probability of k
standard deviations of a normal distribution, and the conformity probability is the share of draws
within the tolerance (JCGM 106:2012).

A guard band is r times the half width of that interval on the side of the limit, so that acceptance
is wrong with at most the probability beyond k standard deviations where r = 1: 2.3 % for k = 2
(ISO 14253-1, JCGM 106:2012).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, sqrt
from typing import Literal, get_args

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.result import RobotEstimate
from ballbar.ident.robot.accuracy import aligned

RuleName = Literal["simple", "guarded", "probability"]
RULES: tuple[RuleName, ...] = get_args(RuleName)
Conformity = Literal["conforms", "does not conform", "neither"]
DRAWS = 4000  # 90 of them beyond two standard deviations on either side
_SEED = 14253  # the draws are part of the method: a certificate is recomputed with the same


@dataclass(frozen=True)
class Rule:
    """A decision rule."""

    name: RuleName
    coverage_factor: float = 2.0  # k of the coverage interval
    guard_factor: float = 1.0  # r of `guarded`
    probability: float = 0.95  # of `probability`

    @property
    def risk(self) -> float:
        """Largest probability that an acceptance is wrong, for a normal distribution and any r."""
        if self.name == "probability":
            return 1.0 - self.probability
        factor = self.guard_factor * self.coverage_factor if self.name == "guarded" else 0.0
        return _above(factor)


@dataclass(frozen=True)
class Decision:
    """A measured value against a tolerance [m]."""

    value: float
    sigma: float
    lower: float  # ends of the coverage interval
    upper: float
    probability: float  # that the true value is within the tolerance
    verdict: Conformity


def decide(draws: Array, tolerance: float, rule: Rule) -> Decision:
    """The decision about a quantity of which (D,) draws [m] are given, which may not exceed a
    tolerance [m].
    """
    value, tail = float(draws.mean()), _above(rule.coverage_factor)
    lower, upper = (float(q) for q in np.quantile(draws, [tail, 1.0 - tail]))
    probability = float((draws <= tolerance).mean())
    verdict: Conformity = "neither"
    if rule.name == "probability":
        accepted = probability >= rule.probability
        rejected = probability <= 1.0 - rule.probability
    else:
        guard = rule.guard_factor if rule.name == "guarded" else 0.0
        accepted = value + guard * (upper - value) <= tolerance
        rejected = value - guard * (value - lower) > tolerance
    if accepted or rejected:
        verdict = "conforms" if accepted else "does not conform"
    return Decision(value, float(draws.std()), lower, upper, probability, verdict)


def coverage(rule: Rule) -> float:
    """Probability of the coverage interval."""
    return 1.0 - 2.0 * _above(rule.coverage_factor)


def _above(factor: float) -> float:
    """Probability of a normal variable above so many standard deviations."""
    return 0.5 * (1.0 - erf(factor / sqrt(2.0)))


@dataclass(frozen=True, eq=False)
class ErrorDraws:
    """Draws of the TCP error over the workspace, base aligned: mean and largest of each draw."""

    mean: Array  # (D,) [m]
    largest: Array  # (D,) [m]


def error_draws(robot: RobotEstimate, grid: Array) -> dict[str, ErrorDraws]:
    """Draws of the error of the nominal and of the identified robot at poses grid (G, J) [rad]."""
    model = robot.identified
    predicted, actual = model.rigid(robot.nominal).tool(grid), model.tool(grid)
    apart = aligned(predicted, actual, scale=False) - actual
    errors = model.error_draws(grid, DRAWS, np.random.default_rng(_SEED))
    return {
        name: _statistics(errors + shift)
        for name, shift in (("nominal", apart), ("identified", np.zeros(3)))
    }


def _statistics(errors: Array) -> ErrorDraws:
    """errors : (D, G, 3) [m]."""
    sizes = np.sqrt(np.einsum("dgc,dgc->dg", errors, errors))
    return ErrorDraws(sizes.mean(axis=1), sizes.max(axis=1))
