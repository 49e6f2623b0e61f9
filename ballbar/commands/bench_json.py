"""Results of the test bench for programs: what `--json` of its commands prints, in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:  # a command imports only what it shows
    from ballbar.claims.run import ClaimVerdict, Judged
    from ballbar.sim.simulate import Simulation
    from ballbar.sim.still_poses import PoseSimulation
    from ballbar.sweep.run import SweepOutcome
    from ballbar.truth.limits import Limit


def simulation_data(
    simulation: Simulation | PoseSimulation, limits: Sequence[Limit], folder: Path
) -> dict[str, object]:
    """JSON of `simulate`: recording or table, truth file, the simulated plant, its limits."""
    from ballbar.sim.recording_files import truth_path

    return {
        "recording": str(folder),
        "truth": str(truth_path(folder)),
        **simulation.figures,
        "limits": [asdict(limit) for limit in limits],
    }


def sweep_data(outcome: SweepOutcome) -> dict[str, object]:
    """JSON of `sweep`: the table, and the spread of the main results at each point of the grid."""
    from ballbar.sweep.table import failures_of, grid_points

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
            "claims": [_claim_data(verdict) for verdict in result.verdicts],
        }
        for result in judged
    ]


def _claim_data(verdict: ClaimVerdict) -> dict[str, object]:
    return {
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
