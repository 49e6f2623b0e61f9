"""Calibration files for tests of what is done with a result: any geometry, any corrections."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ballbar.cell.descriptions import Cell
from ballbar.cell.files import write_yaml
from ballbar.cell.geometry import Geometry
from ballbar.ident.corrections import CORRECTIONS
from ballbar.result.calibration_schema import SCHEMA
from tests.helpers.six_axes import NAMES, SHARED

GEARS = ("joint_compliance", "gear_backlash", "gear_ripple")


def corrections_of(
    cell: Cell, names: tuple[str, ...], rng: np.random.Generator
) -> dict[str, dict[str, dict[str, object]]]:
    """Corrections with coefficients drawn about their priors."""
    out: dict[str, dict[str, dict[str, object]]] = {}
    for name in names:
        made = CORRECTIONS[name](cell, (1, 2, 4, 5)).coefficients
        out[name] = {
            c.name: {
                "value": float(c.mean + 0.3 * c.sigma * rng.standard_normal()),
                "sigma": 0.1 * c.sigma,
                "prior": c.mean,
                "prior_sigma": c.sigma,
                "information_gain": 0.9,
                "unit": c.unit,
            }
            for c in made
        }
    return out


def write_calibration_of(
    path: Path,
    nominal: Geometry,
    identified: Geometry,
    *,
    left: tuple[str, ...] = ("rd1", "rtheta1"),
    corrections: Mapping[str, object] | None = None,
    status: str = "good",
    robot: str = "irb2400",
) -> Path:
    """A calibration.yaml; `left` stays nominal in it and is marked so."""
    parameters = {}
    for name in NAMES:
        entry: dict[str, object] = {
            "nominal": nominal[name],
            "value": nominal[name] if name in left else identified[name],
        }
        parameters[name] = entry | (
            {"identified": False} if name in left else {"sigma": 2e-6, "identified": True}
        )
    shared = {name: parameters.pop(name) for name in SHARED}
    recording = {
        "name": "made",
        "encoder_directions": {f"b{j}": 1 for j in (1, 2, 4, 5)},
        "parameters": parameters,
        "noise": {"joint_rad": [1e-5] * 6, "encoder_rad": {"b1": 1e-5}},
        "residuals": {
            "samples": 500, "equations": 2500, "chi2": 2500.0,
            "position_rms_m": 1e-5, "angle_rms_rad": 1e-5,
        },
    }  # fmt: skip
    fit = {
        "status": status, "verdict": "Made for a test.", "warnings": [], "iterations": 4,
        "unknowns": 40, "chi2_per_dof": 1.0, "autocorrelation": 0.0, "rank": 40,
        "condition": 100.0, "rod_sigma_m": 1e-6, "tcp_sigma_mean_m": 1e-5,
    }  # fmt: skip
    write_yaml(
        path,
        {
            "schema": SCHEMA,
            "robot": robot,
            "instrument": "lund_600",
            "plate": "plate_250",
            "model": "complete" if corrections else "dh",
            "parameters": shared,
            "dropped": [{"name": name, "reason": "gauge -- held"} for name in left],
            "corrections": dict(corrections or {}),
            "recordings": [recording],
            "fit": fit,
        },
    )
    return path
