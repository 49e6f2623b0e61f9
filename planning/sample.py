"""Random candidates: uniform draws from the search space, those of them that can be run."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from cell.arrays import Array
from planning.candidate import space_of
from planning.evaluation import SEARCH_ROBOTS, Evaluator, evaluate
from planning.screen import screen

BATCH = 128  # candidates screened at a time


@dataclass(eq=False)
class Samples:
    """Random candidates that can be run, and the reasons against the others."""

    genomes: list[Array] = field(default_factory=list)
    tcp: list[float] = field(default_factory=list)  # [m]
    reasons: Counter[str] = field(default_factory=Counter)
    nearest: tuple[float, str] = (np.inf, "")  # least violation of the others, and its sentence
    tried: int = 0


def sample(evaluator: Evaluator, *, seed: int, seconds: float, count: int | None = None) -> Samples:
    """Uniform draws from the search space for `seconds`, or until `count` of them can be run."""
    space, rng = space_of(evaluator.request), np.random.default_rng(seed)
    out, since = Samples(), time.monotonic()
    while time.monotonic() - since < seconds:
        genomes = rng.random((BATCH, space.size))
        screened = screen(evaluator.cell, evaluator.request.cell, space, evaluator.limits, genomes)
        out.tried += BATCH
        out.reasons.update(screened.reason[screened.excess > 0.0].tolist())
        for genome in genomes[screened.excess <= 0.0]:
            outcome = evaluate(evaluator, space.candidate(genome), robots=SEARCH_ROBOTS)
            if outcome.violations:
                worst = outcome.violations[0]
                out.reasons[worst.limit] += 1
                if outcome.excess < out.nearest[0]:
                    out.nearest = (outcome.excess, worst.sentence)
                continue
            out.genomes.append(genome)
            out.tcp.append(outcome.tcp)
            if count is not None and len(out.genomes) >= count:
                return out
            if time.monotonic() - since > seconds:
                break
    return out
