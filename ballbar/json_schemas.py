"""JSON schemas of all YAML files, by which editors complete keys and mark errors while one types.

They follow from the models that the files are checked against. What only code can check (sums,
orders, names of files) is not in them: a file that an editor accepts may still be refused.
"""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from ballbar.cell.ballbar_files import BallBarFile, PlateFile
from ballbar.cell.board import BoardFile
from ballbar.cell.description_files import RobotFile
from ballbar.cell.dialect import Dialect
from ballbar.cell.extended_yaml import EXTENDS
from ballbar.cell.instrument import InstrumentFile
from ballbar.cell.pose_file import PosesFile
from ballbar.cell.recording import RecordingFile
from ballbar.cell.schema import describe_keys
from ballbar.certificate.details import CertificateDetails
from ballbar.claims.file import ClaimFile
from ballbar.planning.pose_request import PosePlanRequest
from ballbar.planning.request import PlanRequest
from ballbar.result.calibration_schema import CalibrationFile
from ballbar.scenario import Scenario
from ballbar.sim.path_files import LissajousFile, PushPullFile
from ballbar.sim.truth import PoseTruth, Truth
from ballbar.sweep.file import SweepFile

DRAFT = "https://json-schema.org/draft/2020-12/schema"
EXTENDABLE: dict[str, type[BaseModel]] = {
    "scenario": Scenario,
    "sweep": SweepFile,
    "plan-request": PlanRequest,
    "pose-plan-request": PosePlanRequest,
}
KINDS: dict[str, type[BaseModel]] = {
    **EXTENDABLE,
    "claims": ClaimFile,
    "path": LissajousFile,
    "push-pull-path": PushPullFile,
    "robot": RobotFile,
    "ballbar": BallBarFile,
    "instrument": InstrumentFile,
    "plate": PlateFile,
    "board": BoardFile,
    "dialect": Dialect,
    "recording": RecordingFile,
    "poses": PosesFile,
    "calibration": CalibrationFile,
    "certificate-details": CertificateDetails,
    "truth": Truth,
    "pose-truth": PoseTruth,
}
describe_keys()
_BASE = {
    "type": "string",
    "title": "Extends",
    "description": "File whose values hold where this one states none: relative to this file, or "
    "the name of a shipped one.",
}


def json_schema(kind: str) -> dict[str, Any]:
    """The JSON schema of a kind of file, a key of KINDS.

    Where a file may extend another, only the keys at the top are required, and without `extends`
    alone: the base may hold all others.
    """
    schema = {"$schema": DRAFT} | KINDS[kind].model_json_schema()
    if kind in EXTENDABLE:
        required = schema["required"]
        _leave_to_base(schema, schema, set())
        schema["properties"][EXTENDS] = _BASE
        schema["anyOf"] = [{"required": [EXTENDS]}, {"required": required}]
    return schema


def _leave_to_base(part: dict[str, Any], schema: dict[str, Any], seen: set[str]) -> None:
    """Requires no key of a mapping of `part`, at any depth; items of lists stay as they are."""
    part.pop("required", None)
    inner = [*part.get("properties", {}).values(), *part.get("anyOf", ()), *part.get("oneOf", ())]
    if (name := str(part.get("$ref", "")).rpartition("/")[2]) and name not in seen:
        seen.add(name)
        inner.append(schema["$defs"][name])
    for below in inner:
        _leave_to_base(below, schema, seen)
