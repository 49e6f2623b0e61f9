"""Strict reading of YAML files: a wrong file is refused with its line.

The YAML 1.2 core schema holds, where PyYAML itself still follows 1.1: `1e-5` and `1e4` are numbers,
`no`, `on` and `2016-05-30` are text, `1:30` is not sexagesimal, octal is `0o17`. Refused are
duplicate keys, anchors and aliases (a few lines of them expand to gigabytes), tags of other types,
keys that are not text, and files above 1 MB. Source: YAML 1.2.2, section 10.3 (core schema).
"""

from __future__ import annotations

import errno
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NoReturn, TypeVar, cast

import yaml
from pydantic import BaseModel, ValidationError

from ballbar.cell.core_yaml import SCALARS, TAG, root_node
from ballbar.cell.errors import DescriptionError
from ballbar.cell.foreign_files import read_regular
from ballbar.cell.foreign_text import is_printable, printable
from ballbar.cell.schema_errors import Example, Loc, explain

M = TypeVar("M", bound=BaseModel)

MAX_BYTES = 1_000_000  # far above any description; a log given by mistake is larger


@dataclass(frozen=True, order=True)
class Place:
    """Where a key, list item or value is written."""

    source: str  # a file, or an option of the command line
    line: int  # from 1; 0 of an option

    def __str__(self) -> str:
        return f"{self.source}:{self.line}" if self.line else self.source


Places = dict[Loc, Place]  # of each key and each list item
_At = Callable[[int], Place]  # place of a line, from 1


@dataclass(frozen=True, eq=False)
class YamlDocument:
    """Content of one YAML file, and the place of each part."""

    path: Path
    data: dict[str, Any]  # dicts, lists, str, int, float, bool, None
    places: Places

    def place_of(self, loc: Loc) -> Place:
        """Place of a key or list item, or of its nearest existing ancestor."""
        while loc not in self.places:
            loc = loc[:-1]
        return self.places[loc]


def _parsed(text: str, at: _At) -> yaml.Node | None:
    """The root node of a text. Raises DescriptionError naming the place where it is not YAML."""
    try:
        return root_node(text)
    except yaml.reader.ReaderError as error:
        _refuse(
            at(text.count("\n", 0, error.position) + 1),
            f"character U+{ord(text[error.position]):04X} is not allowed in YAML. "
            "Save the file as plain text.",
        )
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        _refuse(at(mark.line + 1 if mark else 1), _syntax_error(error))


def load_yaml(path: Path) -> YamlDocument:
    """The mapping in a YAML file.

    Raises DescriptionError naming file and line if the file cannot be read, is not UTF-8, is not
    YAML as described above, or holds no mapping.
    """
    return _document(path, _read_text(path))


def _document(path: Path, text: str) -> YamlDocument:
    at = partial(Place, str(path))
    root = _parsed(text, at)
    if root is None:
        raise DescriptionError(f"{path}: the file is empty; expected `key: value` lines.")
    if not isinstance(root, yaml.MappingNode):
        kind = "a list" if isinstance(root, yaml.SequenceNode) else "a single value"
        message = f"the file holds {kind}; expected `key: value` lines."
        _refuse(at(root.start_mark.line + 1), message)
    places: Places = {(): at(root.start_mark.line + 1)}
    return YamlDocument(path, _build(at, root, (), places), places)


def parse_value(text: str, option: str) -> Any:
    """The plain data of one YAML value, as of a command line; an empty text is null.

    option : what stands before the message of an error. Raises DescriptionError as `load_yaml`.
    """

    place = Place(option, 0)
    root = _parsed(text, lambda _: place)
    return None if root is None else _build(lambda _: place, root, (), {})


def load_model(path: Path, model: type[M], *, example: Path | None = None) -> M:
    """The content of a YAML file, checked against a pydantic model.

    example : a complete file of the same schema, from which an error quotes what is missing.

    A text that was read before is not checked again: a recording that is followed names the same
    descriptions every second.

    Raises DescriptionError with one line per error: file, line, key, value and what was expected.
    """
    return cast(M, _checked(path, _read_text(path), model, example))


@lru_cache(maxsize=32)
def _checked(path: Path, text: str, model: type[BaseModel], example: Path | None) -> BaseModel:
    return parse_model(_document(path, text), model, example=example)


def parse_model(document: YamlDocument, model: type[M], *, example: Path | None = None) -> M:
    """The content of a YAML document, checked against a pydantic model; raises as `load_model`.

    Validation is strict: the text "3" is not a number and `yes` not a truth value, but a list may
    become a tuple.
    """
    try:
        # In JSON mode, since pydantic's strict Python mode also refuses a list in place of a tuple.
        return model.model_validate_json(json.dumps(document.data), strict=True)
    except ValidationError as error:
        complete = Example(example.stem, load_yaml(example).data) if example else None
        sentences = explain(error.errors(include_url=False), model, document.data, complete)
        in_order = sorted((document.place_of(loc), text) for loc, text in sentences)
        raise DescriptionError("\n".join(f"{place}: {text}" for place, text in in_order)) from None


def check_schema(document: YamlDocument, schema: str, remedy: str) -> None:
    """Refuse a file of another version of its schema, before its keys are looked at.

    schema : the version that is read, such as `ballbar-truth/2`. remedy : how to get such a file.

    Raises DescriptionError if the file states another version of the same schema.
    """
    stated = document.data.get("schema")
    kind = schema.partition("/")[0] + "/"
    if isinstance(stated, str) and stated.startswith(kind) and stated != schema:
        _refuse(
            document.place_of(("schema",)),
            f"schema = {stated!r}: this release reads {schema}. {remedy}",
        )


def _read_text(path: Path) -> str:
    if path.is_dir():
        raise DescriptionError(f"{path}: this is a directory; name the YAML file within it.")
    try:
        raw = read_regular(path, MAX_BYTES)
    except FileNotFoundError:
        raise DescriptionError(f"{path}: no such file. Correct the name.") from None
    except OSError as error:
        remedy = "Check its permissions."
        if error.errno in (errno.EFBIG, errno.EINVAL):
            remedy = "So it is no description: was a log meant? Name the YAML file."
        raise DescriptionError(f"{path}: cannot be read: {error.strerror}. {remedy}") from None
    except ValueError as error:  # a NUL in the name
        raise DescriptionError(f"{path}: cannot be read: {error}. Correct the name.") from None
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        place = Place(str(path), raw.count(b"\n", 0, error.start) + 1)
        _refuse(place, f"byte 0x{raw[error.start]:02x} is not UTF-8. Save the file as UTF-8.")


def _syntax_error(error: yaml.MarkedYAMLError) -> str:
    problem = error.problem or "unreadable"
    if isinstance(error, yaml.composer.ComposerError) and error.context is None:
        return f"{problem}."
    hint = ""
    if "'\\t'" in problem:
        hint = " Indent with spaces, not tabs."
    elif "mapping values" in problem:
        hint = " Text that holds `: ` needs quotes; keys of one level need the same indentation."
    elif "but found another document" in problem:
        return "a second document starts here. Keep one per file: remove the `---` line."
    context = f" {error.context}" if error.context else ""
    return f"not valid YAML{context}: {problem}.{hint}"


def _build(at: _At, node: yaml.Node, loc: Loc, places: Places) -> Any:
    """Plain data of a node; adds the place of every key and item below it to `places`."""
    if isinstance(node, yaml.MappingNode) and node.tag == TAG + "map":
        return _build_mapping(at, node, loc, places)
    if isinstance(node, yaml.SequenceNode) and node.tag == TAG + "seq":
        for i, item in enumerate(node.value):
            places[*loc, i] = at(item.start_mark.line + 1)
        return [_build(at, item, (*loc, i), places) for i, item in enumerate(node.value)]
    if isinstance(node, yaml.ScalarNode) and node.tag in SCALARS:
        return _build_scalar(at, node)
    tag = node.tag.replace(TAG, "!!")
    return _refuse(
        at(node.start_mark.line + 1),
        f"tag {tag} is refused; only plain text, numbers, true, false, null, lists and mappings.",
    )


def _build_mapping(at: _At, node: yaml.MappingNode, loc: Loc, places: Places) -> dict[str, Any]:
    data: dict[str, Any] = {}
    for key_node, value_node in node.value:
        place = at(key_node.start_mark.line + 1)
        key = _build(at, key_node, loc, {}) if isinstance(key_node, yaml.ScalarNode) else None
        if not isinstance(key, str):
            shown = f"key {key_node.value}" if isinstance(key_node, yaml.ScalarNode) else "a key"
            _refuse(
                place,
                f"{shown} is not text. Put keys that look like numbers, true or null in quotes.",
            )
        if key in data:
            other = places[*loc, key]
            first = f"here and in line {other.line}" if other.line else "twice"
            _refuse(place, f"key {key} stands {first}. Remove one.")
        places[*loc, key] = place
        data[key] = _build(at, value_node, (*loc, key), places)
    return data


def _build_scalar(at: _At, node: yaml.ScalarNode) -> Any:
    pattern, convert = SCALARS[node.tag]
    place, tag = at(node.start_mark.line + 1), node.tag.removeprefix(TAG)
    shown = node.value if len(node.value) <= 40 else node.value[:37] + "..."
    if not pattern.match(node.value):
        _refuse(place, f"{shown!r} is no {tag}, as its tag says; leave the tag out.")
    if not is_printable(node.value, allowed="\n\t"):
        what = f"{printable(shown)!r} holds a control or invisible character. Write it without."
        _refuse(place, what)
    try:
        return convert(node.value)
    except ValueError:
        what = f"number {shown} is beyond what can be represented; write a smaller one."
        _refuse(place, what)


def _refuse(place: Place, what: str) -> NoReturn:
    raise DescriptionError(f"{place}: {what}") from None
