"""The identified robot as JSON: parameters, deviations, corrections, DH rows, provenance."""

from __future__ import annotations

import json
from importlib.metadata import version

from ballbar.export.result import AnyResult, PoseResult, Result
from ballbar.export.rows import product_of_exponentials


def export_data(result: AnyResult) -> dict[str, object]:
    """Plain data of schema `ballbar-export/1`, in m and rad; masses are in the robot's file."""
    file, chain = result.calibration.file, result.chain
    reasons = {} if isinstance(result, PoseResult) else _reasons(result)
    parameters = {}
    for parameter in result.parameters:
        entry = result.entry(parameter)
        parameters[parameter.name] = {
            "unit": parameter.unit,
            "nominal": entry.nominal,
            "value": entry.value,
            "sigma": entry.sigma,
            "identified": entry.identified,
        } | reasons.get(parameter.name, {})
    rows = {name: getattr(chain, name).tolist() for name in ("a", "d", "alpha", "theta", "beta")}
    screws, home = product_of_exponentials(chain)
    fit = {key: getattr(file.fit, key) for key in ("status", "verdict")}
    of_poses = _of_poses(result) if isinstance(result, PoseResult) else {}
    recordings = (
        list(dict.fromkeys(entry.file for entry in file.groups))
        if isinstance(result, PoseResult)
        else [entry.name for entry in file.logs]
    )
    return {
        "schema": "ballbar-export/1",
        "robot": result.name,
        "title": result.robot.title,
        "convention": "standard DH: Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta)",
        "rows": rows,
        "screws": screws.tolist(),
        "home": home.tolist(),
        "parameters": parameters,
        "corrections": {
            name: {k: c.model_dump() for k, c in entries.items()}
            for name, entries in file.corrections.items()
        },
        "not_in_rows": result.left_out,
        **of_poses,
        "provenance": {
            "ballbar": version("ballbar-bench"),
            "source": result.file.name,
            "sha256": result.sha256,
            "recordings": recordings,
            "fit": fit | {"warnings": list(file.fit.warnings)},
        },
    }


def json_text(result: AnyResult) -> str:
    """JSON text of `export_data`."""
    return json.dumps(export_data(result), indent=2) + "\n"


def _reasons(result: Result) -> dict[str, dict[str, str]]:
    """Why parameters stayed nominal."""
    return {entry.name: {"reason": entry.reason} for entry in result.calibration.file.dropped}


def _of_poses(result: PoseResult) -> dict[str, object]:
    """What a result of still poses has beside: targets, fitted ranges, orders, stated errors."""
    file = result.calibration.file
    plain = file.model_dump(mode="json")
    return {
        "targets": plain["targets"],
        "seats": plain["seats"],
        "fitted_ranges": plain["ranges"],
        "outside_fitted_ranges": "the error is unknown and may exceed that of the nominal robot",
        "orders": plain["orders"],
        "cross_validation": plain["cross_validation"],
        "held_out": plain["held_out"],
    }
