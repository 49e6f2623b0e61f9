"""Keys of files from their schemas: the end of calibration_file.md, plan_request.md and poses.md.

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
from ballbar.planning.pose_request import PosePlanRequest
from ballbar.planning.request import PlanRequest
from ballbar.result.calibration_schema import CalibrationFile
from ballbar.result.recording_entries import marks_of
from generators.scenario_reference.keys import (
    default_text,
    first_paragraph,
    keys_described,
    models_in,
    values_text,
)

DOCS = Path(__file__).parents[1] / "docs"
KEYS = "## Keys\n"  # what stands above the first one is written by people


@dataclass(frozen=True)
class SchemaPage:
    """One page: file name, schemas with their titles, and whether people write the file."""

    name: str
    schemas: dict[str, type[BaseModel]]
    written_by_people: bool = True

    @property
    def path(self) -> Path:
        return DOCS / self.name

    def text(self) -> str:
        """The page: what people wrote above its keys, then each schema and the models it holds."""
        keys_described()
        head, _, _ = self.path.read_text().partition(KEYS)
        models: dict[type[BaseModel], None] = {}
        sections = []
        for title, schema in self.schemas.items():
            before = set(models)
            _collect(schema, models)
            sections.append(self._section(title, schema))
            sections += [self._section(_title(m), m) for m in models if m not in before]
        return head + "\n".join(sections)

    def _section(self, title: str, model: type[BaseModel]) -> str:
        """Heading, meaning and keys of a model; defaults in a file that people write."""
        kinds = {key: f"; of {mark.kind}" for key, mark in marks_of(model)}
        items = [
            self._item(field.alias or name, field, kinds.get(field.alias or name, ""))
            for name, field in model.model_fields.items()
        ]
        listed = "\n".join(f"- {item}" for item in items)
        keys = listed if self.written_by_people else ",\n".join(items)
        return f"## {title}\n\n{first_paragraph(model)}\n\n{keys}\n"

    def _item(self, key: str, field: FieldInfo, kind: str) -> str:
        """One key: default, values, kind of result and meaning."""
        default = default_text(field) if self.written_by_people else "null"
        if default in ("required", "null") or models_in(field.annotation):
            kind = ", required" + kind if default == "required" else kind
        else:
            key = f"{key}: {default}"
        meaning = f": {field.description}" if field.description else ""
        values = _values(field)
        if not self.written_by_people:  # kinds and limits of what a program wrote say the obvious
            values = re.sub(r"\b(numbers?|integers?) (-?\d+ to \d+|[≥>] \d+)", r"\1", values)
            values = re.sub(r"^(integer|true or false)$", "", values)
        values = values.replace("integer 1 to 9999 or text", "name or number")  # of a column
        values = re.sub(r"^(text$|number$|number (?=[^o]))", "", values)  # the key says which
        about = re.sub(r"^[;,] ", "", f"{values}{kind}")
        return f"`{key}`{f' ({about})' if about else ''}{meaning}"


PAGES = (
    SchemaPage("calibration_file.md", {"Keys": CalibrationFile}, written_by_people=False),
    SchemaPage("plan_request.md", {"Keys": PlanRequest, "Keys for still poses": PosePlanRequest}),
    SchemaPage("poses.md", {"Keys": PosesFile}),
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
