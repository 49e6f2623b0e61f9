"""Speed of the plant, everything on, against the bare rollout of its model; two runs on two cores.

    python -m benchmarks.plant_speed

Every row is a ratio measured in one process, its parts in turn, medians of the rounds; absolute
times vary with the machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout

from ballbar.cell.geometry import nominal_geometry
from ballbar.cell.load import load_cell
from ballbar.scenario import load_scenario
from ballbar.sim.errors.plant_errors import PlantErrors
from ballbar.sim.errors.static_errors import THESIS_3_1
from ballbar.sim.path import ReferencePath, reference_path
from ballbar.sim.path_files import load_lissajous
from ballbar.sim.plant.effects import Plant, plant_effects
from ballbar.sim.plant.mujoco_plant import prepare, run_plant

SCENARIOS = Path(__file__).parent.parent / "scenarios"
ROUNDS = 5
TIMESTEP = 1e-3  # [s]
REST: dict[str, object] = {
    "cycloid_ripple": {},
    "sinusoidal_gear_error": {},
}  # beside what the full scenario switches on


@dataclass(frozen=True, eq=False)
class Job:
    """One scenario's run, everything on."""

    plant: Plant
    path: ReferencePath

    def whole(self) -> None:
        """The run of a user: preparation, rollout, checks."""
        run_plant(self.plant, self.path, timestep=TIMESTEP)

    def two(self) -> None:
        """Two of them, a thread each; the rollout runs without the interpreter's lock."""
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda _: self.whole(), range(2)))


def job_of(name: str) -> Job:
    """The job of a shipped scenario with the rest of the effects switched on too."""
    scenario = load_scenario(SCENARIOS / f"{name}.yaml")
    chosen, timing = scenario.cell, scenario.path
    cell = load_cell(chosen.robot, chosen.measured_by, chosen.plate)
    nominal = nominal_geometry(cell, np.array(chosen.ballbar_position_m))
    true = nominal.replaced({key: nominal[key] + value * 1e-3 for key, value in THESIS_3_1.items()})
    errors = PlantErrors.model_validate(
        {
            **scenario.errors.model_dump(include=set(PlantErrors.model_fields), exclude_none=True),
            **REST,
        }
    )
    shape = load_lissajous(SCENARIOS / timing.file)
    path = reference_path(
        cell.robot,
        nominal,
        shape,
        duration=timing.duration_s,
        dwell=timing.dwell_s,
        stops=timing.stops,
        step=0.01,
    )
    effects = plant_effects(errors, cell, scenario.seed)
    return Job(Plant(cell, true, effects, cell.robot.servo["soft"]), path)


def bare_rollout(job: Job) -> tuple[Callable[[], object], int]:
    """The rollout of a job's model by itself, and the model's degrees of freedom."""
    run = prepare(job.plant, job.path, timestep=TIMESTEP, gravity_compensation=True)
    model = run.compiled.model
    state, command = run.start[None], run.command[None, 1:]
    return partial(rollout.rollout, model, mujoco.MjData(model), state, command), model.nv


def bare_seconds(name: str) -> tuple[float, float]:
    """(wall, processor) seconds of the bare rollout of a scenario; the first of two warms up."""
    bare, _ = bare_rollout(job_of(name))
    bare()
    begin, busy = time.perf_counter(), time.process_time()
    bare()
    return time.perf_counter() - begin, time.process_time() - busy


def main() -> None:
    """Prints the speed, the overhead over the bare rollout, and the gain of a second core."""
    for name in ("irb2400_full", "nj220_full"):
        job = job_of(name)
        (bare, freedoms), seconds = bare_rollout(job), float(job.path.t[-1])
        times = np.array(
            [[_timed(part) for part in (bare, job.whole, job.two)] for _ in range(ROUNDS)]
        )
        bare_rate, whole_rate = seconds / times[:, 0], seconds / times[:, 1]
        overhead = np.median(times[:, 1] / times[:, 0])
        gain = np.median(2.0 * times[:, 1] / times[:, 2])
        ripples = len(job.plant.effects.ripples)
        print(
            f"{name}: {freedoms} degrees of freedom, {ripples} ripple terms, "
            f"{seconds:.0f} s at 1 ms\n"
            "  whole run, simulated s per wall s : "
            f"median {np.median(whole_rate):.0f}, best {whole_rate.max():.0f}\n"
            "  bare rollout                      : "
            f"median {np.median(bare_rate):.0f}, best {bare_rate.max():.0f}\n"
            f"  whole run / bare rollout          : median {overhead:.3f}\n"
            f"  two runs on two cores / one run   : median {gain:.2f} times the throughput"
        )


def _timed(part: Callable[[], object]) -> float:
    begin = time.perf_counter()
    part()
    return time.perf_counter() - begin


if __name__ == "__main__":
    main()
