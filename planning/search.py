"""The search for the best path: random candidates first, then races of CMA-ES islands from the best of them, until time is up.

CMA-ES (Hansen, arXiv:1604.00772; library `cma`) moves swings, middles, phases and place; each island keeps the cycles and the rod that
it began with. Where an island will end shows only on the way, so several set out and the better half goes on (successive halving;
Jamieson and Talwalkar, arXiv:1502.07943).
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.geometry import BAR_ROWS
from planning.candidate import Space, folded, space_of
from planning.evolution import evolution
from planning.force import DRAWS
from planning.request import PlanRequest
from planning.sample import VIOLATES, Sampled
from planning.workers import figure_there, sampled_there

SLICE = 1.5  # [s] of random candidates between two looks at the clock
RANDOM_SHARE = 0.15  # of the time goes into random candidates, at most
STARTS = 80  # random candidates that can be run are enough
ENTRANTS, FINALISTS = (
    8,
    2,
)  # islands of a race: half of them go on after each round, until two are left
ROUND = 12  # generations
STALLED = 25  # generations without a gain of GAIN end an island
LEADERS = 24  # the last of them are weighed with all robots
STEP = 0.01  # of the natural logarithm of the TCP sigma
GAIN = 0.003  # of the natural logarithm of the TCP sigma


@dataclass(frozen=True, eq=False)
class Start:
    """One candidate that can be run."""

    rod: str
    z: Array
    figure: float


@dataclass(eq=False)
class Progress:
    """How far a search is. Lives as long as the search."""

    leaders: list[Start] = field(default_factory=list)  # each was the best when it was found
    evaluated: int = 0
    feasible: int = 0
    reasons: Counter[str] = field(default_factory=Counter)
    nearest: tuple[float, str] = (np.inf, "")
    stopped: bool = False

    @property
    def best(self) -> Start | None:
        """The last of the leaders."""
        return self.leaders[-1] if self.leaders else None

    @property
    def tcp(self) -> float:
        """[m] of the best so far."""
        return float(np.exp(self.best.figure)) * 1e-6 if self.best else np.inf

    def add(self, one: Start) -> None:
        self.feasible += 1
        if self.best is None or one.figure < self.best.figure:
            self.leaders.append(one)


def search(
    request: PlanRequest,
    pool: ProcessPoolExecutor,
    *,
    workers: int,
    seconds: float,
    evaluations: int,
    first: list[Start],
    hints: list[Start],
    show: Callable[[Progress], None] = lambda _: None,
) -> Progress:
    """The best candidate found within `seconds` and about `evaluations` of CMA-ES; Ctrl-C ends the search and keeps the best so far.

    first : candidates that are known to be runnable. hints : where else islands may begin, runnable or not.
    """
    progress, since = Progress(), time.monotonic()
    starts = list(first)
    for start in first:
        progress.add(start)
    rods = (request.cell.ballbar, *request.cell.ballbar_choices)
    try:
        starts += _random(
            request, pool, rods, workers, since + RANDOM_SHARE * seconds, progress, show
        )
        starts = hints + _apart(sorted(starts, key=lambda s: s.figure))
        _races(request, pool, since + seconds, evaluations, starts, progress, show)
    except KeyboardInterrupt:
        progress.stopped = True
    return progress


def ranked(leaders: list[Start], pool: ProcessPoolExecutor) -> list[Start]:
    """The last LEADERS by what they do over all robots of planning.force, best first; those that follow differ by STEP or more."""
    figures = [pool.submit(figure_there, one.rod, one.z, DRAWS) for one in leaders[-LEADERS:]]
    weighed = [
        replace(one, figure=future.result())
        for one, future in zip(leaders[-LEADERS:], figures, strict=True)
    ]
    apart: list[Start] = []
    for one in sorted(weighed, key=lambda one: one.figure):
        if not apart or one.figure > apart[-1].figure + STEP:
            apart.append(one)
    return apart


def _random(
    request: PlanRequest,
    pool: ProcessPoolExecutor,
    rods: tuple[str, ...],
    workers: int,
    until: float,
    progress: Progress,
    show: Callable[[Progress], None],
) -> list[Start]:
    starts: list[Start] = []
    seed = request.seed + 1  # the first feasible path was drawn with the seed itself
    while time.monotonic() < until and len(starts) < STARTS:
        jobs = [(rods[(seed + k) % len(rods)], seed + k) for k in range(workers)]
        futures = [pool.submit(sampled_there, rod, s, SLICE) for rod, s in jobs]
        seed += workers
        for (rod, _), future in zip(jobs, futures, strict=True):
            found: Sampled = future.result()
            progress.evaluated += found.tried
            progress.reasons += found.reasons
            progress.nearest = min(progress.nearest, found.nearest)
            for z, tcp in zip(found.z, found.tcp, strict=True):
                starts.append(Start(rod, z, float(np.log(tcp * 1e6))))
                progress.add(starts[-1])
        show(progress)
    return starts


def _races(
    request: PlanRequest,
    pool: ProcessPoolExecutor,
    until: float,
    evaluations: int,
    starts: list[Start],
    progress: Progress,
    show: Callable[[Progress], None],
) -> None:
    """Race after race: the next starts, and from the second race on the best so far; after each round the worse half is left behind."""
    space, last = space_of(request), progress.evaluated + evaluations

    def going() -> bool:
        return time.monotonic() < until and progress.evaluated < last

    entrants = starts[:ENTRANTS]
    while entrants and going():
        islands = [
            Island(space, start, request.seed + progress.evaluated + k)
            for k, start in enumerate(entrants)
        ]
        for generation in count(1):
            asked = [island.ask(pool) for island in islands]
            for island, figures in zip(islands, asked, strict=True):
                island.tell([future.result() for future in figures], progress)
            show(progress)
            if generation % ROUND == 0:
                islands = sorted(islands, key=lambda island: island.best)[
                    : max(FINALISTS, len(islands) // 2)
                ]
            islands = [island for island in islands if not island.done]
            if not islands or not going():
                break
        starts = starts[ENTRANTS:]
        entrants = [*([progress.best] if progress.best else []), *starts[: ENTRANTS - 1]]


def _apart(starts: list[Start]) -> list[Start]:
    """The best start of each set of cycles first, then the others."""
    seen: set[object] = set()
    one: list[Start] = []
    more: list[Start] = []
    for start in starts:
        key = (start.rod, tuple(start.z[CYCLES].round(1)))
        (more if key in seen else one).append(start)
        seen.add(key)
    return one + more


CYCLES = slice(3 * BAR_ROWS, 4 * BAR_ROWS)


class Island:
    """One CMA-ES run; lives from its start until it gains no more."""

    def __init__(self, space: Space, start: Start, seed: int) -> None:
        self.rod, self._whole = start.rod, start.z.copy()
        self._free = free_numbers(space)
        self._search = evolution(start.z[self._free], seed=seed % 2**31)
        self._asked: list[Array] = []
        self.best = start.figure
        self._stands, self._since = (
            np.inf,
            0,
        )  # the best since it set out, and for how many generations

    def ask(self, pool: ProcessPoolExecutor) -> list[Future[float]]:
        """One generation, on its way to the workers."""
        self._asked = self._search.ask()
        return [pool.submit(figure_there, self.rod, self._full(x)) for x in self._asked]

    def tell(self, figures: list[float], progress: Progress) -> None:
        """What the generation came to."""
        self._search.tell(self._asked, figures)
        progress.evaluated += len(figures)
        for x, figure in zip(self._asked, figures, strict=True):
            if figure < VIOLATES:
                progress.add(Start(self.rod, folded(self._full(x)), figure))
        gained = min(figures) < self._stands - GAIN
        self._since = 0 if gained else self._since + 1
        self._stands = min(self._stands, *figures)
        self.best = min(self.best, self._stands)

    @property
    def done(self) -> bool:
        return self._since >= STALLED or bool(self._search.stop())

    def _full(self, x: Array) -> Array:
        whole = self._whole.copy()
        whole[self._free] = x
        return whole


def free_numbers(space: Space) -> NDArray[np.intp]:
    """Numbers that an island moves: all but the cycles, and the place where it is given."""
    place = 4 * BAR_ROWS + np.flatnonzero(space.upper > space.lower)
    return np.concatenate((np.arange(3 * BAR_ROWS), place)).astype(np.intp)
