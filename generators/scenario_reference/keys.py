"""Keys as the page prints them: default, values and meaning, from the settings' models."""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Mapping
from functools import cache
from typing import Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen  # comes with pydantic
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ballbar.cell.schema import describe_keys
from ballbar.scenario import Scenario

_BOUNDS = ((Ge, "≥", "ge"), (Gt, ">", "gt"), (Le, "≤", "le"), (Lt, "<", "lt"))
_KINDS = {float: "number", int: "integer", str: "text", bool: "true or false"}


@cache
def keys_described() -> None:
    """Gives all keys their descriptions, once: it takes a second, so no import does it."""
    describe_keys()


def models_in(annotation: object) -> list[type[BaseModel]]:
    """Settings models that a field may hold, also inside tuples, options and choices."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def field_at(key: str) -> FieldInfo:
    """The field of a scenario that a dotted key names."""
    model: type[BaseModel] = Scenario
    *parents, last = key.split(".")
    for parent in parents:
        (model,) = models_in(model.model_fields[parent].annotation)
    return model.model_fields[last]


def first_paragraph(model: type[BaseModel]) -> str:
    """First paragraph of a model's docstring, on one line."""
    return " ".join((inspect.getdoc(model) or "").split("\n\n")[0].split())


def value_text(value: object) -> str:
    """A value as it is written in a scenario, to four digits."""
    if value is None:
        return "null"
    if value == "":
        return '""'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if not isinstance(value, float):
        return str(value)
    text = f"{value:.4g}"
    if "e" not in text and (value == 0.0 or 1e-3 < abs(value) < 1e4):
        return text if "." in text else text + ".0"
    mantissa, exponent = f"{value:.3e}".split("e")
    mantissa = mantissa.rstrip("0")
    return f"{mantissa}{'0' if mantissa.endswith('.') else ''}e{int(exponent)}"


def default_text(field: FieldInfo) -> str:
    """The default as it is written in a scenario; `required` for none."""
    if field.is_required():
        return "required"
    return value_text(field.get_default(call_default_factory=True))


def values_text(field: FieldInfo) -> str:
    """Kind and limits of the values, such as `number > 0, ≤ 1`, or `3 numbers -20 to 20`."""
    text = _kind(field.annotation) + _bounds(field.metadata)
    text = re.sub(r" [≥>] 0$", "", text)  # a size is not negative, which goes without saying
    text = re.sub(r"^list of (.*) exactly (\d+)$", r"\2 \1", text)
    return re.sub(r"^list of (.*) (at least \d+)$", r"\2 \1", text)


def row(key: str, field: FieldInfo) -> str:
    """Key, default, values and meaning as one line of a table; plain numbers need no kind."""
    values = re.sub(r"^number( |$)|^true or false$", "", values_text(field))
    meaning = (field.description or "").removesuffix(" Assumed.").replace("|", "\\|")
    return f"|`{key}`|`{default_text(field)}`|{values}|{meaning}|\n"


def table(fields: Mapping[str, FieldInfo]) -> str:
    """Table of keys; empty without one."""
    head = "|key|default|values|meaning|\n|---|---|---|---|\n"
    return "\n" + head + "".join(row(*item) for item in fields.items()) if fields else ""


def plain(section: str, model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Fields of a model that hold no model of their own, by their dotted keys."""
    return {
        f"{section}.{field.alias or name}".lstrip("."): field
        for name, field in model.model_fields.items()
        if not models_in(field.annotation)
    }


def _kind(annotation: Any) -> str:
    """The kind of value as text."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if annotation in _KINDS:
        return _KINDS[annotation]
    if origin is Literal:
        return ", ".join(f"`{part}`" for part in parts)
    if origin in (Union, types.UnionType):
        return " or ".join(_kind(part) for part in parts if part is not type(None))
    if origin is tuple:
        item = _kind(parts[0])
        word, blank, rest = item.partition(" ")
        return f"list of ({item})" if " or " in item else f"list of {word}s{blank}{rest}"
    if origin is dict:
        return f"map of names to {_kind(parts[1])}"
    if parts:  # Annotated
        return _kind(parts[0]) + _bounds(parts[1:])
    return str(getattr(annotation, "__name__", annotation))


def _bounds(metadata: Any) -> str:
    """Limits as text; empty if there are none."""
    limits = [
        item
        for entry in metadata
        for item in (entry.metadata if isinstance(entry, FieldInfo) else [entry])
    ]
    words = [
        f"{sign} {getattr(limit, key):g}"
        for limit in limits
        for kind, sign, key in _BOUNDS
        if isinstance(limit, kind)
    ]
    if len(words) == 2 and words[0][0] + words[1][0] == "≥≤":
        words = [f"{words[0][2:]} to {words[1][2:]}"]
    least = next((limit.min_length for limit in limits if isinstance(limit, MinLen)), None)
    most = next((limit.max_length for limit in limits if isinstance(limit, MaxLen)), None)
    if least is not None and least == most:
        words.append(f"exactly {least}")
    elif least:
        words.append(f"at least {least}")
    return f" {', '.join(words)}" if words else ""
