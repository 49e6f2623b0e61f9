"""Machines with drawn geometry whose tool a telescoping bar measures, and recordings of them."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbar.acquisition.recording import read_recording
from ballbar.cell.geometry import robot_frames
from ballbar.ident.identify import identify_together
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Machine
from ballbar.scenario import Scenario, load_scenario
from ballbar.sim.path_files import scenario_path
from ballbar.sim.recording_files import write_recording
from ballbar.sim.simulate import simulate
from ballbar.sim.true_robot import TrueMachine, true_machine
from tests.helpers.drawn_robots import SCENARIOS

PLACED = 1e-4  # [m] standard deviation of the bar's seat, which its stroke of 1 mm has to take
EXACT = 1e-7  # [m] up to which the plant has to close its loop


def bar_scenario(seed: int, recording: int = 1) -> Scenario:
    """The scenario irb2400_telescoping of another robot, its recording of this number."""
    data = load_scenario(SCENARIOS / "irb2400_telescoping.yaml").model_dump(
        mode="json", by_alias=True, exclude_none=True
    )
    data |= {"seed": seed, "recording": recording, "accept": {}}
    return Scenario.model_validate(data, strict=False)


def drawn_machine(seed: int) -> TrueMachine:
    """The robot of a scenario and its telescoping bar."""
    return true_machine(bar_scenario(seed), relative_to=SCENARIOS)


def moved(truth: TrueMachine, moves: dict[str, float]) -> TrueMachine:
    """The machine with parameters moved by so much [m, rad]."""
    true = truth.true
    return replace(truth, true=true.replaced({name: true[name] + v for name, v in moves.items()}))


def recorded(truth: TrueMachine, scenario: Scenario, rng: np.random.Generator) -> Logs:
    """Logs of one path, through their files, the bar's seat placed again.

    Raises InputError where the path leaves the bar's stroke.
    """
    placed = _placed(truth, scenario, rng)
    simulation = simulate(scenario, relative_to=SCENARIOS, machine=placed)
    assert simulation.truth.closure.position_m < EXACT
    with tempfile.TemporaryDirectory() as folder:
        write_recording(simulation, scenario, Path(folder) / "recording")
        read = read_recording(Path(folder) / "recording")
    return Logs(read.robot_log, None, length=read.length_log, name=f"of {scenario.recording}")


def _placed(truth: TrueMachine, scenario: Scenario, rng: np.random.Generator) -> TrueMachine:
    """The machine with the bar's seat where its path keeps about the planned lengths."""
    nominal, true = truth.nominal, truth.true
    path = scenario_path(scenario.path, truth.cell, nominal, relative_to=SCENARIOS)
    planned, tip = (robot_frames(g, path.q).tip.T for g in (nominal, true))
    length, seat = np.linalg.norm(planned - nominal.origin, axis=1), true.origin
    for _ in range(3):
        rod = tip - seat
        error = np.linalg.norm(rod, axis=1) - length
        direction = rod / np.linalg.norm(rod, axis=1)[:, None]
        seat = seat + np.linalg.lstsq(direction, error, rcond=None)[0]
    seat = seat + PLACED * rng.standard_normal(3)
    return replace(
        truth, true=true.replaced(dict(zip(("ox", "oy", "oz"), seat.tolist(), strict=True)))
    )


def identified(truth: TrueMachine, seed: int, recordings: int = 1) -> Machine:
    """The machine as identified from recordings of its path."""
    rng = np.random.default_rng([seed, 0])
    logs = [recorded(truth, bar_scenario(seed, 1 + k), rng) for k in range(recordings)]
    return identify_together(truth.cell, logs).machine
