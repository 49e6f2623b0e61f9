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
from math import erfc, sqrt
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ballbar.cell.arrays import Array
from ballbar.cell.schema import Positive, Strict
from ballbar.ident.result import RobotEstimate
from ballbar.ident.robot.accuracy import aligned

DRAWS = 4000  # 90 of them beyond two standard deviations on either side
_SEED = 14253  # the draws are part of the method: a certificate is recomputed with the same


class Tolerance(Strict):
    """Limits of the TCP error, and the rule that decides about them."""

    mean_mm: Positive | None = None
    largest_mm: Positive | None = None
    rule: Literal["simple", "guarded", "probability"] = "guarded"
    guard_factor: Annotated[float, Field(ge=0.0, le=5.0)] = 1.0
    """r of `guarded`, in half widths of the coverage interval."""
    coverage_factor: Annotated[float, Field(gt=0.0, le=3.0)] = 2.0
    probability: Annotated[float, Field(gt=0.5, lt=1.0)] = 0.95
    """Least conformity probability of `probability`."""

    @property
    def coverage(self) -> float:
        """Probability of the coverage interval."""
        return 1.0 - 2.0 * _above(self.coverage_factor)

    @property
    def risk(self) -> float:
        """Largest probability that an acceptance is wrong; of r below 1 for a normal error."""
        if self.rule == "probability":
            return 1.0 - self.probability
        return _above(self.guard_factor * self.coverage_factor if self.rule == "guarded" else 0.0)


@dataclass(frozen=True)
class Decision:
    """A measured value [m] with its coverage interval, and how it stands to a tolerance."""

    value: float
    sigma: float
    lower: float
    upper: float
    probability: float  # that the true value is within the tolerance
    verdict: str  # conforms, does not conform, neither


def decide(draws: Array, limit: float, rule: Tolerance) -> Decision:
    """The decision about a quantity of which (D,) draws [m] are given, and its limit [m]."""
    value, tail = float(draws.mean()), _above(rule.coverage_factor)
    lower, upper = (float(q) for q in np.quantile(draws, [tail, 1.0 - tail]))
    probability = float((draws <= limit).mean())
    guard = rule.guard_factor if rule.rule == "guarded" else 0.0
    accepted = value + guard * (upper - value) <= limit
    rejected = value - guard * (value - lower) > limit
    if rule.rule == "probability":
        accepted, rejected = probability >= rule.probability, probability <= 1 - rule.probability
    verdict = "conforms" if accepted else "does not conform" if rejected else "neither"
    return Decision(value, float(draws.std()), lower, upper, probability, verdict)


def _above(factor: float) -> float:
    """Probability of a normal variable above so many standard deviations."""
    return 0.5 * erfc(factor / sqrt(2.0))


def error_draws(robot: RobotEstimate) -> tuple[Array, dict[tuple[str, str], Array]]:
    """(G, 3) [m] tool at the poses of what is stated, and (D,) [m] draws of mean and largest TCP
    error over them.

    Keys are `nominal` or `identified`, of which robot, and `mean` or `largest`.
    """
    model = robot.identified
    grid, errors = model.error_draws(DRAWS, np.random.default_rng(_SEED))
    predicted, actual = model.rigid(robot.nominal).tool(grid), model.tool(grid)
    apart = aligned(predicted, actual, scale=False) - actual
    draws = {}
    for name, shift in (("nominal", apart), ("identified", np.zeros(3))):
        sizes = np.linalg.norm(errors + shift, axis=2)
        draws[name, "mean"], draws[name, "largest"] = sizes.mean(axis=1), sizes.max(axis=1)
    return actual, draws
