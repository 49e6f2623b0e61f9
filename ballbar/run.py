"""The main job: simulate, read, identify, compare, and write what the user looks at."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from acquisition import Recording, read_recording
from ballbar.compare import identification_against_truth, limits_of
from ballbar.replay import write_replay
from ballbar.report import write_report
from ballbar.run_data import RunData
from ballbar.scenario import Scenario
from cell.descriptions import load_cell
from cell.errors import InputError
from cell.files import claim_folder
from cell.recording import load_recording_file
from ident.calibration import write_calibration
from ident.identify import DEFAULT_SAMPLES, Identification, identify
from sim.simulate import Simulation, simulate, truth_path, write_recording

RECORDING = "recording"
CALIBRATION = "calibration.yaml"
REPORT = "report.html"
REPLAY = "run.rrd"

OUTPUTS = {CALIBRATION, REPORT, REPLAY}

Progress = Callable[[str], None]


def simulate_scenario(scenario: Scenario, scenario_file: Path, folder: Path, *, progress: Progress) -> Simulation:
    """Simulates a scenario and writes its recording.

    Raises InputError when the scenario cannot be run, or `folder` holds something else or a real recording.
    """
    claim_recording(folder)
    progress("simulating the cell")
    simulation = simulate(scenario, relative_to=scenario_file.parent)
    progress("writing the device logs")
    write_recording(simulation, scenario, folder)
    return simulation


def claim_recording(folder: Path) -> None:
    """Makes sure that a simulated recording may go to `folder`. Raises InputError; a real recording is never overwritten."""
    claim_folder(folder, {"recording.yaml", "raw"}, "a recording")
    if (folder / "recording.yaml").exists() and load_recording_file(folder).kind == "real":
        raise InputError(f"{folder}: holds a real recording; nothing was written. Choose another folder with --out.")


def identify_folder(folder: Path, *, samples: int = DEFAULT_SAMPLES, progress: Progress) -> tuple[Recording, Identification]:
    """Reads and identifies a recording. Raises InputError for bad files, StartError when the logs do not fit together."""
    progress("reading the recording")
    recording = read_recording(folder)
    file = recording.description
    cell = load_cell(file.robot, file.ballbar, file.plate, relative_to=folder)
    logs = recording.robot_log, recording.ballbar_log, recording.force_log
    return recording, identify(cell, *logs, samples=samples, progress=progress)


def write_outputs(out: Path, data: RunData, *, command: str, replay: bool, progress: Progress) -> None:
    """Writes calibration.yaml, report.html and, if asked for, run.rrd."""
    file = data.recording.description
    write_calibration(out / CALIBRATION, data.identification, robot=file.robot, ballbar=file.ballbar, plate=file.plate)
    progress("writing the report")
    write_report(out / REPORT, data, command=command)
    if replay:
        progress("writing the replay")
        write_replay(out / REPLAY, data)


def run_scenario(scenario: Scenario, scenario_file: Path, out: Path, *, command: str, progress: Progress) -> RunData:
    """Simulate, identify, compare with the truth, report, replay.

    Raises InputError when the scenario cannot be run or `out` holds something else.
    """
    claim_folder(out, {RECORDING, truth_path(out / RECORDING).name, *OUTPUTS}, "a run")
    folder = out / RECORDING
    simulation = simulate_scenario(scenario, scenario_file, folder, progress=progress)
    recording, result = identify_folder(folder, samples=scenario.identify.samples, progress=progress)
    comparison = identification_against_truth(result, simulation.truth)
    limits = limits_of(comparison, result.iterations, scenario.accept)
    data = RunData(scenario.name, folder, recording, result, simulation, comparison, limits)
    write_outputs(out, data, command=command, replay=True, progress=progress)
    return data
