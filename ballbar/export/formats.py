"""What `ballbar export` writes: the formats by name."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from ballbar.export.as_json import json_text
from ballbar.export.models import mjcf, urdf
from ballbar.export.rapid import rapid_module
from ballbar.export.result import Result
from ballbar.export.tables import dh_table, hayati_table, modified_dh_table, poe_table
from cell.errors import InputError
from cell.files import write_whole

Format = Literal["urdf", "mjcf", "dh", "mdh", "hayati", "poe", "abb", "json"]
FORMATS: dict[Format, Callable[[Result], str]] = {
    "urdf": urdf,
    "mjcf": mjcf,
    "dh": dh_table,
    "mdh": modified_dh_table,
    "hayati": hayati_table,
    "poe": poe_table,
    "abb": rapid_module,
    "json": json_text,
}


def exported(result: Result, to: Format) -> str:
    """The text of one format. Raises InputError where a format cannot hold the robot."""
    return FORMATS[to](result)


def export_summary(result: Result, to: Format, text: str, out: Path | None) -> dict[str, object]:
    """What was exported, for --json; without a file the text itself is in it."""
    sigma = {
        name: e.sigma
        for name, e in result.calibration.file.parameters.items()
        if name.startswith("r") and e.sigma is not None
    }
    said: dict[str, object] = {
        "format": to,
        "robot": result.name,
        "source_sha256": result.sha256,
        "file": None if out is None else str(out),
        "sha256": hashlib.sha256(text.encode()).hexdigest(),
        "identified": len(sigma),
        "left_out": result.left_out,
    }
    return said if out is not None else said | {"text": text}


def write_export(out: Path, text: str) -> None:
    """Writes an exported text whole or not at all. Raises InputError rather than write over a file."""
    if out.exists():
        raise InputError(
            f"{out}: exists already; nothing was written. Name another file with --out."
        )
    write_whole(out, text.encode())
