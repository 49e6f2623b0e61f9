"""Results for programs: what `--json` prints, in SI units that stand in the keys."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from ballbar.result.calibration import load
from ballbar.result.names import OUTPUTS
from ballbar.result.run_data import RunData

if TYPE_CHECKING:  # a command imports only what it shows
    from ballbar.ident.robot.accuracy import TcpError
    from ballbar.result.compare import Comparison


def run_data(run: RunData, folder: Path) -> dict[str, object]:
    """JSON of `run` and `identify`: the calibration written to `folder`, comparison and limits.

    An identification from still poses without simulation has neither plant nor limits.
    """
    file = load(folder).file
    result: dict[str, object] = {
        "acceptable": run.acceptable,
        "sentence": run.identification.verdict.sentence,
        "folder": str(folder),
        "files": sorted(entry.name for entry in folder.iterdir() if entry.name in OUTPUTS),
        "calibration": file.model_dump(mode="json", by_alias=True),
    }
    limits = [asdict(limit) for limit in run.limits]
    if run.recordings:
        figures = run.simulation.figures if run.simulation else {"plant": None}
        comparison = comparison_data(run.comparison) if run.comparison else None
        return result | figures | {"comparison": comparison, "limits": limits}
    if run.simulation is None or run.comparison is None:
        return result
    errors = {
        "tcp_error": _tcp(run.comparison.tcp),
        "tcp_error_nominal": _tcp(run.comparison.tcp_nominal),
    }
    return result | run.simulation.figures | {"comparison": errors, "limits": limits}


def comparison_data(comparison: Comparison) -> dict[str, object]:
    """JSON of `compare`, SI units: errors are model minus reference."""
    clock = {"clock_offset_error_s": comparison.offset, "clock_skew_error": comparison.skew}
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
            **({} if comparison.offset is None else clock),
        }
    return {
        "tcp_error": _tcp(comparison.tcp),
        "tcp_error_nominal": _tcp(comparison.tcp_nominal),
        "deviations": {name: float(value) for name, value in comparison.deviations.items()},
        "distance": comparison.distance,
        **clock,
    }


def plan_data(folder: Path, *, feasible: bool) -> dict[str, object]:
    """JSON of `plan`: plan.yaml as written, and whether no limit was violated in the plant."""
    content = yaml.safe_load((folder / "plan.yaml").read_bytes())  # our own file of plain values
    return {
        "acceptable": feasible,
        "folder": str(folder),
        "files": sorted(entry.name for entry in folder.iterdir()),
        "plan": content,
    }


def _tcp(error: TcpError) -> dict[str, float]:
    without_scale = float(error.error_without_scale.mean())
    return _distances(error) | {"mean_without_scale_m": without_scale}


def _distances(error: TcpError) -> dict[str, float]:
    return {"mean_m": float(error.mean), "max_m": float(error.maximum)}
