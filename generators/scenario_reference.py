"""docs/scenario_reference.md: every key of a scenario with its values, default and meaning, from the schema itself.

python -m generators.scenario_reference
"""

from __future__ import annotations

import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen  # comes with pydantic
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ballbar.scenario import Scenario
from cell.files import write_whole

PAGE = Path(__file__).parents[1] / "docs/scenario_reference.md"
HEAD = """# Scenario reference

Every key that a scenario may have, written by `python -m generators.scenario_reference` from the schema that checks your file. A key
carries its unit in its name (`_m`, `_rad`, `_s`, `_N`, `_hz`). What is not given takes the default; an error source that is not given is
off, and one given as `{}` is on with its defaults. An unknown key, a value out of range or a wrong kind is refused with the file's line.
"""
_BOUNDS = ((Ge, "≥", "ge"), (Gt, ">", "gt"), (Le, "≤", "le"), (Lt, "<", "lt"))
_KINDS = {float: "number", int: "whole number", str: "text", bool: "true or false"}


def reference() -> str:
    """The page as text."""
    return HEAD + "".join(_sections("", Scenario)) + "\n"


def _sections(path: str, model: type[BaseModel]) -> Iterator[str]:
    """Heading and table of a model, then those of the models in it."""
    if path:
        yield f"\n{'#' * min(4, 2 + path.count('.'))} {path}\n\n{_sentence(model.__doc__)}\n"
    plain = {
        name: field for name, field in model.model_fields.items() if not _inner(field.annotation)
    }
    if plain:
        yield "\n| key | values | default | meaning |\n|---|---|---|---|\n"
        for name, field in plain.items():
            yield f"| `{field.alias or name}` | {_values(field)} | {_default(field)} | {field.description or ''} |\n"
    elif path and not model.model_fields:
        yield "\nNo keys: on or off.\n"
    for name, field in model.model_fields.items():
        for inner in _inner(field.annotation):
            yield from _sections(f"{path}.{name}" if path else name, inner)


def _inner(annotation: Any) -> list[type[BaseModel]]:
    """The models that a value of this kind may be, also those in a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _inner(part)]


def _values(field: FieldInfo) -> str:
    return _kind(field.annotation) + _bounds(field.metadata)


def _kind(annotation: Any) -> str:
    """The kind of value in words."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if annotation in _KINDS:
        return _KINDS[annotation]
    if origin is Literal:
        return ", ".join(f"`{part}`" for part in parts)
    if origin in (Union, types.UnionType):
        return " or ".join(_kind(part) for part in parts if part is not type(None))
    if origin is tuple:
        return (
            f"list of ({_kind(parts[0])})"
            if " " in _kind(parts[0])
            else f"list of {_kind(parts[0])}s"
        )
    if origin is dict:
        return f"map to {_kind(parts[1])}"
    if parts:  # Annotated
        return _kind(parts[0]) + _bounds(parts[1:])
    return str(getattr(annotation, "__name__", annotation))


def _bounds(metadata: Any) -> str:
    """Limits in words, empty if there are none."""
    found = [
        item
        for entry in metadata
        for item in (entry.metadata if isinstance(entry, FieldInfo) else [entry])
    ]
    words = [
        f"{sign} {getattr(item, key):g}"
        for item in found
        for kind, sign, key in _BOUNDS
        if isinstance(item, kind)
    ]
    least = next((item.min_length for item in found if isinstance(item, MinLen)), None)
    most = next((item.max_length for item in found if isinstance(item, MaxLen)), None)
    if least is not None and least == most:
        words.append(f"exactly {least}")
    elif least:
        words.append(f"at least {least}")
    return f" {', '.join(words)}" if words else ""


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "needed"
    value = field.get_default(call_default_factory=True)
    if value is None or value == "":
        return "none"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`{list(value)}`"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def _sentence(doc: str | None) -> str:
    """A docstring's first paragraph, on one line."""
    return " ".join((doc or "").strip().split("\n\n")[0].split())


if __name__ == "__main__":
    write_whole(PAGE, reference().encode())
    print(f"Wrote {PAGE}")
