"""The YAML 1.2 core schema on PyYAML's scanner: nodes of a text, and a dumper that reads back.

`1e-5` and `1e4` are numbers, `no`, `on` and `2016-05-30` are text. Anchors, aliases and texts of
many nodes are refused. Source: YAML 1.2.2, section 10.3.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import yaml

MAX_NODES = 100_000  # keys and values; a calibration has some thousand
MAX_DEPTH = 40  # nesting of the deepest description is below 10
TAG = "tag:yaml.org,2002:"


def _to_float(text: str) -> float:
    value = float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    if math.isinf(value) and "inf" not in text.lower():
        raise ValueError("beyond the largest number")
    return value


_Scalar = tuple[re.Pattern[str], Callable[[str], Any]]
# In this order: every whole number also looks like a float.
SCALARS: dict[str, _Scalar] = {
    TAG + "null": (re.compile(r"(?:null|Null|NULL|~|)\Z"), lambda _: None),
    TAG + "bool": (
        re.compile(r"(?:true|True|TRUE|false|False|FALSE)\Z"),
        lambda text: text.lower() == "true",
    ),
    TAG + "int": (
        re.compile(r"(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)\Z"),
        lambda text: int(text, 0 if text[:2] in ("0o", "0x") else 10),
    ),
    TAG + "float": (
        re.compile(
            r"(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))\Z"
        ),
        _to_float,
    ),
    TAG + "str": (re.compile(r"", re.DOTALL), str),
}


class _Core(yaml.composer.Composer, yaml.resolver.Resolver):
    """Composer of nodes with the scalars of the core schema; constructs no objects."""

    depth = 0
    nodes = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[attr-defined]  # the parser's
        if getattr(event, "anchor", None) is not None:
            sign = "*" if isinstance(event, yaml.AliasEvent) else "&"
            raise yaml.composer.ComposerError(
                None,
                None,
                f"{sign}{event.anchor}: anchors and aliases are refused; write the value out",
                event.start_mark,
            )
        self.nodes += 1
        too_much = ""
        if self.nodes > MAX_NODES:
            too_much = f"more than {MAX_NODES} keys and values; no description has as many"
        elif self.depth >= MAX_DEPTH:
            too_much = f"nested more than {MAX_DEPTH} levels deep; write it flatter"
        if too_much:
            raise yaml.composer.ComposerError(None, None, too_much, event.start_mark)
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


_Core.yaml_implicit_resolvers = {
    None: [(tag, scalar[0]) for tag, scalar in SCALARS.items() if tag != TAG + "str"]
}


class CoreDumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Quotes what this schema reads as a number too: `1e-12` is text to PyYAML's own dumper."""


for _tag, (_pattern, _) in SCALARS.items():
    if _tag != TAG + "str":
        CoreDumper.add_implicit_resolver(_tag, _pattern, None)


class _CoreLoader(_Core, yaml.SafeLoader):
    """With PyYAML's scanner and parser."""


if yaml.__with_libyaml__:

    class _FastLoader(_Core, yaml.CSafeLoader):
        """With libyaml's scanner and parser, which are five times as fast."""

        def __init__(self, text: str) -> None:
            yaml.CSafeLoader.__init__(self, text)
            yaml.composer.Composer.__init__(self)


def root_node(text: str) -> yaml.Node | None:
    """The root node of a text.

    Where libyaml refuses a text, PyYAML gives the reason. libyaml accepts a tab, a `?` and a `!` in
    places where PyYAML does not; both read a text without these the same way.
    """
    if yaml.__with_libyaml__ and text.isascii() and not any(mark in text for mark in "\t?!"):
        try:
            return _FastLoader(text).get_single_node()
        except yaml.YAMLError:
            pass
    return _CoreLoader(text).get_single_node()
