"""A study of 100 000 robots: the driver as it is, the workers of a cluster simulated.

    python -m benchmarks.sweep_cluster            # some minutes of one core
    python -m benchmarks.sweep_cluster 10000      # of so many robots

The driver is `ballbar.sweep.run.run_sweep` itself: it submits, waits, keeps chunks and writes the
table on this disk, and its processor time is what it costs. Behind it stands a scheduler with a
clock of its own: workers that take the time of a real run (measured here: the MuJoCo plant with
every error source, files and complete fit) for each robot, and that are lost, with the chunk in
their hands, once in LIFE hours on average; a new one takes the place after RETURN. Writes
docs/studies/sweep_cluster.csv.
"""

from __future__ import annotations

import heapq
import resource
import sys
import time
from collections import deque
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple
from unittest import mock

import numpy as np
import pyarrow.parquet as pq

from ballbar.cell.arrays import Array
from ballbar.cell.threads import one_thread_each
from ballbar.scenario import load_scenario
from ballbar.sim.streams import stream
from ballbar.sweep.chunk import Row, Task, run_chunk
from ballbar.sweep.run import Workers, run_sweep
from ballbar.trial.trial import run_trial
from benchmarks.study import STUDIES, in_words, write_table
from benchmarks.sweep_speed import SCENARIOS, alone, nothing, sweep_of

ROBOTS = 100_000
CORES = (16, 64, 256)
MEASURED = 6  # real runs from which the time of a run is drawn
LIFE = 8.0 * 3600.0  # [s] mean life of a worker, as of a machine that may be recalled
RETURN = 120.0  # [s] until another takes its place
TRANSFER = 0.05  # [s] for a chunk there and back


class Waited(NamedTuple):
    """Futures that are done, and the others, by the names of `concurrent.futures.wait`."""

    done: set[Future[list[Row]]]
    not_done: set[Future[list[Row]]]


Chunk = tuple[Sequence[int], Future[list[Row]]]


@dataclass(eq=False)
class Cluster:
    """Workers and their scheduler, in a time of its own that runs on while the driver waits."""

    cores: int
    seconds: Array  # of measured runs
    rng: np.random.Generator
    task: Task
    now: float = 0.0  # [s]
    driver: float = 0.0  # [s] of processor time
    lost: int = 0
    queue: deque[Chunk] = field(default_factory=deque)
    events: list[tuple[float, int, bool, Chunk | None]] = field(default_factory=list)
    numbers: int = 0
    free: int = field(init=False)
    since: float = field(init=False)  # processor time at which the driver went on

    def __post_init__(self) -> None:
        self.free, self.since = self.cores, time.process_time()

    def submit(self, runs: Sequence[int]) -> Future[list[Row]]:
        """The rows of a chunk, some time."""
        future: Future[list[Row]] = Future()
        self.queue.append((runs, future))
        return future

    def wait(self, submitted: Collection[Future[list[Row]]], **_: object) -> Waited:
        """Waits as `concurrent.futures.wait` does, in the cluster's time."""
        spent = time.process_time() - self.since
        self.driver += spent
        self.now += spent
        self._give()
        while not any(future.done() for future in submitted):
            self._next()
        self.since = time.process_time()
        done = {future for future in submitted if future.done()}
        return Waited(done, set(submitted) - done)

    def _give(self) -> None:
        """Every free worker gets a chunk, and with it its own end if that comes first."""
        while self.free and self.queue:
            chunk = self.queue.popleft()
            self.free -= 1
            seconds = TRANSFER + float(self.rng.choice(self.seconds, len(chunk[0])).sum())
            life = float(self.rng.exponential(LIFE))
            self._at(min(seconds, life), chunk, done=seconds <= life)

    def _at(self, delay: float, chunk: Chunk | None, *, done: bool) -> None:
        heapq.heappush(self.events, (self.now + delay, self.numbers, done, chunk))
        self.numbers += 1

    def _next(self) -> None:
        """Lets the next event happen: a chunk returns, a worker is lost, or a new one comes."""
        at, _, done, chunk = heapq.heappop(self.events)
        self.now = max(self.now, at)  # the driver may have worked beyond it
        if done:
            self.free += 1
        if chunk is not None and done:
            runs, future = chunk
            future.set_result(run_chunk(self.task.text, runs, self.task.trial, self.task.top))
        elif chunk is not None:
            self.lost += 1
            self.queue.appendleft(chunk)
            self._at(RETURN, None, done=True)  # a new worker
        self._give()


def measured_seconds() -> Array:
    """[s] of processor time of real runs with everything on, fits included; the first warms up."""
    scenario = load_scenario(SCENARIOS / "irb2400_full.yaml")
    times = []
    for seed in range(MEASURED + 1):
        begin = time.process_time()
        run_trial(scenario.model_copy(update={"seed": seed}), SCENARIOS)
        times.append(time.process_time() - begin)
    return np.array(times[1:])


def study(robots: int, cores: int, seconds: Array) -> dict[str, float]:
    """One row of the table."""
    made: list[Cluster] = []

    @contextmanager
    def workers(task: Task) -> Iterator[Workers]:
        cluster = Cluster(cores, seconds, stream(cores, "cluster"), task)
        made.append(cluster)
        with mock.patch("ballbar.sweep.run.wait", cluster.wait):
            yield Workers(cluster.submit, lambda: cores)

    with TemporaryDirectory() as top:
        outcome = run_sweep(
            sweep_of(Path(top), robots),
            Path(top) / "out",
            nothing,
            workers,
            progress=lambda *_: None,
        )
        (cluster,) = made
        assert outcome.finished
        assert pq.read_metadata(outcome.folder.table).num_rows == robots
    return {
        "robots": robots,
        "cores": cores,
        "run_s": float(np.median(seconds)),
        "hours": cluster.now / 3600.0,
        "of_ideal": robots * float(seconds.mean()) / cores / cluster.now,
        "workers_lost": cluster.lost,
        "driver_busy": cluster.driver / cluster.now,
        "driver_ms_a_run": cluster.driver / robots * 1e3,
        "driver_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


@one_thread_each()
def main() -> None:
    """Prints and writes the table."""
    robots = int(sys.argv[1]) if len(sys.argv) > 1 else ROBOTS
    seconds = alone(measured_seconds)
    rows = [alone(partial(study, robots, cores, seconds)) for cores in CORES]
    rows.insert(0, alone(partial(study, robots // 10, CORES[1], seconds)))  # for the memory
    for row in rows:
        print(in_words(row))
    write_table(STUDIES / "sweep_cluster.csv", rows, ".4g")


if __name__ == "__main__":
    main()
