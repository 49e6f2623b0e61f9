"""The search itself, on an objective whose least value is known: a paraboloid of the genome."""

from __future__ import annotations

import time
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.planning import search as searching
from ballbar.planning.candidate import Space, space_of
from ballbar.planning.evaluation import INFEASIBLE
from ballbar.planning.request import PlanRequest, load_request
from ballbar.planning.search import (
    CYCLES,
    GAIN,
    INCUMBENTS,
    STALLED,
    STEP,
    Island,
    RatedCandidate,
    SearchProgress,
    _distinct_first,
    ranked,
    search,
)

SCENARIOS = Path(__file__).parents[2] / "scenarios"
CENTRE = 0.35  # of every number that an island varies


@pytest.fixture(scope="module")
def requested() -> PlanRequest:
    loaded = load_request(SCENARIOS / "plans" / "irb2400.yaml")
    assert isinstance(loaded, PlanRequest)
    return loaded


@pytest.fixture(scope="module")
def space(requested: PlanRequest) -> Space:
    return space_of(requested)


def paraboloid(genomes: Array) -> Array:
    """(N,) 0 at the centre; genomes near the edge of the first number cannot be run."""
    free = np.concatenate([genomes[:, :15], genomes[:, 20:]], axis=1)
    values = ((free - CENTRE) ** 2).sum(axis=1)
    return np.where(genomes[:, 0] < 0.05, INFEASIBLE + 1.0, values)


class Pool:
    """Computes what is submitted at once, by the paraboloid."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def submit(self, _in_worker: Any, function: Any, _rod: str, *given: Any, **options: Any) -> Any:
        future: Future[Any] = Future()
        if function is searching.sample:
            genomes = np.random.default_rng(options["seed"]).random((16, 23))
            values = paraboloid(genomes)
            keep = values < INFEASIBLE
            future.set_result((genomes[keep], values[keep], 16))
        elif function is searching.objectives:
            self.asked.append(len(given[0]))
            future.set_result(paraboloid(given[0]))
        else:
            future.set_result(float(paraboloid(given[0][None])[0]))
        return future


def start(value: float, space: Space) -> RatedCandidate:
    genome = np.full(space.size, value)
    return RatedCandidate("lund_600", genome, float(paraboloid(genome[None])[0]))


def test_a_search_descends_to_the_least_value_and_counts_what_it_tried(
    requested: PlanRequest, space: Space
) -> None:
    pool: Any = Pool()
    shown = list[float]()
    first = start(0.8, space)
    found = search(
        requested, pool, seconds=60.0, evaluations=4000, first=[first], hints=[],
        show=lambda progress: shown.append(progress.least),
    )  # fmt: skip
    assert found.best is not None
    assert found.best.objective < 0.02 < first.objective
    assert shown == sorted(shown, reverse=True)
    drawn = 16 * searching.DRAWS
    assert sum(pool.asked) == found.evaluated - drawn + 1
    assert 4000 <= found.evaluated - drawn < 4000 + 200
    objectives = [one.objective for one in found.incumbents]
    assert objectives == sorted(objectives, reverse=True)
    assert found.feasible > len(objectives)
    assert not found.stopped
    assert found.tcp == pytest.approx(1e-6 * np.exp(found.best.objective))
    assert ((found.best.genome >= 0.0) & (found.best.genome <= 1.0)).all()


def test_a_search_without_time_keeps_the_best_of_what_was_drawn(
    requested: PlanRequest, space: Space
) -> None:
    pool: Any = Pool()
    found = search(
        requested, pool, seconds=-1.0, evaluations=99, first=[start(0.8, space)], hints=[]
    )
    assert found.evaluated == 16 * searching.AHEAD
    assert found.best is not None
    assert found.best.objective == start(0.8, space).objective, "draws are starts, no results"

    def interrupt(_progress: SearchProgress) -> None:
        raise KeyboardInterrupt

    stopped = search(
        requested, pool, seconds=60.0, evaluations=99, first=[start(0.8, space)], hints=[],
        show=interrupt,
    )  # fmt: skip
    assert stopped.stopped
    assert stopped.best is not None


def test_an_island_ends_where_it_gains_no_more(space: Space) -> None:
    island = Island(space, start(0.5, space), seed=3)
    assert island.best == start(0.5, space).objective
    genomes = island.ask()
    assert genomes.shape == (island.size, space.size)
    assert (genomes[:, CYCLES] == 0.5).all(), "cycles stay"
    assert np.ptp(genomes[:, 0]) > 0.0
    rng = np.random.default_rng(5)
    for k in range(1 + STALLED):
        assert not island.done, k
        least = 1.0 - 0.9 * GAIN * rng.random() * (k > 0)
        island.tell(np.concatenate([[least], rng.uniform(2.0, 9.0, island.size - 1)]))
        island.ask()
    assert island.done
    assert island.best == start(0.5, space).objective


def test_a_gain_lets_an_island_go_on(space: Space) -> None:
    island = Island(space, start(0.5, space), seed=3)
    for k in range(STALLED + 20):
        points = island.ask()
        island.tell(paraboloid(points) + 10.0 - 2.0 * GAIN * k)
    assert not island.done
    assert island._stalled < 10


def test_progress_keeps_each_candidate_that_was_the_best_at_its_time(space: Space) -> None:
    progress = SearchProgress()
    assert (progress.best, progress.least) == (None, np.inf)
    for value in (3.0, 4.0, 2.0, 2.0, 1.0):
        progress.add(RatedCandidate("lund_600", np.zeros(3), value))
    assert [one.objective for one in progress.incumbents] == [3.0, 2.0, 1.0]
    assert (progress.feasible, progress.least) == (5, 1.0)


def test_the_last_incumbents_are_ranked_where_they_differ(space: Space) -> None:
    pool: Any = Pool()
    values = np.linspace(0.9, 0.5, INCUMBENTS + 10)
    incumbents = [start(value, space) for value in values.tolist()]
    incumbents.append(start(0.5 + 1e-4, space))
    found = ranked(incumbents, pool)
    objectives = [one.objective for one in found]
    assert objectives == sorted(objectives)
    assert (np.diff(objectives) > STEP).all()
    last = [one.objective for one in incumbents[-INCUMBENTS:]]
    assert objectives[0] == min(last)
    assert max(objectives) <= max(last) + 1e-12
    assert len(found) < INCUMBENTS


def test_starts_of_each_set_of_cycles_come_first(space: Space) -> None:
    starts = []
    for value, cycles in ((1.0, 0.3), (2.0, 0.3), (3.0, 0.72), (4.0, 0.68)):
        genome = np.zeros(space.size)
        genome[CYCLES] = cycles
        starts.append(RatedCandidate("lund_600", genome, value))
    starts.append(RatedCandidate("lund_900", starts[0].genome, 5.0))
    assert [s.objective for s in _distinct_first(starts)] == [1.0, 3.0, 5.0, 2.0, 4.0]


def test_the_time_ends_a_race(requested: PlanRequest, space: Space) -> None:
    pool: Any = Pool()
    begun = time.monotonic()
    search(requested, pool, seconds=0.3, evaluations=10**9, first=[start(0.8, space)], hints=[])
    assert time.monotonic() - begun < 20.0
