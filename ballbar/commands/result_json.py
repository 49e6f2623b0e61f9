"""Results for programs: what `--json` prints, in SI units that stand in the keys."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import yaml

from ballbar.result.calibration import Calibration
from ballbar.result.names import OUTPUTS
from ballbar.result.run_data import PoseRun, RunData

if TYPE_CHECKING:  # a command imports only what it shows
    from ballbar.claims.run import Judged
    from ballbar.result.compare import Comparison
    from ballbar.result.limits import Limit
    from ballbar.sweep.run import SweepOutcome
    from ident.robot.accuracy import TcpError
    from sim.simulate import Simulation
    from sim.still_poses import PoseSimulation


def run_data(run: RunData | PoseRun, folder: Path) -> dict[str, object]:
    """JSON of `run` and `identify`: the calibration written to `folder`, comparison and limits.

    An identification from still poses without simulation has neither plant nor limits.
    """
    file = Calibration.load(folder).file
    result: dict[str, object] = {
        "acceptable": run.acceptable,
        "sentence": run.identification.verdict.sentence,
        "folder": str(folder),
        "files": sorted(entry.name for entry in folder.iterdir() if entry.name in OUTPUTS),
        "calibration": file.model_dump(mode="json", by_alias=True),
    }
    limits = [asdict(limit) for limit in run.limits]
    if isinstance(run, RunData):
        plant: object = plant_data(run.simulation) if run.simulation else None
        comparison = comparison_data(run.comparison) if run.comparison else None
        return result | {"plant": plant, "comparison": comparison, "limits": limits}
    if run.simulation is None or run.comparison is None:
        return result
    errors = {
        "tcp_error": _tcp(run.comparison.tcp),
        "tcp_error_nominal": _tcp(run.comparison.tcp_nominal),
    }
    return result | {"plant": run.simulation.plant, "comparison": errors, "limits": limits}


def pose_simulation_data(simulation: PoseSimulation, folder: Path) -> dict[str, object]:
    """JSON of `simulate` on a scenario of still poses: table, truth file, and the plant."""
    from sim.recording_files import truth_path

    force = simulation.truth.force_N
    return {
        "recording": str(folder),
        "truth": str(truth_path(folder)),
        "plant": simulation.plant,
        "force_N": None if force is None else list(force),
    }


def simulation_data(
    simulation: Simulation, limits: Sequence[Limit], folder: Path
) -> dict[str, object]:
    """JSON of `simulate`: recording, truth file, accuracy of the simulated plant, its limits."""
    from sim.recording_files import truth_path

    return {
        "recording": str(folder),
        "truth": str(truth_path(folder)),
        "plant": plant_data(simulation),
        "limits": [asdict(limit) for limit in limits],
    }


def plant_data(simulation: Simulation) -> dict[str, object]:
    """Largest loop-closure error of the simulated plant, and the range of the force in the rod."""
    truth = simulation.truth
    return {
        "closure_position_m": float(truth.closure.position_m),
        "closure_angle_rad": float(truth.closure.angle_rad),
        "rod_force_min_N": float(truth.rod_force.min_N),
        "rod_force_max_N": float(truth.rod_force.max_N),
    }


def comparison_data(comparison: Comparison) -> dict[str, object]:
    """JSON of `compare`, SI units: errors are model minus reference."""
    if comparison.target:
        return {
            "target": comparison.target,
            "tcp_difference": _distances(comparison.tcp),
            "tcp_difference_nominal": _distances(comparison.tcp_nominal),
            "cross_validated_mean_m": list(comparison.predicted),
            "parameters": {
                name: {"difference": size, "z": comparison.z[name]}
                for name, size in comparison.deviations.items()
            },
            "axes_with_unlike_ranges": list(comparison.unlike_ranges),
        }
    return {
        "tcp_error": _tcp(comparison.tcp),
        "tcp_error_nominal": _tcp(comparison.tcp_nominal),
        "deviations": {name: float(value) for name, value in comparison.deviations.items()},
        "distance": comparison.distance,
        "clock_offset_error_s": comparison.offset,
        "clock_skew_error": comparison.skew,
    }


def plan_data(folder: Path, *, feasible: bool) -> dict[str, object]:
    """JSON of `plan`: plan.yaml as written, and whether no limit was violated in the plant."""
    content = yaml.safe_load((folder / "plan.yaml").read_text())  # our own file of plain values
    return {
        "acceptable": feasible,
        "folder": str(folder),
        "files": sorted(entry.name for entry in folder.iterdir()),
        "plan": content,
    }


def sweep_data(outcome: SweepOutcome) -> dict[str, object]:
    """JSON of `sweep`: the table, and the spread of the main results at each point of the grid."""
    from ballbar.sweep.summary import failures_of, grid_points

    folder = outcome.folder
    data: dict[str, object] = {
        "finished": outcome.finished,
        "runs": folder.plan.runs,
        "done": outcome.done,
        "folder": str(folder.path),
    }
    if not outcome.finished:
        return data
    points = [
        {
            "values": point.values,
            "runs": point.runs,
            "failed": point.failed,
            "results": {
                name: {"median": float(np.median(values)), "q95": float(np.quantile(values, 0.95))}
                for name, values in point.results.items()
                if values.size
            },
        }
        for point in grid_points(folder.table, folder.plan)
    ]
    failures = failures_of(folder.table)
    return data | {
        "table": str(folder.table),
        "csv": str(folder.csv),
        "failed": failures.count,
        "commonest_failure": failures.reason or None,
        "points": points,
    }


def claims_data(judged: Sequence[Judged]) -> list[dict[str, object]]:
    """JSON of `claims`: every claim with its checks."""
    return [
        {
            "file": str(result.topic.path),
            "title": result.topic.file.title,
            "claims": [
                {
                    "name": verdict.claim.name,
                    "source": verdict.claim.source,
                    "says": verdict.claim.says,
                    "verdict": verdict.word,
                    "passed": verdict.passed,
                    "with": {
                        parameters: {
                            "verdict": verdict.comes_out(parameters),
                            "checks": [asdict(check) for check in outcomes],
                        }
                        for parameters, outcomes in verdict.outcomes.items()
                    },
                    "guards": [asdict(check) for check in verdict.guards],
                    "ml": list(verdict.ml),
                }
                for verdict in result.verdicts
            ],
        }
        for result in judged
    ]


def _tcp(error: TcpError) -> dict[str, float]:
    without_scale = float(error.error_without_scale.mean())
    return _distances(error) | {"mean_without_scale_m": without_scale}


def _distances(error: TcpError) -> dict[str, float]:
    return {"mean_m": float(error.mean), "max_m": float(error.maximum)}
