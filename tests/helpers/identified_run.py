"""A minute of the kinematic plant, recorded and identified, for replays and reports."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ballbar.acquisition.recording import read_recording
from ballbar.ident.options import FitOptions
from ballbar.result.run_data import FittedRecording, RunData
from ballbar.scenario import load_scenario
from ballbar.sim.recording_files import write_recording
from ballbar.sim.simulate import simulate
from ballbar.truth.compare import identification_against_truth
from ballbar.truth.limits import Limit
from tests.helpers.one_recording import identify
from tests.helpers.simulated_recordings import SCENARIOS

SCENARIO = SCENARIOS / "irb2400.yaml"


def simulated_run(folder: Path, *, fitted: tuple[int, ...]) -> RunData:
    """A minute of the kinematic plant, identified from few samples."""
    scenario = load_scenario(SCENARIO)
    scenario = scenario.model_copy(
        update={
            "path": scenario.path.model_copy(update={"duration_s": 60.0}),
            "plant": scenario.plant.model_copy(update={"kind": "kinematic"}),
            "errors": scenario.errors.model_copy(update={"rod_strain": None}),
            "encoders": scenario.encoders.model_copy(update={"fitted": fitted}),
        }
    )
    simulation = simulate(scenario, relative_to=SCENARIO.parent)
    write_recording(simulation, scenario, folder / "recording")
    recording = read_recording(folder / "recording")
    found = identify(
        simulation.cell, recording.robot_log, recording.ballbar_log, options=FitOptions(samples=300)
    )
    comparison = identification_against_truth(found, simulation.truth)
    limits = (
        Limit("TCP error, mean", comparison.tcp.mean * 1e3, 0.05, "mm", met=True),
        Limit("iterations", 11.0, 10.0, "", met=False),
    )
    fitted_recording = FittedRecording("minute", recording, found.recordings[0])
    data = RunData("minute", (fitted_recording,), found, simulation, comparison, limits)
    return replace(data, scenario=scenario)
