"""Whether the time step matters to the identified parameters: everything on at 1, 0.5 and 0.25 ms.

python -m benchmarks.step_halving
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from ballbar.ident.result import Identification
from ballbar.result.identify import identify
from ballbar.scenario import Scenario, load_scenario
from ballbar.sim.recording_files import write_recording
from ballbar.sim.simulate import simulate

SCENARIOS = Path(__file__).parent.parent / "scenarios"
STEPS = (1e-3, 5e-4, 2.5e-4)  # [s]


def identified(scenario: Scenario, timestep: float) -> tuple[Identification, float]:
    """Result at one time step, and the largest loop-closure error of the plant [m]."""
    settings = scenario.model_copy(
        update={"plant": scenario.plant.model_copy(update={"timestep_s": timestep})}
    )
    simulation = simulate(settings, relative_to=SCENARIOS)
    with tempfile.TemporaryDirectory() as folder:
        write_recording(simulation, settings, Path(folder) / "recording")
        result = identify(Path(folder) / "recording").data.identification
    return result, simulation.truth.closure.position_m


def main() -> None:
    """Prints the change of the parameters in units of their sigma, and the closure, by step."""
    for name in ("irb2400_full", "nj220_full"):
        scenario = load_scenario(SCENARIOS / f"{name}.yaml")
        results = [identified(scenario, step) for step in STEPS]
        for step, (coarse, _), (fine, _) in zip(STEPS, results, results[1:], strict=False):
            change: dict[str, float] = {
                key: abs(fine.recordings[0].geometry[key] - coarse.recordings[0].geometry[key])
                / coarse.sigma[key]
                for key in coarse.sigma
            }
            worst = max(change, key=lambda key: change[key])
            rms = float(np.sqrt(np.mean(np.square(list(change.values())))))
            moved = max(
                abs(fine.recordings[0].geometry[key] - coarse.recordings[0].geometry[key])
                for key in change
            )
            print(
                f"{name}, from {step * 1e3:g} ms to half of it: change of identified parameters in "
                f"sigma: largest {change[worst]:.3f} ({worst}), rms {rms:.3f}; "
                f"largest change of one parameter {moved * 1e6:.2f} um or urad"
            )
        closed = ", ".join(
            f"{gap * 1e6:.3f} um at {step * 1e3:g} ms"
            for step, (_, gap) in zip(STEPS, results, strict=True)
        )
        print(f"  loop closure: {closed}")


if __name__ == "__main__":
    main()
