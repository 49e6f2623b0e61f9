"""The cost of a sweep in addition to its runs, and how it scales.

    python -m benchmarks.sweep_speed [speed|plant|overhead|memory|dask|million]...    # or all

Ratios of times measured side by side; where other work on the machine would show, of processor
times. Absolute times vary with the machine.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import numpy as np
import pyarrow.parquet as pq

from ballbar.cell.threads import one_thread_each
from ballbar.scenario import Scenario, load_scenario
from ballbar.sweep.check import LoadedSweep, load_sweep
from ballbar.sweep.chunk import Task, Trial
from ballbar.sweep.file import SEED
from ballbar.sweep.plan import run_of
from ballbar.sweep.run import Workers, dask_cluster, processes, run_sweep
from ballbar.sweep.table import failures_of

T = TypeVar("T")
SCENARIOS = Path(__file__).parents[1] / "scenarios"
CORES = 2
BUSY = 0.040  # [s] of processor time, the run by which overhead is judged
SIZES = (100, 1000, 10_000)  # runs
MILLION = 1_000_000
PLANT_RUNS = 16
SWEEP = """schema: ballbar-sweep/1
name: speed
scenario: {scenario}
change:
  plant.kind: kinematic
  errors.rod_strain: null
  identify: {{cost: transform, form: vector, data: samples, samples: 1500}}
vary: {{errors.joint_noise.sigma_rad: [3.0e-6, 1.0e-5, 3.0e-5, 1.0e-4]}}
seeds: {{count: {seeds}}}
"""


@dataclass(frozen=True)
class Spent:
    """Times of one sweep."""

    runs: int
    wall: float  # [s]
    steady: float  # [runs/s] from the first chunk that came back to the last
    driver: float  # [s] of processor time
    workers: float  # [s] of processor time
    bytes_per_run: dict[str, float]  # of the table and of the chunks


def nothing(_scenario: Scenario, _folder: Path) -> dict[str, float]:
    """A run that costs nothing and has as many figures as a real one."""
    return {f"figure_{i}": i * 1.234567 for i in range(40)}


def busy(scenario: Scenario, folder: Path) -> dict[str, float]:
    """A run of BUSY seconds of processor time."""
    until = time.process_time() + BUSY
    while time.process_time() < until:
        pass
    return nothing(scenario, folder)


def real(scenario: Scenario, folder: Path) -> dict[str, float | int | str]:
    """A real run."""
    from ballbar.trial.trial import run_trial  # noqa: PLC0415  the driver needs none of it

    return run_trial(scenario, folder)


def swept(
    trial: Trial, runs: int, workers: Callable[[Task], AbstractContextManager[Workers]]
) -> Spent:
    """A sweep of `runs` runs in a folder of its own."""
    with TemporaryDirectory() as top:
        sweep = sweep_of(Path(top), runs)
        came: list[tuple[float, int]] = []
        begin, driver, children = time.perf_counter(), time.process_time(), _children()
        outcome = run_sweep(
            sweep,
            Path(top) / "out",
            trial,
            workers,
            progress=lambda done, _: came.append((time.perf_counter(), done)) if done else None,
        )
        wall = time.perf_counter() - begin
        arrived = [later for earlier, later in pairwise([(0.0, 0), *came]) if later[1] > earlier[1]]
        (first, some), (last, total) = arrived[0], arrived[-1]
        sizes = {
            kind: path.stat().st_size / runs
            for kind, path in (("Parquet", outcome.folder.table), ("CSV", outcome.folder.csv))
        }
        sizes["chunks"] = (
            sum(path.stat().st_size for path in (outcome.folder.path / "chunks").rglob("*.parquet"))
            / runs
        )
        assert pq.read_metadata(outcome.folder.table).num_rows == runs
        assert not failures_of(outcome.folder.table).count
        return Spent(
            runs,
            wall,
            (total - some) / (last - first),
            time.process_time() - driver,
            _children() - children,
            sizes,
        )


def sweep_of(folder: Path, runs: int) -> LoadedSweep:
    """A sweep over four noise levels."""
    file = folder / "speed.yaml"
    file.write_text(SWEEP.format(scenario=SCENARIOS / "irb2400.yaml", seeds=runs // 4))
    return load_sweep(file)


def here(count: int = CORES) -> Callable[[Task], AbstractContextManager[Workers]]:
    """Worker processes."""
    return partial(processes, count=count)


def bare(trial: Trial, runs: int) -> tuple[float, float]:
    """(wall, processor) seconds of plain processes that share the runs and keep nothing."""
    begin, children = time.perf_counter(), _children()
    with ProcessPoolExecutor(CORES, mp_context=multiprocessing.get_context("spawn")) as pool:
        list(pool.map(_share, [trial] * CORES, [runs // CORES] * CORES))
    return time.perf_counter() - begin, _children() - children


def _share(trial: Trial, runs: int) -> None:
    with TemporaryDirectory() as top:
        scenario = run_of(sweep_of(Path(top), 4).plan, 0).scenario
    for _ in range(runs):
        trial(scenario, SCENARIOS)


def _children() -> float:
    """[s] Processor time of all processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def alone(function: Callable[..., T], *arguments: object) -> T:
    """Result of a function in a fresh process."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


# -- the sections


def speed() -> None:
    """Identifications a second, and against the plain user."""
    real = real_sweep()
    print(
        f"identifications on {CORES} cores (1500 samples, transform, vector, kinematic plant "
        f"included): {real.steady:.0f} a second, {real.steady / 40:.2f} times the target of 40; "
        f"by processor time {CORES * real.runs / real.workers:.0f}"
    )
    plain, fit, whole = alone(against_plain_user)
    print(
        f"plain user on one core: {plain / fit:.0f} times slower than our fit (target 50), "
        f"{plain / whole:.0f} times slower than our whole run with plant and comparison"
    )


@cache
def real_sweep() -> Spent:
    """Real runs, on all cores."""
    return swept(real, 400, here())


def planted(scenario: Scenario, _folder: Path) -> dict[str, float | int | str]:
    """A run of the MuJoCo plant with every error source, and of its encoders and clocks."""
    from ballbar.sim.simulate import simulate  # noqa: PLC0415  the driver needs none of it

    simulation = simulate(
        full_scenario().model_copy(update={SEED: scenario.seed}), relative_to=SCENARIOS
    )
    return {"samples": simulation.motion.t.size}


@cache
def full_scenario() -> Scenario:
    """All of the bench's effects."""
    return load_scenario(SCENARIOS / "irb2400_full.yaml")


def plant() -> None:
    """The full plant inside a sweep, against the bare rollout of its model on one core."""
    from benchmarks.plant_speed import bare_seconds  # noqa: PLC0415  likewise

    shares: list[tuple[float, float]] = []
    for _ in range(3):
        before = alone(bare_seconds, "irb2400_full")
        spent = swept(planted, PLANT_RUNS, here())
        after = alone(bare_seconds, "irb2400_full")
        bare = float(np.mean([before, after], axis=0)[0])
        processor = float(np.mean([before, after], axis=0)[1])
        shares.append((spent.steady * bare / CORES, PLANT_RUNS * processor / spent.workers))
    wall, busy = np.median(shares, axis=0)
    print(
        f"full MuJoCo plant in a sweep on {CORES} cores: {wall:.2f} of {CORES} times the bare "
        f"rollout's speed (target 0.85), {busy:.2f} by processor time"
    )
    print("  rounds: " + ", ".join(f"{a:.2f} and {b:.2f}" for a, b in shares))


def against_plain_user() -> tuple[float, float, float]:
    """[s] processor time of an identification: plain user's, our fit, our whole run; medians."""
    from ballbar.trial.sample_trial import cost_parameters, fit_cost_to_samples, trial_samples  # noqa: PLC0415
    from benchmarks.plain_user import plain_user_identify  # noqa: PLC0415

    with TemporaryDirectory() as top:
        plan = sweep_of(Path(top), 40).plan
    spent: list[tuple[float, float, float]] = []
    for number in range(10, 20):
        scenario = run_of(plan, number).scenario
        samples, parameters = (
            trial_samples(scenario, SCENARIOS),
            cost_parameters(scenario, SCENARIOS),
        )
        plain = (
            _spent(partial(plain_user_identify, samples, samples.nominal, parameters))
            if number % 5 == 0
            else np.nan
        )
        making = _spent(partial(trial_samples, scenario, SCENARIOS))
        fit = _spent(partial(fit_cost_to_samples, scenario, SCENARIOS)) - making
        spent.append((plain, fit, _spent(partial(real, scenario, SCENARIOS))))
    medians = np.nanmedian(spent, axis=0)
    return float(medians[0]), float(medians[1]), float(medians[2])


def _spent(function: Callable[[], object]) -> float:
    begin = time.process_time()
    function()
    return time.process_time() - begin


def overhead() -> None:
    """The time that the machinery adds to runs of 40 ms."""
    print(f"{'runs':>6}  processor time beside the runs, of 40 ms each")
    swept(nothing, 20, here())  # imports what the command has imported before
    _, start = bare(nothing, 0)
    for runs in SIZES:
        spent = swept(nothing, runs, here())
        beside = (spent.driver + spent.workers - start) / (runs * BUSY)
        print(f"{runs:6d}  {beside:6.1%}  (driver {spent.driver / runs * 1e3:.2f} ms a run)")
    for runs in SIZES[:2]:
        spent, (wall, _) = swept(busy, runs, here()), bare(busy, runs)
        print(
            f"{runs:6d}  wall, start and table included, against {CORES} plain processes: "
            f"{spent.wall / wall - 1.0:+.1%}"
        )


def memory() -> None:
    """The driver's largest memory, by number of runs."""
    peaks = {runs: alone(driver_peak, runs) for runs in SIZES}
    print(
        "driver's largest memory: "
        + ", ".join(f"{runs} runs {peak:.0f} MB" for runs, peak in peaks.items())
    )


def driver_peak(runs: int) -> float:
    """[MB] Largest resident memory of this process in a sweep."""
    swept(nothing, runs, here())
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def dask() -> None:
    """One against two Dask workers, real runs; beside them as many plain processes."""
    gains: list[tuple[float, float]] = []
    for _ in range(3):
        (one, plain_one), (two, plain_two) = (
            (dask_rate(count), plain_rate(count)) for count in (1, 2)
        )
        gains.append((two / one, plain_two / plain_one))
    there, plain = np.median(gains, axis=0)
    print(
        f"two Dask workers against one: {there:.2f} times the runs a second (target 1.7), "
        f"two plain processes {plain:.2f} times"
    )
    print("  rounds: " + ", ".join(f"{a:.2f} and {b:.2f}" for a, b in gains))


def dask_rate(workers: int) -> float:
    """[runs/s] of a local cluster."""
    from distributed import LocalCluster  # noqa: PLC0415

    with LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        there = partial(dask_cluster, address=cluster.scheduler_address)
        swept(real, 40, there)  # workers import and plan their path
        return swept(real, 160 * workers, there).steady


def plain_rate(count: int) -> float:
    """[runs/s] of plain processes, together."""
    with ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn")) as pool:
        return sum(pool.map(_rate, [160] * count))


def _rate(runs: int) -> float:
    with TemporaryDirectory() as top:
        plan = sweep_of(Path(top), runs).plan
    real(run_of(plan, 0).scenario, SCENARIOS)
    begin = time.perf_counter()
    for number in range(runs):
        real(run_of(plan, number).scenario, SCENARIOS)
    return runs / (time.perf_counter() - begin)


def million() -> None:
    """The time that a million runs would take."""
    real = real_sweep()
    empty = swept(nothing, SIZES[-1], here())
    per_core = real.steady / CORES
    driver = empty.driver / SIZES[-1]
    print(f"a million runs at {1e3 / per_core:.0f} ms a run and core:")
    for cores in (2, 16, 64):
        hours = MILLION / (per_core * cores) / 3600
        busy_driver = per_core * cores * driver
        print(f"  {cores:3d} cores {hours:6.2f} h, the driver {busy_driver:.0%} busy")
    print(
        "  "
        + ", ".join(
            f"{kind} {size:.0f} bytes a run, {size * MILLION / 1e9:.2f} GB"
            for kind, size in real.bytes_per_run.items()
        )
    )


SECTIONS = {
    "speed": speed,
    "plant": plant,
    "overhead": overhead,
    "memory": memory,
    "dask": dask,
    "million": million,
}


@one_thread_each()
def main() -> None:
    """Runs the sections that are named, or all."""
    if unknown := [name for name in sys.argv[1:] if name not in SECTIONS]:
        sys.exit(f"no section {', '.join(unknown)}: there are {', '.join(SECTIONS)}")
    for name in sys.argv[1:] or SECTIONS:
        SECTIONS[name]()


if __name__ == "__main__":
    main()
