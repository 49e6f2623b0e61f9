"""Processes that evaluate candidates; each builds its evaluators once."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager

from cell.arrays import Array
from cell.processes import process_pool
from planning.coarse import objectives, sample
from planning.evaluation import SEARCH_ROBOTS, Evaluator, evaluators, objective
from planning.known import Known
from planning.request import PlanRequest

_evaluators: dict[str, Evaluator] = {}


def evaluating_processes(
    request: PlanRequest, count: int, known: Known | None = None
) -> AbstractContextManager[ProcessPoolExecutor]:
    """A pool for the functions below; known : as of `evaluators`."""
    return process_pool(count, _build, request, known)


def worker_objective(rod: str, genome: Array, robots: int = SEARCH_ROBOTS) -> float:
    """`planning.evaluation.objective` of a genome (S,) [-] in a worker."""
    return objective(_evaluators[rod], genome, robots=robots)


def worker_objectives(rod: str, genomes: Array, best: float) -> Array:
    """`planning.coarse.objectives` of genomes (M, S) [-] in a worker."""
    return objectives(_evaluators[rod], genomes, best=best)


def worker_sample(rod: str, seed: int) -> tuple[Array, Array, int]:
    """`planning.coarse.sample` in a worker."""
    return sample(_evaluators[rod], seed=seed)


def _build(request: PlanRequest, known: Known | None) -> None:
    _evaluators.update(evaluators(request, known))
