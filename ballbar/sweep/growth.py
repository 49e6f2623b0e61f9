"""A sweep that has grown: more seeds, draws, values under `vary` or rows under `together`.

The runs of the earlier sweep are runs of the grown one under other numbers, so their rows are kept.
Anything else that differs makes another sweep.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import lru_cache

from ballbar.sweep.file import flattened
from ballbar.sweep.plan import Plan
from cell.extended_yaml import Value


def changed_keys(plan: Plan, earlier: Plan) -> list[str]:
    """Keys of a plan that differ from those of an earlier one by more than growth."""
    new, old = plan.data, earlier.data
    changed = [key for key in ("name", "version") if getattr(new, key) != getattr(old, key)]
    now, then = ({k: _text(v) for k, v in flattened(d.scenario).items()} for d in (new, old))
    different = sorted(key for key in now.keys() | then.keys() if now.get(key) != then.get(key))
    changed += [f"scenario.{key}" for key in different]
    changed += [f"files.{name}" for name in old.files if new.files.get(name) != old.files[name]]
    if bool(new.together) != bool(old.together) or not _holds(new.together, old.together):
        changed.append("together")
    if new.vary.keys() != old.vary.keys():
        changed.append("vary")
    else:
        changed += [f"vary.{key}" for key in new.vary if not _holds(new.vary[key], old.vary[key])]
    changed += [key for key in ("draw", "seed") if getattr(new, key) != getattr(old, key)]
    if (new.draws or 0) < (old.draws or 0):
        changed.append("draws")
    first, last = new.seeds.first, new.seeds.first + new.seeds.count
    if old.seeds.first < first or old.seeds.first + old.seeds.count > last:
        changed.append("seeds")
    return changed


def earlier_number(plan: Plan, number: int, earlier: Plan) -> int | None:
    """Number in an earlier plan of the run `number` of a grown one; None where it has none."""
    point, index = divmod(number, plan.seeds)
    seed = plan.data.seeds.first + index - earlier.data.seeds.first
    if not 0 <= seed < earlier.seeds:
        return None
    rows: dict[str, int] = {}
    for axis in reversed(plan.axes):
        point, rows[axis.key] = divmod(point, len(axis))
    result = 0
    for axis, place in zip(earlier.axes, _places(plan.text, earlier.text), strict=True):
        row = rows[axis.key] if place is None else place.get(rows[axis.key])
        if row is None or row >= len(axis):
            return None
        result = result * len(axis) + row
    return result * earlier.seeds + seed


@lru_cache(maxsize=8)
def _places(text: str, earlier_text: str) -> list[dict[int, int] | None]:
    """For each axis of an earlier plan: row of the grown plan -> row there.

    None for the draws, whose rows keep their numbers. The plans are given by their texts.
    """
    grown = {axis.key: axis.rows for axis in Plan(text).axes}
    places: list[dict[int, int] | None] = []
    for axis in Plan(earlier_text).axes:
        if axis.section == "draw":
            places.append(None)
            continue
        numbers = {_text(row): k for k, row in enumerate(axis.rows)}
        texts = enumerate(map(_text, grown[axis.key]))
        places.append({k: numbers[text] for k, text in texts if text in numbers})
    return places


def _holds(values: Sequence[Value], others: Sequence[Value]) -> bool:
    """Whether every one of the others is among the values."""
    return {_text(value) for value in others} <= {_text(value) for value in values}


def _text(value: Value) -> str:
    """Text by which plain data are compared: 1 and 1.0 differ, as they do in the table."""
    return json.dumps(value, sort_keys=True)
