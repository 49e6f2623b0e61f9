"""Base of the schemas of all YAML files, and the text and numbers that every schema takes."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from cell.foreign_text import csv_text, is_printable


class Strict(BaseModel):
    """A frozen model that refuses unknown keys, infinities and NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _one_printable_line(value: str) -> str:
    if not is_printable(value):
        raise ValueError("expected one line of printable text")
    return value


def _no_formula(value: str) -> str:
    if csv_text(value) != value:
        raise ValueError("expected a name that no spreadsheet takes for a formula")
    return value


TITLE_LENGTH = 200
# Text that stands in reports, tables and comments of controller programs.
Line = Annotated[str, Field(max_length=TITLE_LENGTH), AfterValidator(_one_printable_line)]
Name = Annotated[Line, AfterValidator(_no_formula)]  # one that tables are read back by
