"""Dotted keys: `errors.joint_noise.sigma_rad` names a value of a YAML file, at any depth.

A number picks an item of a list, `cell.ballbar_position_m.0`. A key may itself hold dots where a
file writes it so, as those under `change` of a sweep. Nothing is evaluated.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cell.errors import InputError
from cell.schema_errors import Loc

Value = Any  # plain data of YAML: mapping, list, text, number, truth value, null


def with_changes(data: Mapping[str, Value], changes: Mapping[str, Value]) -> dict[str, Value]:
    """Plain data with the values at dotted keys replaced or added; `data` itself is unchanged.

    Raises InputError, beginning with the dotted key, when it leads through a value that holds
    nothing below it.
    """
    changed = dict(data)
    for key, value in changes.items():
        changed = _replaced(changed, location_of(changed, key), value)
    return changed


def location_of(data: Mapping[str, Value], key: str) -> Loc:
    """Keys and list indices that a dotted key stands for, whether its value exists or not.

    Raises InputError, beginning with the dotted key, as `with_changes`.
    """
    loc: Loc = ()
    node: Value = data
    rest = key
    while rest:
        step, node, rest = _step(node, rest, key)
        loc = (*loc, step)
    return loc


def overlap(key: str, other: str) -> bool:
    """Whether two dotted keys are equal or one lies below the other."""
    return f"{key}.".startswith(f"{other}.") or f"{other}.".startswith(f"{key}.")


def _step(node: Value, rest: str, key: str) -> tuple[str | int, Value, str]:
    """First key or index of the dotted key `rest` below `node`, its value, and the rest of the key.

    key : the whole dotted key, for the message.
    """
    head, _, below = rest.partition(".")
    if isinstance(node, list):
        if not head.isdecimal() or int(head) >= len(node):
            raise InputError(
                f"{key}: the list has no item {head}; its {len(node)} items count from 0. "
                "Name one of these"
            )
        return int(head), node[int(head)], below
    if node is not None and not isinstance(node, dict):
        raise InputError(
            f"{key}: the value {node!r} above {head} has no keys of its own. Name a key that exists"
        )
    held: dict[str, Value] = node or {}
    for written in sorted(held, key=len, reverse=True):
        if rest == written or rest.startswith(f"{written}."):
            return written, held[written], rest[len(written) + 1 :]
    return head, None, below


def _replaced(node: Value, loc: Loc, value: Value) -> Any:
    """`node` with `value` at a location below it."""
    if not loc:
        return value
    head, below = loc[0], loc[1:]
    if isinstance(head, int):
        return [*node[:head], _replaced(node[head], below, value), *node[head + 1 :]]
    held = node or {}
    return {**held, head: _replaced(held.get(head), below, value)}
