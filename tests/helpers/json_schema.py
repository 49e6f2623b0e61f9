"""Validation by JSON schema, draft 2020-12: the keywords that pydantic writes for our models."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

_TYPES: dict[str, Callable[[Any], bool]] = {
    "object": lambda v: isinstance(v, dict),
    "array": lambda v: isinstance(v, list),
    "string": lambda v: isinstance(v, str),
    "boolean": lambda v: isinstance(v, bool),
    "null": lambda v: v is None,
    "integer": lambda v: isinstance(v, int) and not isinstance(v, bool),
    "number": lambda v: isinstance(v, (int, float)) and not isinstance(v, bool),
}
_NUMBERS: dict[str, Callable[[float, float], bool]] = {
    "minimum": lambda v, limit: v >= limit,
    "maximum": lambda v, limit: v <= limit,
    "exclusiveMinimum": lambda v, limit: v > limit,
    "exclusiveMaximum": lambda v, limit: v < limit,
}
_SIZES: dict[str, tuple[type, Callable[[int, int], bool]]] = {
    "minItems": (list, lambda n, limit: n >= limit),
    "maxItems": (list, lambda n, limit: n <= limit),
    "minLength": (str, lambda n, limit: n >= limit),
    "maxLength": (str, lambda n, limit: n <= limit),
}
_NOTES = {"$schema", "$defs", "title", "description", "default", "discriminator", "examples"}
_OF_OTHERS = {"prefixItems", "additionalProperties"}  # looked at with items and properties


def faults(value: Any, schema: Any, root: dict[str, Any], place: str = "") -> Iterator[str]:
    """Places of a value that a schema does not allow; KeyError for a keyword not known here."""
    if isinstance(schema, bool):
        if not schema:
            yield place
        return
    for keyword, limit in schema.items():
        if keyword in _NOTES or (keyword in _OF_OTHERS and {"items", "properties"} & schema.keys()):
            continue
        yield from _KEYWORDS[keyword](value, limit, schema, root, place)


def _one(allowed: Callable[[Any, Any], bool]) -> Any:
    """A keyword that allows a value or not."""

    def check(value: Any, limit: Any, _: Any, __: Any, place: str) -> Iterator[str]:
        if not allowed(value, limit):
            yield place

    return check


def _reference(value: Any, name: str, _: Any, root: dict[str, Any], place: str) -> Iterator[str]:
    yield from faults(value, root["$defs"][name.removeprefix("#/$defs/")], root, place)


def _several(value: Any, parts: Any, _: Any, root: dict[str, Any], place: str) -> Iterator[str]:
    every = [list(faults(value, part, root, place)) for part in parts]
    if all(every):
        yield from min(every, key=len)


def _exactly_one(value: Any, parts: Any, _: Any, root: Any, place: str) -> Iterator[str]:
    if sum(not list(faults(value, part, root, place)) for part in parts) != 1:
        yield place


def _properties(
    value: Any, parts: Any, schema: Any, root: dict[str, Any], place: str
) -> Iterator[str]:
    for key, inner in value.items() if isinstance(value, dict) else ():
        part = parts.get(key, schema.get("additionalProperties", True))
        yield from faults(inner, part, root, f"{place}.{key}")


def _others(value: Any, part: Any, _: Any, root: dict[str, Any], place: str) -> Iterator[str]:
    yield from _properties(value, {}, {"additionalProperties": part}, root, place)


def _names(value: Any, part: Any, _: Any, root: dict[str, Any], place: str) -> Iterator[str]:
    for key in value if isinstance(value, dict) else ():
        yield from faults(key, part, root, f"{place}.{key}")


def _items(value: Any, part: Any, schema: Any, root: dict[str, Any], place: str) -> Iterator[str]:
    first = schema.get("prefixItems", [])
    for i, item in enumerate(value if isinstance(value, list) else ()):
        yield from faults(item, first[i] if i < len(first) else part, root, f"{place}[{i}]")


def _first(value: Any, parts: Any, _: Any, root: dict[str, Any], place: str) -> Iterator[str]:
    yield from _items(value, True, {"prefixItems": parts}, root, place)


def _required(value: Any, keys: Any, _: Any, __: Any, place: str) -> Iterator[str]:
    for key in keys if isinstance(value, dict) else ():
        if key not in value:
            yield f"{place}.{key}"


def _bound(check: Callable[[Any, Any], bool], kinds: Any, measure: Any = lambda v: v) -> Any:
    return _one(
        lambda v, limit: not isinstance(v, kinds) or isinstance(v, bool) or check(measure(v), limit)
    )


_KEYWORDS: dict[str, Any] = {
    "type": _one(lambda v, kind: _TYPES[kind](v)),
    "const": _one(lambda v, constant: v == constant),
    "enum": _one(lambda v, values: v in values),
    "pattern": _one(lambda v, form: not isinstance(v, str) or bool(re.search(form, v))),
    "$ref": _reference,
    "anyOf": _several,
    "oneOf": _exactly_one,
    "properties": _properties,
    "additionalProperties": _others,
    "propertyNames": _names,
    "items": _items,
    "prefixItems": _first,
    "required": _required,
    **{keyword: _bound(check, (int, float)) for keyword, check in _NUMBERS.items()},
    **{keyword: _bound(check, kind, len) for keyword, (kind, check) in _SIZES.items()},
}
