"""Whether the time step matters to what is identified: everything on at 1 ms and at 0.5 ms, same seeds, same identifier.

python -m benchmarks.step_halving
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from ballbar.run import identify_folder
from ballbar.scenario import Scenario, load_scenario
from ident import Identification
from sim.simulate import simulate, write_recording

SCENARIOS = Path(__file__).parent.parent / "scenarios"


def identified(scenario: Scenario, timestep: float) -> tuple[Identification, float]:
    """Result at one time step, and the largest loop-closure error of the plant [m]."""
    settings = scenario.model_copy(update={"plant": scenario.plant.model_copy(update={"timestep_s": timestep})})
    simulation = simulate(settings, relative_to=SCENARIOS)
    with tempfile.TemporaryDirectory() as folder:
        write_recording(simulation, settings, Path(folder) / "recording")
        _, result = identify_folder(Path(folder) / "recording", progress=lambda _: None)
    return result, simulation.truth.closure_position


def main() -> None:
    """Prints the change of every scenario's parameters in units of their stated sigma, and the closure at both steps."""
    for name in ("irb2400_full", "nj220_full"):
        scenario = load_scenario(SCENARIOS / f"{name}.yaml")
        (coarse, open_coarse), (fine, open_fine) = (identified(scenario, step) for step in (1e-3, 5e-4))
        change: dict[str, float] = {key: abs(fine.geometry[key] - coarse.geometry[key]) / coarse.sigma[key] for key in coarse.sigma}
        worst = max(change, key=lambda key: change[key])
        rms = float(np.sqrt(np.mean(np.square(list(change.values())))))
        moved = max(abs(fine.geometry[key] - coarse.geometry[key]) for key in change)
        print(f"{name}: change of identified parameters in sigma: largest {change[worst]:.3f} ({worst}), rms {rms:.3f}")
        print(f"  largest change of one parameter {moved * 1e6:.2f} um or urad")
        print(f"  loop closure: {open_coarse * 1e6:.3f} um at 1 ms, {open_fine * 1e6:.3f} um at 0.5 ms")


if __name__ == "__main__":
    main()
