"""Formats of `ballbar export`, by name: each is a function from a result to text."""

from __future__ import annotations

import hashlib
import json
from importlib.metadata import version
from pathlib import Path

from ballbar.cell.plugins import PluginTable
from ballbar.export.hand_eye import hand_eye
from ballbar.export.models import mjcf, urdf
from ballbar.export.rapid import rapid_module
from ballbar.export.result import Result
from ballbar.export.rows import product_of_exponentials
from ballbar.export.tables import dh_table, hayati_table, modified_dh_table, poe_table
from ballbar.export.ur_kinematics import ur_kinematics


def json_text(result: Result) -> str:
    """JSON of schema `ballbar-export/1`, in m and rad; masses are in the robot's file.

    Parameters, corrections, DH rows and provenance; of still poses also targets, seats, fitted
    ranges, orders and the errors that the result states.
    """
    file, chain = result.calibration.file, result.chain
    reasons = {entry.name: {"reason": entry.reason} for entry in file.dropped}
    parameters = {}
    for parameter in result.parameters:
        entry, reason = result.entry(parameter), reasons.get(parameter.name, {})
        parameters[parameter.name] = {"unit": parameter.unit} | entry.model_dump() | reason
    screws, home = product_of_exponentials(chain)
    of_poses: dict[str, object] = {}
    if not result.calibration.of_logs:
        plain = file.model_dump(mode="json")
        of_poses = {
            "targets": plain["targets"],
            "seats": plain["seats"],
            "fitted_ranges": plain["ranges"],
            "outside_fitted_ranges": "the error is unknown and may exceed that of the nominal "
            "robot",
        } | {key: plain[key] for key in ("orders", "cross_validation", "held_out")}
    data: dict[str, object] = {
        "schema": "ballbar-export/1",
        "robot": result.name,
        "title": result.robot.title,
        "convention": "standard DH: Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta)",
        "rows": {key: getattr(chain, key).tolist() for key in ("a", "d", "alpha", "theta", "beta")},
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
            "recordings": [entry.name for entry in file.logs]
            or list(dict.fromkeys(entry.file for entry in file.groups)),
            "fit": {key: getattr(file.fit, key) for key in ("status", "verdict")}
            | {"warnings": list(file.fit.warnings)},
        },
    }
    return json.dumps(data, indent=2) + "\n"


FORMATS = PluginTable(
    "exports",
    {
        "urdf": urdf,
        "mjcf": mjcf,
        "dh": dh_table,
        "mdh": modified_dh_table,
        "hayati": hayati_table,
        "poe": poe_table,
        "abb": rapid_module,
        "ur-kinematics": ur_kinematics,
        "hand-eye": hand_eye,
        "json": json_text,
    },
)


def exported(result: Result, to: str) -> str:
    """Text of the robot in a format.

    Raises InputError where there is no such format, or it cannot hold the robot.
    """
    return FORMATS[FORMATS.known(to, f" format {to!r}")](result)


def export_summary(
    result: Result, to: str, content: bytes, out: Path | None, ranges: list[str]
) -> dict[str, object]:
    """JSON of `export`: what was written; without a file it holds the text itself.

    ranges : lines of text on the ranges that the joints were fitted over.
    """
    summary: dict[str, object] = {
        "format": to,
        "robot": result.name,
        "source_sha256": result.sha256,
        "file": None if out is None else str(out),
        "sha256": hashlib.sha256(content).hexdigest(),
        "identified": sum(
            result.entry(parameter).sigma is not None for parameter in result.parameters
        ),
        "left_out": result.left_out,
        "warnings": ranges,
    }
    return summary if out is not None else summary | {"text": content.decode()}
