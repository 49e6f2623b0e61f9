"""Error of the two clocks after the fit: rate to 200 ppm, wander of 0.5 ppm, one step of a clock.

    python -m benchmarks.alignment_after_fit [SECONDS] [SEEDS]

Kinematic plant with static errors and noise; the recording is read and identified like any other.
The robot's time that the fit gives each ball-bar row is compared with the true one, over the whole
run. Allowed: 100 us.
"""

from __future__ import annotations

import sys

import numpy as np

from ballbar.sim.settings import SimulationSettings
from benchmarks.study import SCENARIOS, kinematic_settings, recorded
from tests.helpers.clock_truth import clock_error
from tests.helpers.one_recording import identify

ALLOWED = 100e-6  # [s]
CASES: dict[str, dict[str, object]] = {
    "skew 200 ppm": {"skew": 2e-4},
    "and wander 0.5 ppm": {"skew": 2e-4, "wander": {"rate_rms_ppm": 0.5}},
    "and a step of 128 ms": {
        "skew": 2e-4,
        "wander": {"rate_rms_ppm": 0.5},
        "step": {"step_s": 0.128},
    },
    "and a step back of 40 ms": {
        "skew": -2e-4,
        "wander": {"rate_rms_ppm": 0.5},
        "step": {"step_s": -0.04},
    },
}


def settings(duration: float, clocks: dict[str, object], seed: int) -> SimulationSettings:
    """One run; a step falls into its second half."""
    clocks = (
        {**clocks, "step": {"at_s": 0.6 * duration, **clocks["step"]}}
        if isinstance(clocks.get("step"), dict)
        else clocks
    )  # type: ignore[dict-item]
    return kinematic_settings(
        {"file": "paths/irb2400_a.yaml", "duration_s": duration, "dwell_s": 3.0, "stops": 2},
        errors={"static": {"table": "thesis_3_1"}, "joint_noise": {"sigma_rad": 1e-5}},
        encoders={"fitted": [1, 2, 3, 4, 5], "noise_sigma_rad": 1e-5},
        clocks={"offset_s": 0.137, "overrun_probability": 0.005, **clocks},
        seed=seed,
    )


def main() -> None:
    """One line a case."""
    duration = float(sys.argv[1]) if len(sys.argv) > 1 else 120.0
    seeds = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    for name, clocks in CASES.items():
        worst, rms = [], []
        for seed in range(1, seeds + 1):
            simulation, read = recorded(settings(duration, clocks, seed), SCENARIOS)
            found = identify(simulation.cell, read.robot_log, read.ballbar_log, read.force_log)
            error = clock_error(simulation, found)
            worst.append(float(np.abs(error).max()))
            rms.append(float(np.sqrt((error**2).mean())))
        most, spread = max(worst) * 1e6, max(rms) * 1e6
        met = "met" if max(worst) < ALLOWED else "missed"
        print(
            f"{name:26} {seeds} runs of {duration:.0f} s: "
            f"rms {spread:.1f} us, largest {most:.1f} us ({met})",
            flush=True,
        )


if __name__ == "__main__":
    main()
