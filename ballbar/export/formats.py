"""Formats of `ballbar export`, by name."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from ballbar.export.as_json import json_text
from ballbar.export.models import mjcf, urdf
from ballbar.export.names import Format
from ballbar.export.rapid import rapid_module
from ballbar.export.result import AnyResult
from ballbar.export.tables import dh_table, hayati_table, modified_dh_table, poe_table
from ballbar.export.ur_kinematics import ur_kinematics

FORMATS: dict[Format, Callable[[AnyResult], str]] = {
    "urdf": urdf,
    "mjcf": mjcf,
    "dh": dh_table,
    "mdh": modified_dh_table,
    "hayati": hayati_table,
    "poe": poe_table,
    "abb": rapid_module,
    "ur-kinematics": ur_kinematics,
    "json": json_text,
}


def exported(result: AnyResult, to: Format) -> str:
    """Text of the robot in a format. Raises InputError where the format cannot hold the robot."""
    return FORMATS[to](result)


def export_summary(
    result: AnyResult, to: Format | Literal["into"], content: bytes, out: Path | None
) -> dict[str, object]:
    """JSON of `export`: what was written; without a file it holds the text itself."""
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
        "warnings": result.range_notes,
    }
    return summary if out is not None else summary | {"text": content.decode()}
