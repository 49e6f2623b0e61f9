"""The identified robot as JSON: parameters, deviations, corrections, DH rows, provenance."""

from __future__ import annotations

import json
from importlib.metadata import version

from ballbar.export.result import Result
from ballbar.export.rows import product_of_exponentials


def export_data(result: Result) -> dict[str, object]:
    """Plain data of schema `ballbar-export/1`, in m and rad; masses are in the robot's file."""
    file, chain = result.calibration.file, result.chain
    reasons = {entry.name: {"reason": entry.reason} for entry in file.dropped}
    parameters = {}
    for parameter in result.parameters:
        entry = file.parameters[parameter.name]
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
    return {
        "schema": "ballbar-export/1",
        "robot": result.name,
        "title": result.cell.robot.title,
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
        "provenance": {
            "ballbar": version("ballbar-bench"),
            "source": result.file.name,
            "sha256": result.sha256,
            "recordings": [entry.name for entry in file.recordings],
            "fit": fit | {"warnings": list(file.fit.warnings)},
        },
    }


def json_text(result: Result) -> str:
    """JSON text of `export_data`."""
    return json.dumps(export_data(result), indent=2) + "\n"
