"""A scenario of still poses: simulate, read, identify, compare with the truth, write results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ballbar.outputs import Progress, write_pose_outputs
from ballbar.result.compare import Comparison, poses_against_truth
from ballbar.result.limits import Limit, tcp_limits
from ballbar.result.names import POSE_OUTPUTS, RECORDING
from ballbar.result.pose_run import PoseRun, identify_pose_folders
from ballbar.scenario import PoseScenario, scenario_path, write_scenario
from cell.errors import InputError
from cell.files import DESCRIPTIONS, claimed_folder
from cell.pose_file import load_poses_file
from sim.poses.files import TABLE, write_poses
from sim.poses.simulate import PoseSimulation, simulate_poses
from sim.recording_files import truth_path


@dataclass(frozen=True, eq=False)
class PoseScenarioRun:
    """A scenario of still poses from simulation to limits."""

    simulation: PoseSimulation
    run: PoseRun
    comparison: Comparison
    limits: tuple[Limit, ...]

    @property
    def acceptable(self) -> bool:
        """Whether the verdict is acceptable and every limit met."""
        return self.run.acceptable and all(limit.met for limit in self.limits)


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
) -> PoseScenarioRun:
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
        write_pose_outputs(out, run, comparison, command=command, replay=False, progress=progress)
        status, sigma = run.identification.verdict.status, run.identification.tcp_sigma
        limits = tcp_limits(status, sigma, comparison, scenario.accept)
        return PoseScenarioRun(simulation, run, comparison, limits)
