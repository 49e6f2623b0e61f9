"""docs/calibration_file.md: every key of calibration.yaml, from the schema that reads and writes it.

python -m generators.calibration_file
"""

from __future__ import annotations

import re
from pathlib import Path

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ballbar.result.calibration import CalibrationFile
from cell.files import write_whole
from generators.scenario_reference.keys import first_paragraph, models_in, values_text

PAGE = Path(__file__).parents[1] / "docs/calibration_file.md"
HEAD = """# calibration.yaml

What an identification leaves, in SI units: lengths in m, angles in rad, times in s. Written by
`python -m generators.calibration_file` from the schema; do not edit.

A parameter that was not identified stands at its nominal value with `identified: false`, and
`dropped` says why. Names of parameters: [conventions](conventions.md). A file of another schema
number is refused.
"""


def page_text() -> str:
    """The page: the keys at the top, then each entry that stands below them."""
    entries: dict[type[BaseModel], None] = {}
    _collect(CalibrationFile, entries)
    sections = (_section(_title(model), model) for model in entries)
    return HEAD + _section("Keys", CalibrationFile) + "".join(sections)


def _collect(model: type[BaseModel], entries: dict[type[BaseModel], None]) -> None:
    """Adds the models that a model holds, at any depth, each once."""
    for field in model.model_fields.values():
        for inner in models_in(field.annotation):
            if inner not in entries:
                entries[inner] = None
                _collect(inner, entries)


def _section(title: str, model: type[BaseModel]) -> str:
    """Heading, meaning and keys of a model; a column of meanings where the schema states one."""
    fields = {field.alias or name: field for name, field in model.model_fields.items()}
    described = any(field.description for field in fields.values())
    head = (
        "| key | values | meaning |\n|---|---|---|\n"
        if described
        else "| key | values |\n|---|---|\n"
    )
    rows = (
        f"| `{key}` | {_values(field)} |" + (f" {field.description or ''} |" if described else "")
        for key, field in fields.items()
    )
    return f"\n## {title}\n\n{first_paragraph(model)}\n\n{head}" + "".join(
        f"{row}\n" for row in rows
    )


def _values(field: FieldInfo) -> str:
    text = values_text(field)
    for inner in models_in(field.annotation):
        title = _title(inner)
        text = text.replace(inner.__name__, f"[{title}](#{title.lower().replace(' ', '-')})")
    return text


def _title(model: type[BaseModel]) -> str:
    """`StepFaultEntry` as Step fault entry."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", model.__name__).capitalize()


if __name__ == "__main__":
    write_whole(PAGE, page_text().encode())
    print(f"Wrote {PAGE}")
