"""The identified robot as plain JSON: parameters, sigma, corrections, rows, provenance."""

from __future__ import annotations

import json
from importlib.metadata import version

import numpy as np

from ballbar.export.result import ROBOT, Result
from ballbar.export.rows import product_of_exponentials


def export_data(result: Result) -> dict[str, object]:
    """Schema `ballbar-export/1`; lengths in m, angles in rad, masses left to the robot's file."""
    file, chain = result.calibration.file, result.chain
    reasons = {one.name: one.reason for one in file.dropped}
    parameters = {}
    for p in ROBOT:
        entry = file.parameters[p.name]
        state: dict[str, object] = {
            "unit": p.unit,
            "nominal": entry.nominal,
            "value": entry.value,
            "sigma": entry.sigma,
        }
        state["identified"] = entry.identified
        if p.name in reasons:
            state["reason"] = reasons[p.name]
        parameters[p.name] = state
    screws, home = product_of_exponentials(chain)
    return {
        "schema": "ballbar-export/1",
        "robot": result.name,
        "title": result.cell.robot.title,
        "convention": "standard DH: Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta)",
        "rows": {
            name: np.asarray(getattr(chain, name)).tolist()
            for name in ("a", "d", "alpha", "theta", "beta")
        },
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
            "recordings": [recording.name for recording in file.recordings],
            "fit": {
                "status": file.fit.status,
                "verdict": file.fit.verdict,
                "warnings": list(file.fit.warnings),
            },
        },
    }


def json_text(result: Result) -> str:
    """The data as text."""
    return json.dumps(export_data(result), indent=2) + "\n"
