"""Validation errors of YAML files as sentences: key, value, what was expected, nearest valid key.

pydantic reports what is wrong and where in the data; this module words it for the person who wrote
the file.
"""

from __future__ import annotations

import difflib
import re
import types
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import ErrorDetails, PydanticCustomError

Loc = tuple[str | int, ...]  # keys and list indices from the top of a file

MAX_LISTED = 30  # valid keys; more would hide the message
EXAMPLE_ITEMS = 6  # keys of a mapping that an example shows

RENAMED = {  # keys of earlier releases, and their names today
    "errors.lost_motion": "errors.gear_backlash",
    "encoders.senses": "encoders.directions",
}

_EXPECTED = {
    "float_type": "expected a number",
    "int_type": "expected a whole number",
    "int_from_float": "expected a whole number",
    "bool_type": "expected true or false",
    "string_type": "expected text",
    "list_type": "expected a list",
    "tuple_type": "expected a list",
    "dict_type": "expected a mapping of keys",
    "model_type": "expected a mapping of keys",
    "none_required": "expected nothing here (null)",
    "finite_number": "expected a finite number",
    "greater_than": "expected more than {gt}",
    "greater_than_equal": "expected {ge} or more",
    "less_than": "expected less than {lt}",
    "less_than_equal": "expected {le} or less",
    "literal_error": "expected {expected}",
    "too_short": "expected at least {min_length} items, found {actual_length}",
    "too_long": "expected at most {max_length} items, found {actual_length}",
    "string_too_short": "expected text of at least {min_length} characters",
    "string_too_long": "expected text of at most {max_length} characters",
    "string_pattern_mismatch": "expected text of the form {pattern}",
}


def wrong_key(*loc: str | int, message: str) -> PydanticCustomError:
    """Error of a model's own check that names the key at fault, below that model, and its line."""
    return PydanticCustomError("wrong_key", "{message}", {"message": message, "loc": loc})


def missing_key(*loc: str | int) -> PydanticCustomError:
    """Error of a model's own check that misses a key, as where a model needs it always."""
    return PydanticCustomError("missing", "missing", {"loc": loc})


@dataclass(frozen=True)
class Example:
    """A complete file of the same schema: its values show what a missing key looks like."""

    name: str
    data: dict[str, Any]


def explain(
    errors: Iterable[ErrorDetails],
    model: type[BaseModel],
    data: Any,
    example: Example | None = None,
) -> list[tuple[Loc, str]]:
    """Place in the data and sentence, `key.path = value: what was expected.`, of each error."""
    sentences = []
    for error in errors:
        if error["type"] == "too_short":  # pydantic omits items that are wrong
            count = len(_value_at(data, _place(error["loc"], data, missing=False)))
            if count >= int(error["ctx"]["min_length"]):
                continue
            error["ctx"]["actual_length"] = count
        sentences.append(_sentence(error, model, data, example))
    return sentences


def _sentence(
    error: ErrorDetails, model: type[BaseModel], data: Any, example: Example | None
) -> tuple[Loc, str]:
    kind, context = error["type"], error.get("ctx", {})
    raw = error["loc"]
    raw = (*raw, *context.get("loc", ()))
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        raw = (*raw, context["discriminator"].strip("'"))
    loc = _place(raw, data, missing=kind in ("missing", "union_tag_not_found"))
    key = _dotted(loc)
    if kind in ("missing", "union_tag_not_found"):
        return loc, f"{key} is missing. {_add_it(loc, model, example)}"
    if kind == "extra_forbidden":
        if key in RENAMED:
            return loc, f"unknown key {key}: it is now {RENAMED[key]}."
        hint = nearest(str(loc[-1]), _valid_keys(model, raw[:-1]), noun="key")
        return loc, f"unknown key {key}.{hint}"
    value = _value_at(data, loc)
    return loc, f"{key}{_shown(value)}: {_expectation(error, context, value)}."


def nearest(word: str, choices: Iterable[str], *, noun: str) -> str:
    """Hint for a word that is none of the choices: ` Did you mean x? Valid keys: x, y.`"""
    known = sorted(choices)
    close = difflib.get_close_matches(word, known, n=1)
    meant = f" Did you mean {close[0]}?" if close else ""
    listed = f" Valid {noun}s: {', '.join(known)}." if 0 < len(known) <= MAX_LISTED else ""
    return meant + listed


def _expectation(error: ErrorDetails, context: Mapping[str, Any], value: Any) -> str:
    kind = error["type"]
    if kind in ("value_error", "assertion_error"):
        return str(context["error"]).rstrip(".")
    if kind == "wrong_key":
        return str(context["message"]).rstrip(".")
    if kind == "union_tag_invalid":
        return f"expected one of {context['expected_tags']}"
    text = (
        _EXPECTED[kind].format(
            **{k: f"{v:g}" if isinstance(v, float) else v for k, v in context.items()}
        )
        if kind in _EXPECTED
        else error["msg"][0].lower() + error["msg"][1:]
    )
    if kind == "float_type" and isinstance(value, str) and re.fullmatch(r"[-+]?\d+,\d+", value):
        text += f"; write the decimal point as {value.replace(',', '.')}"
    elif kind in ("float_type", "int_type") and isinstance(value, str):
        text += ", without quotes or unit"
    elif kind == "literal_error":
        valid = re.findall(r"'([^']*)'", context["expected"])
        close = difflib.get_close_matches(str(value), valid, n=1)
        text += f"; the nearest is {close[0]}" if close else ""
    return text.rstrip(".")


def _place(raw: Loc, data: Any, *, missing: bool) -> Loc:
    """Part of pydantic's location that exists in the data, without names of union members."""
    loc: Loc = ()
    for i, part in enumerate(raw):
        if _has(data, part):
            loc, data = (*loc, part), data[part]
        elif missing and i == len(raw) - 1:
            loc = (*loc, part)
    return loc


def _has(data: Any, part: str | int) -> bool:
    if isinstance(data, dict):
        return part in data
    return isinstance(data, list) and isinstance(part, int) and part < len(data)


def _value_at(data: Any, loc: Loc) -> Any:
    for part in loc:
        data = data[part]
    return data


def _dotted(loc: Loc) -> str:
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc)
    return text.removeprefix(".") or "the file"


def _shown(value: Any) -> str:
    if isinstance(value, dict | list):
        return ""
    text = _flow(value).lower() if value is None or isinstance(value, bool) else repr(value)
    return f" = {text if len(text) <= 60 else text[:57] + '...'}"


def _add_it(loc: Loc, model: type[BaseModel], example: Example | None) -> str:
    """The line to add for a missing key, as the example has it, and whether the part is needed."""
    if isinstance(loc[-1], int):
        return f"The list {_dotted(loc[:-1])} needs at least {loc[-1] + 1} items."
    key, place = loc[-1], _dotted(loc[:-1])
    added = f"Add `{key}: ...` to {place}."
    if example and _holds(example.data, loc):
        value = _flow(_value_at(example.data, loc))
        added = f"Add yours to {place}; {example.name} has `{key}: {value}`."
    field = model.model_fields.get(str(loc[0])) if len(loc) > 1 else None
    if field is None or field.is_required():
        return added
    return f"{added} Or leave out {loc[0]}, which is optional."


def _holds(data: Any, loc: Loc) -> bool:
    return not loc or (_has(data, loc[0]) and _holds(data[loc[0]], loc[1:]))


def _flow(value: Any) -> str:
    """A value as YAML in one line; of rows and long mappings only the beginning."""
    if isinstance(value, dict):
        items = [f"{key}: {_flow(item)}" for key, item in list(value.items())[:EXAMPLE_ITEMS]]
        return f"{{{', '.join(items)}{', ...' if len(value) > EXAMPLE_ITEMS else ''}}}"
    if isinstance(value, list):
        rows = [item for item in value if isinstance(item, dict | list)]
        shown = [_flow(item) for item in (value[:1] if rows else value)]
        return f"[{', '.join(shown)}{', ...' if len(value) > len(shown) else ''}]"
    return "null" if value is None else str(value)


def _valid_keys(annotation: Any, raw: Loc) -> set[str]:
    """Valid keys at a location, from the model's annotations; empty where any key is valid."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        fields = {field.alias or name: field for name, field in annotation.model_fields.items()}
        if not raw:
            return set(fields)
        return _valid_keys(fields[str(raw[0])].annotation, raw[1:]) if raw[0] in fields else set()
    if origin is Annotated:
        return _valid_keys(inner[0], raw)
    if origin in (Union, types.UnionType):
        chosen = [member for member in inner if raw and _is_named(member, raw[0])]
        rest = raw[1:] if chosen else raw
        return set().union(*(_valid_keys(member, rest) for member in chosen or inner))
    if origin is dict and raw:
        return _valid_keys(inner[1], raw[1:])
    if origin in (list, tuple) and raw:
        repeated = origin is list or (len(inner) == 2 and inner[1] is Ellipsis)
        return _valid_keys(inner[0 if repeated else int(raw[0])], raw[1:])
    return set()


def _is_named(member: Any, part: str | int) -> bool:
    """Whether pydantic calls a union's member by this name: its class, or its discriminator."""
    while get_origin(member) is Annotated:
        member = get_args(member)[0]
    if not (isinstance(member, type) and issubclass(member, BaseModel)):
        return False
    literals = [
        get_args(f.annotation)
        for f in member.model_fields.values()
        if get_origin(f.annotation) is Literal
    ]
    return part == member.__name__ or any(part in values for values in literals)
