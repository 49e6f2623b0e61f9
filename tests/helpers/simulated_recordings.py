"""Short simulated runs with their recordings, and parameters off by a random amount."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbar.cell.clock import Clock
from ballbar.cell.geometry import Geometry
from ballbar.sim.motion import Motion
from ballbar.sim.recording_files import write_recording
from ballbar.sim.settings import SimulationSettings
from ballbar.sim.simulate import Simulation, simulate

SCENARIOS = Path(__file__).parents[2] / "scenarios"
CLOCK = Clock(0.137, 5e-5)  # of the ball-bar, if no other is stated


def lissajous(
    file: str, duration: float, *, dwell_s: float = 2.0, stops: int = 0
) -> dict[str, object]:
    """The section `path` of a motion over the sphere."""
    timing = {"duration_s": duration, "dwell_s": dwell_s, "stops": stops}
    return {"kind": "lissajous", "file": file, **timing}


def settings(**changes: object) -> SimulationSettings:
    """The main scenario in 60 s, with top-level sections replaced."""
    base: dict[str, object] = {
        "cell": {
            "robot": "irb2400",
            "ballbar": "lund_600",
            "ballbar_position_m": [0.70, 0.0, 0.54],
        },
        "path": lissajous("paths/irb2400_a.yaml", 60.0, stops=1),
        "errors": {"static": {"table": "thesis_3_1"}, "joint_noise": {"sigma_rad": 1e-5}},
        "encoders": {"fitted": [1, 2, 3, 4, 5], "noise_sigma_rad": 1e-5},
        "clocks": {"offset_s": CLOCK.offset, "skew": CLOCK.skew, "overrun_probability": 0.005},
        "seed": 1,
    }
    return SimulationSettings.model_validate(base | changes)


def wire_settings(**changes: object) -> SimulationSettings:
    """A draw-wire in place of the ball-bar, kinematic and without errors, in 60 s."""
    cell = {"robot": "irb2400", "instrument": "drawwire_2m"}
    base: dict[str, object] = {
        "cell": cell | {"ballbar_position_m": [-0.006, -0.575, 0.062]},
        "path": lissajous("paths/irb2400_drawwire.yaml", 60.0, dwell_s=4.0),
        "plant": {"kind": "kinematic"},
        **{section: {} for section in ("errors", "encoders", "clocks")},
    }
    return settings(**base | changes)


@dataclass(frozen=True)
class Recorded:
    """A simulation and the folder of its recording."""

    settings: SimulationSettings
    simulation: Simulation
    folder: Path


def record(folder: Path, **changes: object) -> Recorded:
    """Simulates and writes a recording."""
    chosen = settings(**changes)
    simulation = simulate(chosen, relative_to=SCENARIOS)
    write_recording(simulation, chosen, folder)
    return Recorded(chosen, simulation, folder)


def perturbed(geometry: Geometry, rng: np.random.Generator, sigma: float = 1e-3) -> Geometry:
    """Every parameter of robot, ball-bar and base off by a random amount [m, rad]."""
    return geometry.with_values(geometry.values + rng.normal(0.0, sigma, geometry.values.shape))


def singular_passage(*, friction: bool) -> Motion:
    """A minute on a path that comes within half a degree of b4 = 0, under the soft servo.

    friction : of the bearings of the ball-bar. Near the singularity its joints turn fast, and the
        loop stays closed with a quarter of the usual time step only.
    """
    errors = {"static": {"table": "thesis_3_1"}, "joint_compliance": {}, "rod_strain": {}}
    chosen = settings(
        path=lissajous("paths/irb2400_b4_0.3deg.yaml", 60.0),
        plant={"timestep_s": 2.5e-4},
        errors=errors | ({"bar_friction": {}} if friction else {}),
    )
    return simulate(chosen, relative_to=SCENARIOS).motion
