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
from ballbar.scenario import PoseScenario, scenario_path, write_scenario
from cell.errors import InputError
from cell.files import DESCRIPTIONS, claimed_folder
from cell.pose_file import load_poses_file
from sim.poses.files import TABLE, write_poses
from sim.poses.simulate import PoseSimulation, simulate_poses
from sim.recording_files import truth_path


def simulate_pose_scenario(
    scenario: PoseScenario, scenario_file: Path, folder: Path, *, progress: Progress
) -> PoseSimulation:
    """Simulates a scenario of still poses and writes its table, and beside it truth and scenario.

    Raises InputError when the scenario cannot be run, or when `folder` holds something else or real
    poses.
    """
    with claimed_folder(folder, {"poses.yaml", TABLE, DESCRIPTIONS}, "a table of poses"):
        if (folder / "poses.yaml").exists() and load_poses_file(
            folder / "poses.yaml"
        ).kind == "real":
            raise InputError(
                f"{folder}: holds real poses; nothing was written. Choose another folder with "
                "--out."
            )
        progress("simulating the poses")
        files = scenario_file.parent
        try:
            simulation = simulate_poses(scenario, relative_to=files)
        except InputError as error:
            raise InputError(f"{scenario_file}: {error}") from None
        progress("writing the table")
        write_scenario(scenario, files, folder)
        write_poses(simulation, scenario, folder, relative_to=files)
        return simulation


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
