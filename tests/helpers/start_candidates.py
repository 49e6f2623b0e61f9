"""Fitted hypotheses of a start without their fits: clock, base, cost and overlap as one likes."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from ballbar.cell.clock import Clock
from ballbar.cell.geometry import Geometry
from ballbar.ident.start.automatic import Candidate, Hypothesis
from tests.helpers.synthetic_recording import NOMINAL


@dataclass(frozen=True, eq=False)
class Fitted:
    """The part of a fit that the choice among hypotheses looks at."""

    offset: float
    cost_per_residual: float
    ox: float = 0.7

    @property
    def linear(self) -> SimpleNamespace:
        return SimpleNamespace(cost=100.0 * self.cost_per_residual, equations=130, x=np.zeros(30))

    def clock(self) -> Clock:
        return Clock(self.offset, 0.0)

    def geometry(self) -> Geometry:
        return NOMINAL.replaced({"ox": self.ox})


def candidate(
    offset: float,
    cost: float = 1.0,
    overlap: float = 60.0,
    ox: float = 0.7,
    directions: tuple[int, ...] = (1, 1),
) -> Candidate:
    """A candidate with a clock offset [s], cost per residual, overlap [s] and base position [m]."""
    hypothesis = Hypothesis(Clock(offset, 0.0), directions, NOMINAL, 1.0)
    return Candidate(hypothesis, Fitted(offset, cost, ox), overlap)
