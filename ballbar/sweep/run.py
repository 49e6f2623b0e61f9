"""Runs a sweep: missing chunks go to the workers and are kept as they return; then the table.

Interrupted at any point, the same command goes on from the chunks that are done and ends in the
same bytes. Workers are processes of this machine, or those of a Dask cluster; both return the same
rows.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ballbar.cell.errors import FailureError, InputError, imports_for
from ballbar.cell.processes import on_stop_signals, stop_signals_blocked
from ballbar.cell.processes import process_pool as processes_of
from ballbar.code_version import DISTRIBUTION
from ballbar.sweep.check import LoadedSweep, check_points
from ballbar.sweep.chunk import Row, Task, Trial, run_chunk, run_chunk_remotely
from ballbar.sweep.folder import SweepFolder, open_folder

POLL = 0.2  # [s] between two looks for an interrupt while no chunk returns
if TYPE_CHECKING:  # an extra, and slow to import
    from distributed import Client

_AGAIN = "Run the same command again to go on."
CONNECT_TIMEOUT = 10.0  # [s] for a Dask scheduler to answer
COUNT_PERIOD = 1.0  # [s] between two looks at how many Dask workers there are

Progress = Callable[[int, str], None]  # (runs done, stage)


class SweepError(FailureError):
    """The sweep could not go on, through no fault of its runs; the chunks that are done remain."""


@dataclass(frozen=True, eq=False)
class Workers:
    """Something that computes the chunks of one sweep."""

    submit: Callable[[Sequence[int]], Future[list[Row]]]  # numbers of runs of a chunk -> rows
    count: Callable[[], int]  # chunks computed at the same time; may change


@dataclass(frozen=True)
class SweepOutcome:
    """State of a sweep after `run_sweep`."""

    folder: SweepFolder
    resumed: int  # runs that were done before
    done: int  # runs that are done, those included

    @property
    def finished(self) -> bool:
        return self.folder.complete


def run_sweep(
    sweep: LoadedSweep,
    path: Path,
    trial: Trial,
    workers: Callable[[Task], AbstractContextManager[Workers]],
    *,
    progress: Progress,
) -> SweepOutcome:
    """Computes the chunks that are missing in the folder `path`, and writes the table.

    trial : the results of one run; importable on the workers. After Ctrl-C the outcome is not
    `finished`: the chunks in progress were completed and kept; after a second Ctrl-C they were
    dropped.

    Raises InputError when a point is wrong or the folder holds something else, SweepError when
    workers die.
    """
    plan = sweep.plan
    if not SweepFolder(path, plan).checked:
        check_points(sweep)
    with open_folder(path, plan) as folder:
        if folder.complete:
            return SweepOutcome(folder, plan.runs, plan.runs)
        folder.start(sweep.files)
        missing = folder.missing_runs()
        resumed = plan.runs - _count(missing)
        try:
            for chunk in [chunk for chunk, runs in missing.items() if not runs]:
                folder.keep(chunk, [])
            if _count(missing):
                task = Task(plan.text, trial, sweep.files, folder.files)
                with workers(task) as pool, _stop_requests() as stop_requested:
                    _compute(folder, missing, pool, stop_requested, progress)
            missing = folder.missing_runs()
            if not missing:
                progress(plan.runs, "writing the table")
                folder.finish()
        except KeyboardInterrupt:
            missing = folder.missing_runs()
        return SweepOutcome(folder, resumed, plan.runs - _count(missing))


def _compute(
    folder: SweepFolder,
    missing: Mapping[int, Sequence[int]],
    workers: Workers,
    stop_requested: Callable[[], bool],
    progress: Progress,
) -> None:
    """Computes and keeps missing runs until all are done, a stop is requested, or a chunk fails.

    missing : chunk -> its runs that are missing, none where the folder has them all.
    Somewhat more chunks are submitted than there are workers, so that no worker waits for the next.
    """
    plan = folder.plan
    done = plan.runs - _count(missing)
    queue = iter([chunk for chunk, runs in missing.items() if runs])
    submitted: dict[Future[list[Row]], int] = {}
    failure: SweepError | InputError | None = None
    while True:
        stopping = stop_requested() or failure is not None
        room = 0 if stopping else workers.count() + workers.count() // 4 + 1 - len(submitted)
        for _, chunk in zip(range(room), queue, strict=False):  # in this order, or zip drops one
            submitted[workers.submit(missing[chunk])] = chunk
        stage = "running" if workers.count() else "waiting for workers"
        if stopping:
            stage = "stopping when the runs in progress are done; Ctrl-C again drops them"
        progress(done, stage)
        if not submitted:
            break
        for future in wait(submitted, timeout=POLL, return_when=FIRST_COMPLETED).done:
            chunk = submitted.pop(future)
            try:
                folder.keep(chunk, _rows(future, missing[chunk]))
                done += len(missing[chunk])
            except (SweepError, InputError) as error:
                failure = failure or error
    if failure is not None:
        raise failure


def _rows(future: Future[list[Row]], runs: Sequence[int]) -> list[Row]:
    """The rows that a worker computed.

    Raises InputError as the worker did, SweepError when the worker or its connection failed.
    """
    chunk = f"runs {runs[0]} to {runs[-1]}"
    try:
        return future.result()
    except InputError:
        raise
    except BrokenProcessPool:
        raise SweepError(
            f"a worker process died while it computed {chunk}. Is there enough memory? Fewer "
            "--workers need less; the same command goes on."
        ) from None
    except CancelledError:
        raise SweepError(f"{chunk}: cancelled by the scheduler. {_AGAIN}") from None
    except Exception as error:
        raise SweepError(f"{chunk}: {type(error).__name__}: {error}. {_AGAIN}") from error


def _count(missing: Mapping[int, Sequence[int]]) -> int:
    return sum(map(len, missing.values()))


@contextmanager
def _stop_requests() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C or SIGTERM has come; the second one raises KeyboardInterrupt."""
    stop = threading.Event()

    def note() -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    in_main = threading.current_thread() is threading.main_thread()  # which alone receives signals
    with on_stop_signals(note) if in_main else nullcontext():
        yield stop.is_set


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


def _dask_client(address: str) -> Client:
    with imports_for(f"--scheduler {address}", f"{DISTRIBUTION}[dask]"):
        from distributed import Client  # noqa: PLC0415
    try:
        return Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers there ({error}). Start one with "
            "`dask scheduler`."
        ) from None


@contextmanager
def dask_cluster(task: Task, *, address: str) -> Iterator[Workers]:
    """The workers of a Dask scheduler, such as `tcp://10.0.0.5:8786`.

    Raises InputError when Dask is not installed or no scheduler answers.
    """
    with _dask_client(address) as client:
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
