"""The first path that can be run: CMA-ES from the random candidate that violates least."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from cell.arrays import Array
from cell.errors import InputError
from planning.candidate import Space, folded
from planning.coarse import BATCH
from planning.evaluation import INFEASIBLE, SCREENED_OUT, Evaluator, check, objective
from planning.screen import screen, tally
from planning.search import RatedCandidate, evolution, free_numbers

SECONDS = 30.0  # a request for which nothing is found in this time most likely allows nothing
BATCHES = 8  # screened for one descent
GENERATIONS = 20  # of one descent
# Screened candidates that are tried before one, without the force that excludes most of them: those
# that are farthest from the limits move least and identify least.
TRIED = 32
SHOWN = 3  # limits that the nearest miss violates, worst first


def first_path(
    given: dict[str, Evaluator], *, seconds: float = SECONDS
) -> tuple[RatedCandidate, int]:
    """A candidate that can be run, and the number of candidates tried.

    given : evaluators by rod. Raises InputError that says which limits stand in the way.
    """
    since, tried, rods = time.monotonic(), 0, list(given)
    rng = np.random.default_rng(next(iter(given.values())).request.seed)
    reasons: Counter[str] = Counter()
    nearest = (np.inf, "")
    while time.monotonic() - since < seconds:
        rod = rods[tried // (BATCH * BATCHES) % len(rods)]
        evaluator, space = given[rod], given[rod].space
        genomes = rng.random((BATCH * BATCHES, space.size))
        screened = screen(evaluator.cell, evaluator.request.cell, space, evaluator.limits, genomes)
        tried += len(genomes)
        reasons.update(screened.reason[screened.excess > 0.0].tolist())
        start = genomes[int(screened.excess.argmin())]
        if evaluator.force_model is None:
            passed = genomes[screened.excess <= 0.0][:TRIED]
            values = [objective(evaluator, genome) for genome in passed]
            if values:
                start = passed[int(np.argmin(values))]
                if min(values) < INFEASIBLE:
                    return RatedCandidate(rod, start, min(values)), tried
        genome, least = descent(evaluator, space, start, int(rng.integers(2**31)))
        if least < INFEASIBLE:
            return RatedCandidate(rod, genome, least), tried
        if least < min(nearest[0], SCREENED_OUT):
            violated = check(evaluator, space.candidate(genome)).violations[:SHOWN]
            nearest = (least, "; ".join(v.sentence for v in violated))
    miss = f" The nearest miss (limits with their reserve): {nearest[1]}." if nearest[1] else ""
    raise InputError(
        f"no path found: {tried} random paths and descents from the best of them failed, "
        f"the random ones by: {tally(reasons)}.{miss} "
        "Move the ball-bar (cell.ballbar_region_m), take another rod, or widen the limit that "
        "stands in the way."
    )


def descent(evaluator: Evaluator, space: Space, start: Array, seed: int) -> tuple[Array, float]:
    """The first genome (S,) [-] that violates nothing, or the one that violates least.

    start : (S,) [-] genome. Returns the genome and its objective.
    """
    free = free_numbers(space)
    search = evolution(start[free], seed=seed)
    best, least = start, objective(evaluator, start)
    for _ in range(GENERATIONS):
        points, values = search.ask(), []
        for x in points:
            genome = start.copy()
            genome[free] = x
            values.append(objective(evaluator, genome))
            if values[-1] < least:
                best, least = folded(genome), values[-1]
            if least < INFEASIBLE:
                return best, least
        search.tell(points, values)
    return best, least
