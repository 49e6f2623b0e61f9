"""Robots drawn with every error source on: their scenarios, recordings and faults."""

from __future__ import annotations

import argparse
from pathlib import Path

from ballbar.acquisition.recording import read_recording
from ballbar.cell.descriptions import Cell
from ballbar.ident.recording_fit import Logs
from ballbar.scenario import Scenario, load_scenario
from ballbar.sim.recording_files import write_recording
from ballbar.sim.simulate import simulate
from ballbar.sim.truth import Truth

ROOT = Path(__file__).parents[2]
SCENARIOS = ROOT / "scenarios"
DRAWN: dict[str, object] = {"sigma_m": 1e-3, "sigma_rad": 1e-3, "parameters": "robot"}


def scenario_of(robot: str, path: str, seed: int, duration: float) -> Scenario:
    """A drawn robot with everything on along path a or, as its second recording, path b."""
    base = load_scenario(SCENARIOS / f"{robot}_full.yaml")
    changed = base.model_dump(mode="json", by_alias=True, exclude_none=True)
    changed["errors"]["static"] = DRAWN
    changed["path"] |= {"file": f"paths/{robot}_{path}.yaml", "duration_s": duration}
    changed |= {"seed": seed, "recording": 1 if path == "a" else 2}
    return Scenario.model_validate(changed, strict=False)


def recorded(scenario: Scenario, folder: Path) -> tuple[Cell, Logs, Truth]:
    """Logs of one run, through its files."""
    simulation = simulate(scenario, relative_to=SCENARIOS)
    write_recording(simulation, scenario, folder)
    read = read_recording(folder)
    return simulation.cell, Logs(read.robot_log, read.ballbar_log, read.force_log), simulation.truth


def study_options(words: str | None) -> argparse.Namespace:
    """Options of a study of drawn robots: how many, and how long each recording is."""
    parser = argparse.ArgumentParser(
        description=words, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", type=int, default=8)
    parser.add_argument("--duration", type=float, default=120.0, help="[s]")
    return parser.parse_args()


SLIP_S, STEP_S = 37.3, 71.9  # [s] after the start of the path


def faulty(scenario: Scenario, changes: dict[str, object]) -> Scenario:
    """The scenario with one fault more."""
    changed = scenario.model_dump(mode="json", by_alias=True, exclude_none=True)
    for section, more in changes.items():
        changed[section] = {**changed.get(section, {}), **more}  # type: ignore[dict-item]
    return Scenario.model_validate(changed, strict=False)
