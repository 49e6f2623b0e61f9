"""Processes that judge candidates: each builds its judges once, computes with one thread, and leaves Ctrl-C to the one who asked."""

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
from planning.judge import Judge, judges
from planning.request import PlanRequest
from planning.sample import SEARCHED, Sampled, figure, sampled

_judges: dict[str, Judge] = {}


@contextmanager
def judging_processes(request: PlanRequest, count: int) -> Iterator[ProcessPoolExecutor]:
    """A pool for `figure_there` and `sampled_there`. Its processes end with this one."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin, initargs=(request,))
    with one_thread_each():
        try:
            yield pool
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def figure_there(rod: str, z: Array, robots: int = SEARCHED) -> float:
    """`planning.sample.figure` in a worker."""
    return figure(_judges[rod], z, robots=robots)


def sampled_there(rod: str, seed: int, seconds: float) -> Sampled:
    """`planning.sample.sampled` in a worker."""
    return sampled(_judges[rod], seed=seed, seconds=seconds)


def _begin(request: PlanRequest) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _judges.update(judges(request))
    asked = multiprocessing.parent_process()
    if asked is not None:
        threading.Thread(target=_leave_with, args=(asked,), daemon=True).start()


def _leave_with(asked: BaseProcess) -> None:
    """Ends this process when the one that asked is gone, were it killed."""
    asked.join()
    os._exit(1)
