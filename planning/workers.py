"""Processes that evaluate candidates.

Each builds its evaluators once, computes with one thread, and leaves Ctrl-C to the process that
started it.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.process import BaseProcess

from cell.arrays import Array
from cell.threads import one_thread_each
from planning.evaluation import SEARCH_ROBOTS, Evaluator, evaluators, objective
from planning.request import PlanRequest
from planning.sample import Samples, sample

_evaluators: dict[str, Evaluator] = {}


@contextmanager
def evaluating_processes(request: PlanRequest, count: int) -> Iterator[ProcessPoolExecutor]:
    """A pool for `worker_objective` and `worker_sample`, whose processes end with this one."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin, initargs=(request,))
    with one_thread_each():
        try:
            yield pool
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def worker_objective(rod: str, genome: Array, robots: int = SEARCH_ROBOTS) -> float:
    """`planning.evaluation.objective` of a genome (S,) [-] in a worker."""
    return objective(_evaluators[rod], genome, robots=robots)


def worker_sample(rod: str, seed: int, seconds: float) -> Samples:
    """`planning.sample.sample` in a worker."""
    return sample(_evaluators[rod], seed=seed, seconds=seconds)


def _begin(request: PlanRequest) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _evaluators.update(evaluators(request))
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_with, args=(parent,), daemon=True).start()


def _exit_with(parent: BaseProcess) -> None:
    """End this process when its parent is gone, even if that was killed."""
    parent.join()
    os._exit(1)
