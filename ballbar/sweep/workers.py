"""Workers that compute the chunks: processes of this machine, or the workers of a Dask cluster.

Both return the same rows.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial

from ballbar.code_version import DISTRIBUTION
from ballbar.sweep.chunk import Row, Task, run_chunk, run_chunk_remotely
from cell.errors import InputError
from cell.processes import process_pool as processes_of
from cell.processes import stop_signals_blocked

CONNECT_TIMEOUT = 10.0  # [s] for a Dask scheduler to answer
COUNT_PERIOD = 1.0  # [s] between two looks at how many Dask workers there are


@dataclass(frozen=True, eq=False)
class Workers:
    """Something that computes the chunks of one sweep."""

    submit: Callable[[Sequence[int]], Future[list[Row]]]  # numbers of runs of a chunk -> rows
    count: Callable[[], int]  # chunks computed at the same time; may change


@contextmanager
def processes(task: Task, *, count: int) -> Iterator[Workers]:
    """`count` worker processes on this machine, for one sweep; see `process_pool`."""
    with process_pool(count) as workers_of, workers_of(task) as workers:
        yield workers


@contextmanager
def process_pool(count: int) -> Iterator[Callable[[Task], AbstractContextManager[Workers]]]:
    """`count` worker processes on this machine, for one sweep after the other.

    Their start takes as long as some dozens of short runs.
    """
    with processes_of(count, _ready) as pool:

        def submit(task: Task, runs: Sequence[int]) -> Future[list[Row]]:
            try:
                with stop_signals_blocked():  # a pool may start its processes in `submit`
                    return pool.submit(run_chunk, task.text, runs, task.trial, task.top)
            except BrokenProcessPool as error:  # reported when the chunk's result is collected
                broken: Future[list[Row]] = Future()
                broken.set_exception(error)
                return broken

        yield lambda task: nullcontext(Workers(partial(submit, task), lambda: count))


def _ready() -> None:
    """A worker needs nothing beforehand."""


@contextmanager
def dask_cluster(task: Task, *, address: str) -> Iterator[Workers]:
    """The workers of a Dask scheduler, such as `tcp://10.0.0.5:8786`.

    Raises InputError when Dask is not installed or no scheduler answers.
    """
    try:
        from distributed import Client  # noqa: PLC0415  an extra, and slow to import
    except ImportError:
        raise InputError(
            f"--scheduler {address} needs Dask, which is not installed: "
            f"pip install '{DISTRIBUTION}[dask]'."
        ) from None
    try:
        client = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers there ({error}). Start one with "
            "`dask scheduler`."
        ) from None
    with client:
        executor = client.get_executor(pure=False)
        # A task of its own: sent once to each worker, also to one that joins later.
        files = client.submit(tuple, task.files, pure=False)
        yield Workers(
            lambda runs: executor.submit(run_chunk_remotely, task.text, runs, task.trial, files),
            _refreshed(lambda: sum(client.nthreads().values())),
        )


def _refreshed(look: Callable[[], int]) -> Callable[[], int]:
    """`look`, with its last result again while that is at most COUNT_PERIOD old."""
    since, count = -COUNT_PERIOD, 0

    def latest() -> int:
        nonlocal since, count
        if time.monotonic() - since > COUNT_PERIOD:
            since, count = time.monotonic(), look()
        return count

    return latest
