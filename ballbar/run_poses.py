"""A scenario of still poses: simulate, read, identify, compare with the truth, write results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ballbar.outputs import Progress, write_pose_outputs
from ballbar.result.compare import Comparison, poses_against_truth
from ballbar.result.limits import Limit, tcp_limits
from ballbar.result.names import POSE_OUTPUTS, RECORDING
from ballbar.result.pose_run import PoseRun, identify_pose_folders
from ballbar.run import simulate_pose_scenario
from ballbar.scenario import PoseScenario, scenario_path
from cell.files import claimed_folder
from sim.recording_files import truth_path
from sim.still_poses import PoseSimulation


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
