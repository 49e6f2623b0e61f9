"""Processes that evaluate candidates; each builds its evaluators once."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager

from cell.arrays import Array
from cell.processes import process_pool
from planning.evaluation import SEARCH_ROBOTS, Evaluator, evaluators, objective
from planning.known import Known
from planning.request import PlanRequest
from planning.sample import Samples, sample

_evaluators: dict[str, Evaluator] = {}


def evaluating_processes(
    request: PlanRequest, count: int, known: Known | None = None
) -> AbstractContextManager[ProcessPoolExecutor]:
    """A pool for `worker_objective` and `worker_sample`; known : as of `evaluators`."""
    return process_pool(count, _build, request, known)


def worker_objective(rod: str, genome: Array, robots: int = SEARCH_ROBOTS) -> float:
    """`planning.evaluation.objective` of a genome (S,) [-] in a worker."""
    return objective(_evaluators[rod], genome, robots=robots)


def worker_sample(rod: str, seed: int, seconds: float) -> Samples:
    """`planning.sample.sample` in a worker."""
    return sample(_evaluators[rod], seed=seed, seconds=seconds)


def _build(request: PlanRequest, known: Known | None) -> None:
    _evaluators.update(evaluators(request, known))
