"""A scenario of still poses: simulate, read, identify, compare with the truth, write results."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ballbar.outputs import Progress, write_outputs
from ballbar.result.compare import poses_against_truth
from ballbar.result.limits import tcp_limits
from ballbar.result.names import POSE_OUTPUTS, RECORDING
from ballbar.result.run_data import PoseRun
from ballbar.result.run_recordings import identify_pose_folders
from ballbar.run import simulate_pose_scenario
from ballbar.scenario import PoseScenario, scenario_path
from cell.files import claimed_folder
from sim.recording_files import truth_path


def run_pose_scenario(
    scenario: PoseScenario, scenario_file: Path, out: Path, *, command: str, progress: Progress
) -> PoseRun:
    """Simulates, identifies, compares with the truth, and writes calibration.yaml and report.html.

    command : the command line, for the report.

    Raises InputError when the scenario cannot be run, or when `out` holds something else.
    """
    folder = out / RECORDING
    beside = {truth_path(folder).name, scenario_path(folder).name}
    with claimed_folder(out, {RECORDING, *beside, *POSE_OUTPUTS}, "a run"):
        simulation = simulate_pose_scenario(scenario, scenario_file, folder, progress=progress)
        run = identify_pose_folders([folder], progress=progress)
        comparison = poses_against_truth(run.identification, simulation.truth)
        status, sigma = run.identification.verdict.status, run.identification.tcp_sigma
        limits = tcp_limits(status, sigma, comparison, scenario.accept)
        run = replace(run, simulation=simulation, comparison=comparison, limits=limits)
        write_outputs(out, run, command=command, replay=False, progress=progress)
        return run
