"""Search for the best path: random candidates, then races of CMA-ES islands while time is left.

CMA-ES (Hansen, arXiv:1604.00772; library `cma`) varies centres, amplitudes, phases and position;
each island keeps the cycles and the rod that it began with. How far an island descends shows only
on the way, so several set out and the better half continues (successive halving; Jamieson &
Talwalkar, arXiv:1502.07943). Processes evaluate the candidates; each builds its evaluators once.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from itertools import count, repeat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import BAR_ROWS
from ballbar.cell.processes import process_pool
from ballbar.planning.candidate import Space, folded, space_of
from ballbar.planning.coarse import objectives, sample
from ballbar.planning.evaluation import INFEASIBLE, Evaluator, evaluators, objective
from ballbar.planning.force import DRAWS as ROBOTS
from ballbar.planning.known import Known
from ballbar.planning.request import PlanRequest

RANDOM_SHARE = 0.2  # of the time, at most, for random candidates
DRAWS = 128  # batches of random candidates: enough for the starts of a race
AHEAD = 16  # batches that are under way at a time, however many processes there are
# Islands of a race: half of them continue after each round, until two are left.
ENTRANTS, FINALISTS = 10, 2
ROUND = 40  # generations
STALLED = 70  # generations without a gain of GAIN end an island
CHUNK = 24  # candidates that a process evaluates at a time, at most; of six, each takes 1.6 times
INCUMBENTS = 24  # the last of them are evaluated in full, with all robots
STEP = 0.01  # of the natural logarithm of the TCP sigma
GAIN = 0.002  # of the natural logarithm of the TCP sigma
SPREAD = 0.08  # first step size of CMA-ES, relative to the range of each number
CYCLES = slice(3 * BAR_ROWS, 4 * BAR_ROWS)  # of a genome

_evaluators: dict[str, Evaluator] = {}  # of a worker process, by rod


@dataclass(frozen=True, eq=False)
class RatedCandidate:
    """One candidate from which islands may begin."""

    rod: str
    genome: Array
    objective: float


@dataclass(eq=False)
class SearchProgress:
    """Progress of a search, updated while it runs."""

    incumbents: list[RatedCandidate] = field(default_factory=list)  # each was the best at its time
    evaluated: int = 0
    feasible: int = 0
    stopped: bool = False

    @property
    def best(self) -> RatedCandidate | None:
        """The last incumbent."""
        return self.incumbents[-1] if self.incumbents else None

    @property
    def least(self) -> float:
        """Objective of the best so far; infinite before there is any."""
        return self.best.objective if self.best else np.inf

    @property
    def tcp(self) -> float:
        """[m] predicted TCP sigma of the best so far."""
        return float(np.exp(self.least)) * 1e-6

    def add(self, candidate: RatedCandidate) -> None:
        """Counts a candidate that can be run, and takes it where it is the best so far."""
        self.feasible += 1
        if self.best is None or candidate.objective < self.best.objective:
            self.incumbents.append(candidate)


def evaluating_processes(
    request: PlanRequest, processes: int, known: Known | None = None
) -> AbstractContextManager[ProcessPoolExecutor]:
    """A pool in which `in_worker` runs; known : from results of the machine."""
    return process_pool(processes, _build, request, known)


def _build(request: PlanRequest, known: Known | None) -> None:
    _evaluators.update(evaluators(request, known))


def in_worker(function: Callable[..., Any], rod: str, *arguments: Any, **options: Any) -> Any:
    """Result of a function of the rod's evaluator, in a worker."""
    return function(_evaluators[rod], *arguments, **options)


def search(
    request: PlanRequest,
    pool: ProcessPoolExecutor,
    *,
    seconds: float,
    evaluations: int,
    first: list[RatedCandidate],
    hints: list[RatedCandidate],
    show: Callable[[SearchProgress], None] = lambda _: None,
) -> SearchProgress:
    """Search with about `evaluations` of CMA-ES, for `seconds` at most; Ctrl-C ends it with the
    best so far.

    Where the time does not end it, the result depends on nothing but the request.

    first : candidates that can be run. hints : further starts of islands, feasible or not.
    """
    since = time.monotonic()
    running = _Search(request, pool, show)
    try:
        starts = running.evaluated(first)
        starts += running.draw(since + RANDOM_SHARE * seconds)
        starts = hints + _distinct_first(sorted(starts, key=lambda s: s.objective))
        running.race(starts, since + seconds, evaluations)
    except KeyboardInterrupt:
        running.progress.stopped = True
    return running.progress


def ranked(incumbents: list[RatedCandidate], pool: ProcessPoolExecutor) -> list[RatedCandidate]:
    """The last INCUMBENTS by their objective over all robots of ballbar.planning.force, best first.

    Those that follow one another differ by STEP or more.
    """
    last = incumbents[-INCUMBENTS:]
    futures = [pool.submit(in_worker, objective, s.rod, s.genome, robots=ROBOTS) for s in last]
    evaluated = [
        replace(start, objective=future.result())
        for start, future in zip(last, futures, strict=True)
    ]
    distinct: list[RatedCandidate] = []
    for start in sorted(evaluated, key=lambda s: s.objective):
        if not distinct or start.objective > distinct[-1].objective + STEP:
            distinct.append(start)
    return distinct


class _Search:
    """A running search."""

    def __init__(
        self,
        request: PlanRequest,
        pool: ProcessPoolExecutor,
        show: Callable[[SearchProgress], None],
    ) -> None:
        self.progress = SearchProgress()
        self._request, self._pool, self._show = request, pool, show

    def evaluated(self, starts: list[RatedCandidate]) -> list[RatedCandidate]:
        """Candidates that can be run, with the objectives that the search compares."""
        futures = [
            self._pool.submit(in_worker, objectives, s.rod, s.genome[None], best=np.inf)
            for s in starts
        ]
        rated = [
            replace(start, objective=float(future.result()[0]))
            for start, future in zip(starts, futures, strict=True)
        ]
        for start in rated:
            self.progress.add(start)
        return rated

    def draw(self, until: float) -> list[RatedCandidate]:
        """The best of DRAWS batches of random candidates, drawn until a monotonic time [s]."""
        starts: list[RatedCandidate] = []
        rods = self._request.cell.rods
        seed = self._request.seed + 1  # the first feasible path was drawn with the seed itself
        for begin in range(0, DRAWS, AHEAD):
            jobs = [(rods[k % len(rods)], seed + k) for k in range(begin, begin + AHEAD)]
            futures = [self._pool.submit(in_worker, sample, rod, seed=k) for rod, k in jobs]
            for (rod, _), future in zip(jobs, futures, strict=True):
                genomes, values, tried = future.result()
                self.progress.evaluated += tried
                starts += map(RatedCandidate, repeat(rod), genomes, values.tolist())
            self._show(self.progress)
            if time.monotonic() > until:
                break
        return starts

    def race(self, starts: list[RatedCandidate], until: float, evaluations: int) -> None:
        """Races of islands until a monotonic time [s] or a number of evaluations.

        Each race takes the next starts and, from the second on, the best so far and its neighbours.
        After each round the worse half of its islands ends.
        """
        progress, space = self.progress, space_of(self._request)
        last = progress.evaluated + evaluations

        def time_left() -> bool:
            return time.monotonic() < until and progress.evaluated < last

        entrants = starts[:ENTRANTS]
        while entrants and time_left():
            seed = self._request.seed + progress.evaluated
            islands = [Island(space, start, seed + k) for k, start in enumerate(entrants)]
            for generation in count(1):
                self._advance(islands)
                self._show(progress)
                if generation % ROUND == 0:
                    islands = sorted(islands, key=lambda island: island.best)
                    islands = islands[: max(FINALISTS, len(islands) // 2)]
                islands = [island for island in islands if not island.done]
                if not islands or not time_left():
                    break
            starts = starts[len(entrants) :]
            entrants = neighbours(space, progress.best) if progress.best else []
            entrants += starts[: ENTRANTS - len(entrants)]

    def _advance(self, islands: list[Island]) -> None:
        """One generation of all islands: those of one rod are evaluated together."""
        progress, best = self.progress, self.progress.least
        of_rods: dict[str, list[Island]] = {}
        for island in islands:
            of_rods.setdefault(island.rod, []).append(island)
        pending = []
        for rod, together in of_rods.items():
            genomes = np.concatenate([island.ask() for island in together])
            chunks = np.array_split(genomes, max(2, -(-len(genomes) // CHUNK)))
            jobs = [self._pool.submit(in_worker, objectives, rod, c, best=best) for c in chunks]
            pending.append((rod, together, chunks, jobs))
        for rod, together, chunks, jobs in pending:
            values = [job.result() for job in jobs]
            for chunk, of_chunk in zip(chunks, values, strict=True):
                progress.evaluated += len(of_chunk)
                # what was evaluated together, the least first, which was looked at closely
                for k in np.argsort(of_chunk, kind="stable"):
                    if of_chunk[k] < INFEASIBLE:
                        progress.add(RatedCandidate(rod, folded(chunk[k]), float(of_chunk[k])))
            ends = np.cumsum([island.size for island in together])
            parts = np.split(np.concatenate(values), ends[:-1])
            for island, of_island in zip(together, parts, strict=True):
                island.tell(of_island)


def _distinct_first(starts: list[RatedCandidate]) -> list[RatedCandidate]:
    """The best start of each set of cycles first, then the others."""
    seen: set[object] = set()
    distinct: list[RatedCandidate] = []
    others: list[RatedCandidate] = []
    for start in starts:
        key = (start.rod, tuple(start.genome[CYCLES].round(1)))
        (others if key in seen else distinct).append(start)
        seen.add(key)
    return distinct + others


def neighbours(space: Space, start: RatedCandidate) -> list[RatedCandidate]:
    """A start, and those that differ from it by one cycle of one angle."""
    step = 1.0 / space.cycles
    starts = [start]
    for k in range(*CYCLES.indices(start.genome.size)):
        for changed in (start.genome[k] - step, start.genome[k] + step):
            if 0.0 < changed < 1.0:
                genome = start.genome.copy()
                genome[k] = changed
                starts.append(replace(start, genome=genome, objective=INFEASIBLE))
    return starts


def evolution(start: Array, *, seed: int) -> Any:
    """A `cma.CMAEvolutionStrategy` that begins at `start` (K,) [-] and prints nothing."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # cma looks for plotting when it is imported
        # imported here, since loading it takes long and only a search needs it
        from cma import CMAEvolutionStrategy  # noqa: PLC0415
    return CMAEvolutionStrategy(start, SPREAD, {"seed": seed + 1, "verbose": -9, "verb_log": 0})


class Island:
    """One run of CMA-ES, from its start until it gains no more."""

    def __init__(self, space: Space, start: RatedCandidate, seed: int) -> None:
        self.rod, self._start = start.rod, start.genome.copy()
        self._free = free_numbers(space)
        self._search = evolution(start.genome[self._free], seed=seed % 2**31)
        self._points: list[Array] = []
        self.size: int = self._search.popsize  # of a generation
        self.best = start.objective
        self._lowest, self._stalled = np.inf, 0  # since the start; generations without a gain

    def ask(self) -> Array:
        """(size, S) genomes of the next generation."""
        self._points = self._search.ask()
        genomes = np.tile(self._start, (self.size, 1))
        genomes[:, self._free] = self._points
        return genomes

    def tell(self, values: Array) -> None:
        """Take over the objectives (size,) of the generation."""
        self._search.tell(self._points, values.tolist())
        least = float(values.min())
        self._stalled = 0 if least < self._lowest - GAIN else self._stalled + 1
        self._lowest = min(self._lowest, least)
        self.best = min(self.best, self._lowest)

    @property
    def done(self) -> bool:
        """Whether the island gains no more."""
        return self._stalled >= STALLED or bool(self._search.stop())


def free_numbers(space: Space) -> NDArray[np.intp]:
    """(K,) indices that an island varies: all but the cycles and a fixed position."""
    position = 4 * BAR_ROWS + np.flatnonzero(space.upper > space.lower)
    return np.concatenate((np.arange(3 * BAR_ROWS), position)).astype(np.intp)
