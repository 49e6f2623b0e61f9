"""Runs a sweep: the parts that are missing go to the workers, each is kept as it comes back, then the table is written.

Interrupted at any point, the same command goes on from the parts that are there and ends in the same bytes.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from ballbar.sweep.check import LoadedSweep, check_points
from ballbar.sweep.folder import SweepFolder, open_folder
from ballbar.sweep.part import Job, Row, Work
from ballbar.sweep.plan import Plan
from ballbar.sweep.workers import Workers
from cell.errors import FailureError, InputError

POLL = 0.2  # [s] between two looks for an interrupt while no part comes back

Progress = Callable[[int, str], None]  # runs done, what is going on


class SweepError(FailureError):
    """The sweep could not go on, through no fault of its runs; what is done is kept."""


@dataclass(frozen=True)
class Outcome:
    """What a sweep came to."""

    folder: SweepFolder
    kept: int  # runs that were done before
    done: int  # runs that are done now, those included

    @property
    def finished(self) -> bool:
        return self.folder.complete


def run_sweep(
    sweep: LoadedSweep,
    path: Path,
    work: Work,
    workers: Callable[[Job], AbstractContextManager[Workers]],
    *,
    progress: Progress,
) -> Outcome:
    """Computes what is missing in the folder `path` and writes the table.

    work : the figures of one run; importable where the workers are. After Ctrl-C the outcome is not `finished`: the parts
    under way were finished and kept; after a second Ctrl-C they were dropped.
    Raises InputError when a point is wrong or the folder holds something else, SweepError when workers die.
    """
    plan = sweep.plan
    if not SweepFolder(path, plan).checked:
        check_points(sweep)
    with open_folder(path, plan) as folder:
        if folder.complete:
            return Outcome(folder, plan.runs, plan.runs)
        folder.start(sweep.files)
        job = Job(plan.text, work, sweep.files, folder.files)
        missing = folder.missing()
        kept = plan.runs - _runs_of(plan, missing)
        try:
            if missing:
                with workers(job) as those, _asked_to_stop() as asked:
                    _compute(folder, missing, those, asked=asked, progress=progress)
            missing = folder.missing()
            if not missing:
                progress(plan.runs, "writing the table")
                folder.finish()
        except KeyboardInterrupt:
            missing = folder.missing()
        return Outcome(folder, kept, plan.runs - _runs_of(plan, missing))


def _compute(
    folder: SweepFolder,
    missing: list[int],
    workers: Workers,
    *,
    asked: Callable[[], bool],
    progress: Progress,
) -> None:
    """Keeps every part that comes back. A few more are under way than there are workers, so that none waits for the next."""
    plan = folder.plan
    done = plan.runs - _runs_of(plan, missing)
    ahead = iter(missing)
    under_way: dict[Future[list[Row]], int] = {}
    failure: SweepError | InputError | None = None
    while True:
        stopping = asked() or failure is not None
        room = 0 if stopping else workers.count() + workers.count() // 4 + 1 - len(under_way)
        for _, part in zip(range(room), ahead, strict=False):  # in this order, or zip drops a part
            under_way[workers.submit(part)] = part
        progress(done, _stage(workers, stopping=stopping))
        if not under_way:
            break
        for future in wait(under_way, timeout=POLL, return_when=FIRST_COMPLETED).done:
            part = under_way.pop(future)
            try:
                folder.keep(part, _rows(future, plan.part(part)))
                done += len(plan.part(part))
            except (SweepError, InputError) as error:
                failure = failure or error
    if failure is not None:
        raise failure


def _rows(future: Future[list[Row]], runs: range) -> list[Row]:
    """The rows that a worker computed. Raises InputError of the worker, SweepError when it could not."""
    where = f"runs {runs[0]} to {runs[-1]}"
    try:
        return future.result()
    except InputError:
        raise
    except BrokenProcessPool:
        raise SweepError(
            f"a worker process died, {where} were under way. Is there enough memory? Fewer --workers need less."
        ) from None
    except CancelledError:
        raise SweepError(f"{where}: given up by the scheduler.") from None
    except Exception as error:
        raise SweepError(f"{where}: {type(error).__name__}: {error}") from error


def _stage(workers: Workers, *, stopping: bool) -> str:
    if stopping:
        return "stopping when the runs under way are done; Ctrl-C again drops them"
    return "running" if workers.count() else "waiting for workers"


def _runs_of(plan: Plan, parts: list[int]) -> int:
    return sum(len(plan.part(part)) for part in parts)


@contextmanager
def _asked_to_stop() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C (or the end of a batch job, SIGTERM) has come; the second time raises KeyboardInterrupt."""
    stop = threading.Event()

    def note(*_: object) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    if (
        threading.current_thread() is not threading.main_thread()
    ):  # only the main thread hears signals
        yield stop.is_set
        return
    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
