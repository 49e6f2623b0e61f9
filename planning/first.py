"""The first path that can be run: the random candidate that violates least, led by CMA-ES to where nothing is violated."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from cell.arrays import Array
from cell.errors import InputError
from planning.candidate import Space, folded, space_of
from planning.evolution import evolution
from planning.judge import Judge, checked
from planning.sample import BATCH, OFF, VIOLATES, figure
from planning.screen import screen, tally
from planning.search import Start, free_numbers

SECONDS = 30.0  # a request for which nothing is found in this time most likely allows nothing
BATCHES = 8  # screened for one descent
GENERATIONS = 20  # of one descent
SHOWN = 3  # limits that the nearest miss violates, worst first


def first_path(given: dict[str, Judge], *, seconds: float = SECONDS) -> tuple[Start, int]:
    """A candidate that can be run, and how many were tried.

    given : judges by rod. Raises InputError that says what stands in the way.
    """
    since, tried, rods = time.monotonic(), 0, list(given)
    rng = np.random.default_rng(next(iter(given.values())).request.seed)
    reasons: Counter[str] = Counter()
    near = (np.inf, "")
    while time.monotonic() - since < seconds:
        rod = rods[tried // (BATCH * BATCHES) % len(rods)]
        judge, space = given[rod], space_of(given[rod].request)
        z = rng.random((BATCH * BATCHES, space.size))
        screened = screen(judge.cell, space, judge.limits, z)
        tried += len(z)
        reasons.update(screened.reason[screened.excess > 0.0].tolist())
        best, least = descent(
            judge, space, z[int(screened.excess.argmin())], int(rng.integers(2**31))
        )
        if least < VIOLATES:
            return Start(rod, best, least), tried
        if least < min(near[0], OFF):
            near = (
                least,
                "; ".join(
                    v.sentence for v in checked(judge, space.candidate(best)).violations[:SHOWN]
                ),
            )
    miss = f" The nearest miss (limits with their reserve): {near[1]}." if near[1] else ""
    raise InputError(
        f"no path found: {tried} random paths and descents from the best of them failed, the random ones by: {tally(reasons)}.{miss} "
        "Move the ball-bar (cell.ballbar_region_m), take another rod, or widen the limit that stands in the way."
    )


def descent(judge: Judge, space: Space, z: Array, seed: int) -> tuple[Array, float]:
    """The first candidate that violates nothing, or the one that violates least, and its figure."""
    free = free_numbers(space)
    search = evolution(z[free], seed=seed)
    best, least = z, figure(judge, z)
    for _ in range(GENERATIONS):
        asked, figures = search.ask(), []
        for x in asked:
            whole = z.copy()
            whole[free] = x
            figures.append(figure(judge, whole))
            if figures[-1] < least:
                best, least = folded(whole), figures[-1]
            if least < VIOLATES:
                return best, least
        search.tell(asked, figures)
    return best, least
