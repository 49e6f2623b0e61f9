"""Reference pages from schemas: calibration_file.md, plan_request.md and poses.md of docs/.

python -m generators.schema_pages
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ballbar.cell.files import write_whole
from ballbar.cell.pose_file import PosesFile
from ballbar.cell.schema import describe_keys
from ballbar.planning.pose_request import PosePlanRequest
from ballbar.planning.request import PlanRequest
from ballbar.result.calibration_schema import CalibrationFile
from ballbar.result.recording_entries import marks_of
from generators.scenario_reference.keys import default_text, first_paragraph, models_in, values_text

describe_keys()
DOCS = Path(__file__).parents[1] / "docs"
CALIBRATION = """# calibration.yaml

What an identification leaves, in SI units: lengths in m, angles in rad, times in s. Written by
`python -m generators.schema_pages` from the schema; do not edit.

A parameter that was not identified stands at its nominal value with `identified: false`, and
`dropped` says why. Names of parameters: [Conventions](conventions.md). A file of another schema
number is refused. `ranges` are the joint angles that were fitted; beyond them the error is unknown.

A result of still poses has `model: poses`. Its parameters with `identified: false` are known from
their priors more than from the poses; their values are those of the fit all the same, and belong to
the others. Gauge parameters (height and heading of the base, the last row) are nominal and not
listed. Seats are frames in the robot's base frame, targets in the flange's; a point has no
`rotation_vector_rad`. The stated 95 % region of a pose is a sphere of `sigma_m` along each axis,
`region_factor` times as large (squared) as that of chi-square with three degrees of freedom.

A key marked `of logs` or `of poses` stands only in results of logs, or of still poses.
"""
REQUEST = """# Plan request

The file of `ballbar plan REQUEST`; `scenarios/plans/irb2400.yaml` is a short one. Only `name` and
`cell` are needed. Written by `python -m generators.schema_pages` from the schema; do not edit.
Steps: [Plan a path](how_to/plan_a_path.md). Method: [Planning](planning.md).

A plan keeps a reserve inside the limits (1 deg, 10 mm, a tenth of rates, a fifth of the force), so
that the run on soft servo keeps the limits themselves. A request that allows nothing is refused
with the limit that excludes most and the nearest miss. Clearance is that of MuJoCo's
`mj_geomDistance` between capsules of robot and rod, the box of the plate, floor, pedestal and the
boxes of `keep_out`; radii are assumed shares of the length of the upper arm, or of the chain.

`cell` names either a `ballbar` or an `instrument` that measures its length. The latter takes no
`servo`, no `encoders`, `encoder_*`, `ballbar_rate_hz` and `rod_sigma_m` of `sensors`, and no
`ballbar_margin_deg`, `cable_turns` and `force_N` of `limits`: it has no encoders, cables or force.
Files that a request names stand relative to it. `extends: FILE` takes over another request:
[Vary and reuse files](how_to/reuse_files.md).
"""


POSES = """# poses.yaml

Describes tables of still poses: joint angles at which the robot stood, and what an instrument
measured there. Written by `python -m generators.schema_pages` from the schema; do not edit. Steps
and examples: [Read still poses](how_to/still_poses.md).
"""
POSE_REQUEST = """# Pose plan request

The file of `ballbar plan REQUEST` for still poses; `scenarios/plans/irb2400_tracker.yaml` is a
short one. Written by `python -m generators.schema_pages` from the schema; do not edit. Steps:
[Plan still poses](how_to/plan_still_poses.md). Method: [Planning](planning.md#still-poses).

Lists of axes have one value for each axis of the robot. Lengths within the stroke of a draw-wire or
telescoping ball-bar, the reach of a tracker and the noise follow from the instrument's file.
`extends: FILE` takes over another request: [Vary and reuse files](how_to/reuse_files.md).
"""


@dataclass(frozen=True)
class SchemaPage:
    """One page: file name, text at its head, schema, and whether people write the file."""

    name: str
    head: str
    schema: type[BaseModel]
    written_by_people: bool

    @property
    def path(self) -> Path:
        return DOCS / self.name

    def text(self) -> str:
        """The page: the keys at the top, then each model that stands below them."""
        models: dict[type[BaseModel], None] = {}
        _collect(self.schema, models)
        sections = (self._section(_title(model), model) for model in models)
        return self.head + self._section("Keys", self.schema) + "".join(sections)

    def _section(self, title: str, model: type[BaseModel]) -> str:
        """Heading, meaning and keys of a model; defaults in a file that people write."""
        fields = {field.alias or name: field for name, field in model.model_fields.items()}
        columns = ["key", "values"]
        columns += ["default"] if self.written_by_people else []
        kinds = {key: f"of {mark.kind}" for key, mark in marks_of(model)}
        columns += ["where"] if kinds else []
        columns += ["meaning"] if any(field.description for field in fields.values()) else []
        lines = [columns, ["---"] * len(columns)]
        for key, field in fields.items():
            cells = {
                "key": f"`{key}`",
                "values": _values(field),
                "default": f"`{default_text(field)}`" if not models_in(field.annotation) else "",
                "where": kinds.get(key, ""),
                "meaning": field.description or "",
            }
            lines.append([cells[column] for column in columns])
        table = "".join(f"| {' | '.join(line)} |\n" for line in lines)
        return f"\n## {title}\n\n{first_paragraph(model)}\n\n{table}"


PAGES = (
    SchemaPage("calibration_file.md", CALIBRATION, CalibrationFile, written_by_people=False),
    SchemaPage("plan_request.md", REQUEST, PlanRequest, written_by_people=True),
    SchemaPage("pose_plan_request.md", POSE_REQUEST, PosePlanRequest, written_by_people=True),
    SchemaPage("poses.md", POSES, PosesFile, written_by_people=True),
)


def _collect(model: type[BaseModel], models: dict[type[BaseModel], None]) -> None:
    """Adds the models that a model holds, at any depth, each once."""
    for field in model.model_fields.values():
        for inner in models_in(field.annotation):
            if inner not in models:
                models[inner] = None
                _collect(inner, models)


def _values(field: FieldInfo) -> str:
    text = values_text(field)
    for inner in models_in(field.annotation):
        title = _title(inner)
        link = f"[{title}](#{title.lower().replace(' ', '-')})"
        text = re.sub(rf"\b{inner.__name__}", link, text)
    return text


def _title(model: type[BaseModel]) -> str:
    """`StepFaultEntry` as Step fault, `PlanCell` as Cell."""
    name = model.__name__.removesuffix("Entry").removeprefix("Plan")
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).capitalize()


if __name__ == "__main__":
    for page in PAGES:
        write_whole(page.path, page.text().encode())
        print(f"Wrote {page.path}")
