"""Base of the schemas of all YAML files, and the text and numbers that every schema takes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import date
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from ballbar.cell.foreign_text import csv_text, is_printable
from ballbar.cell.schema_errors import Loc, wrong_key

# Largest magnitude of a number by the unit that its key ends in: far beyond any cell, and so small
# that squares and products stay finite.
LARGEST = {
    **{"m": 1e3, "mm": 1e6, "rad": 1e4, "mrad": 1e7, "deg": 1e6, "s": 1e10, "hz": 1e7},
    **{"kg": 1e6, "kg_m2": 1e6, "N": 1e9, "N_m": 1e9},
}
LARGEST_OTHER = 1e18  # without a unit in the key, or with a compound one: a stiffness, chi-square
LARGEST_COUNT = 2**63 - 1
SMALLEST = 1e-100  # magnitude of a number that is not zero
_UNIT = re.compile(rf"(?:^|_)({'|'.join(sorted(LARGEST, key=len, reverse=True))})$")


class Strict(BaseModel):
    """A frozen model that refuses unknown keys, infinities, NaN, and numbers beyond any quantity.

    The unit at the end of a key decides what is beyond; a sigma is not negative. The docstring
    below a key is its description in the references and in the JSON schemas (`describe_keys`).
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)

    @model_validator(mode="after")
    def _numbers_are_of_quantities(self) -> Self:
        for name, field in type(self).model_fields.items():
            key = field.alias or name
            for loc, value in _numbers(getattr(self, name), (key,)):
                if reason := _beyond(key, value):
                    raise wrong_key(*loc, message=reason)
        return self


def describe_keys() -> None:
    """Gives the keys of all schemas that are imported the docstrings below them as descriptions.

    Reading them from the sources takes as long as the schemas, and no file is read by them.
    """
    from pydantic._internal._docs_extraction import extract_docstrings_from_cls  # noqa: PLC0415

    kinds: list[type[Strict]] = [Strict]
    for kind in kinds:
        kinds += [other for other in kind.__subclasses__() if other not in kinds]
    written = {kind: extract_docstrings_from_cls(kind, use_inspect=True) for kind in kinds}
    for kind in kinds:
        for key, field in kind.model_fields.items():
            texts = (written[base][key] for base in kind.__mro__ if key in written.get(base, {}))
            field.description = " ".join((field.description or next(texts, "")).split()) or None
        for built in ("core_schema", "validator", "serializer"):
            if f"__pydantic_{built}__" in vars(kind):
                delattr(kind, f"__pydantic_{built}__")
    for kind in kinds:
        kind.model_rebuild(force=True)


def _numbers(value: Any, loc: Loc) -> Iterator[tuple[Loc, float]]:
    """Numbers of a value and of the lists and mappings in it, with their places."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        yield loc, value
    elif isinstance(value, (tuple, list)):
        for i, item in enumerate(value):
            yield from _numbers(item, (*loc, i))
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _numbers(item, (*loc, key))


def _beyond(key: str, value: float) -> str:
    """The expectation that a number of this key does not meet; empty where it does."""
    unit = None if "_per_" in key else _UNIT.search(key)
    most = LARGEST_COUNT if isinstance(value, int) else LARGEST_OTHER
    most = LARGEST[unit[1]] if unit else most
    if abs(value) > most:
        return f"expected at most {most:g} in magnitude"
    if 0.0 < abs(value) < SMALLEST:
        return f"expected 0, or more than {SMALLEST:g} in magnitude"
    return "expected 0 or more" if value < 0 and "sigma" in key.split("_") else ""


def _one_printable_line(value: str) -> str:
    if not is_printable(value):
        raise ValueError("expected one line of printable text")
    return value


def _no_formula(value: str) -> str:
    if csv_text(value) != value:
        raise ValueError("expected a name that no spreadsheet takes for a formula")
    return value


def _a_day(value: str) -> str:
    try:
        return date.fromisoformat(value).isoformat()
    except ValueError:
        raise ValueError("expected a day such as 2026-03-31") from None


TITLE_LENGTH = 200
# Text that stands in reports, tables and comments of controller programs.
Line = Annotated[str, Field(max_length=TITLE_LENGTH), AfterValidator(_one_printable_line)]
Name = Annotated[Line, AfterValidator(_no_formula)]  # one that tables are read back by
Day = Annotated[str, AfterValidator(_a_day)]
NotNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]
EncoderLines = Annotated[int, Field(gt=0, le=10_000_000)]  # of an encoder, per turn
