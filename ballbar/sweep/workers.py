"""Who computes the parts: processes of this machine, or the workers of a Dask cluster. Both give the same rows."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial

from ballbar.sweep.part import Job, Row, run_part, run_part_elsewhere
from ballbar.sweep.version import DISTRIBUTION
from cell.errors import InputError
from cell.threads import one_thread_each

CONNECT_TIMEOUT = 10.0  # [s] for a Dask scheduler to answer
COUNT_PERIOD = 1.0  # [s] between two looks at how many Dask workers there are


@dataclass(frozen=True, eq=False)
class Workers:
    """Something that computes the parts of one sweep."""

    submit: Callable[[int], Future[list[Row]]]
    count: Callable[[], int]  # parts it computes at the same time; may change


@contextmanager
def processes(job: Job, *, count: int) -> Iterator[Workers]:
    """Worker processes on this machine, for one sweep; see `process_pool`."""
    with process_pool(count) as computing, computing(job) as workers:
        yield workers


@contextmanager
def process_pool(count: int) -> Iterator[Callable[[Job], AbstractContextManager[Workers]]]:
    """Worker processes on this machine, for one sweep after the other: to start them takes as long as some dozens of short runs.

    They end with this process, even if it is killed; an exception kills them.
    """
    others = set(multiprocessing.active_children())
    with one_thread_each():
        pool = ProcessPoolExecutor(
            count, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_driver
        )

        def submit(job: Job, part: int) -> Future[list[Row]]:
            try:
                with _stop_signals_held():  # the pool starts its processes here
                    return pool.submit(run_part, job.text, part, job.work, job.top)
            except BrokenProcessPool as error:  # told like every other part's, when it is collected
                broken: Future[list[Row]] = Future()
                broken.set_exception(error)
                return broken

        try:
            yield lambda job: nullcontext(Workers(partial(submit, job), lambda: count))
        except BaseException:
            for process in set(multiprocessing.active_children()) - others:
                process.kill()  # not `terminate`, which they do not hear
            raise
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def dask_cluster(job: Job, *, address: str) -> Iterator[Workers]:
    """The workers of a Dask scheduler, such as `tcp://10.0.0.5:8786`.

    Raises InputError when Dask is not installed or no scheduler answers.
    """
    try:
        from distributed import Client  # noqa: PLC0415  an extra, and slow to import
    except ImportError:
        raise InputError(f"--scheduler needs Dask: pip install '{DISTRIBUTION}[dask]'") from None
    try:
        client = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers there ({error}). Start one with `dask scheduler`."
        ) from None
    with client:
        executor = client.get_executor(pure=False)
        # A task of its own: sent once to each worker, and again to one that comes later.
        files = client.submit(tuple, job.files, pure=False)
        yield Workers(
            lambda part: executor.submit(run_part_elsewhere, job.text, part, job.work, files),
            _refreshed(lambda: sum(client.nthreads().values())),
        )


def _refreshed(look: Callable[[], int]) -> Callable[[], int]:
    """The last answer of `look`, at most COUNT_PERIOD old."""
    seen = (-COUNT_PERIOD, 0)

    def answer() -> int:
        nonlocal seen
        if time.monotonic() - seen[0] > COUNT_PERIOD:
            seen = (time.monotonic(), look())
        return seen[1]

    return answer


def _end_with_driver() -> None:
    """In a worker: leave when the driver is gone (kill -9), or the worker would wait for its next part for ever."""

    def on_iteration() -> None:
        driver = multiprocessing.parent_process()
        if driver is not None:
            driver.join()
            os._exit(1)

    threading.Thread(target=on_iteration, daemon=True).start()


@contextmanager
def _stop_signals_held() -> Iterator[None]:
    """Processes started within never see Ctrl-C, nor the SIGTERM of a batch system.

    Both go to all processes at once; the driver hears them and lets its workers finish their part.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
