"""JSON lines: one object a sample, as the MQTT driver of a Comau C5G Open publishes them.

    {"J1": -12.34, ..., "J10": 0.0, "time": 1650000000123456}

`time` is whole microseconds of the PC's clock. Position, velocity and target come on topics of
their own: a file must hold one topic only, and two samples of one time are refused. Source:
CNR-STIIMA-IRAS/comau_c5gopen.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.formats.columns import DAMAGED_LIMIT, one_file, wanted_columns
from acquisition.table.header import Layout
from acquisition.table.table import Form, Table
from acquisition.table.text import read_text
from cell.errors import LogError

_LONGEST_LINE = 10_000  # characters; a sample has about 300, and nesting that deep is an attack


def read_json_lines(path: Path, file: str, time: str, layout: Layout) -> tuple[Table, Form]:
    """The wanted keys of every object, the time as whole numbers.

    Lines that are no such object are dropped and reported up to DAMAGED_LIMIT of all.
    Raises LogError beyond, if keys are missing, or if one time has two samples.
    """
    text = read_text(path, file)
    samples = [_sample(line) for line in text.lines]
    first = next((k for k, sample in enumerate(samples) if sample), None)
    if first is None:
        line = text.lines[0][:60]
        raise LogError(
            f"{file}:{text.number[0]}: {line!r} is no JSON object with numbers. "
            "Copy the file again, or name its dialect in recording.yaml."
        )
    keys, location = samples[first] or {}, f"{file}:{text.number[first]}"
    wanted = {time: "integer", **wanted_columns(layout, time, keys, location)}
    if time not in keys:
        raise LogError(
            f"{location}: {time} missing; the object has {', '.join(keys)}. "
            "Record a topic with it, or name the dialect of this file."
        )
    complete = np.array([_is_complete(sample, wanted) for sample in samples])
    damaged = np.flatnonzero(~complete)
    if damaged.size > max(1.0, DAMAGED_LIMIT * len(samples)):
        line = text.lines[int(damaged[0])]
        raise LogError(
            f"{file}:{text.number[damaged[0]]}: {damaged.size} of {len(samples)} lines are no "
            f"object with numbers for {', '.join(wanted)}: {line[:60]!r}. Whole numbers are needed "
            f"for {time}. Copy the file again, or remove these lines."
        )
    table = one_file({}, file, text.number, text.findings)
    if damaged.size:
        sentence = "no JSON object with all keys; treated as torn line and dropped."
        table = table.remarked("torn line", sentence, rows=damaged).take(complete)
    rows = [sample for sample, whole in zip(samples, complete, strict=True) if sample and whole]
    dtype = {"integer": np.int64}
    columns = {
        name: np.array([row[name] for row in rows], dtype=dtype.get(kind, np.float64))
        for name, kind in wanted.items()
    }
    table = replace(table, columns=columns)
    _refuse_topics(table, time, tuple(name for name in wanted if name != time))
    return table, Form(text.encoding, "JSON", "point", len(samples))


def _sample(line: str) -> dict[str, int | float] | None:
    """The numbers of an object by key; None if the line is no object, or has a key twice."""
    if len(line) > _LONGEST_LINE:
        return None
    try:
        parsed = json.loads(line, object_pairs_hook=_pairs, parse_constant=_refuse)
    except (ValueError, RecursionError):
        return None
    return parsed if isinstance(parsed, dict) else None


def _pairs(pairs: list[tuple[str, Any]]) -> dict[str, int | float]:
    if len({key for key, _ in pairs}) < len(pairs):
        raise ValueError("a key stands twice")
    return {key: value for key, value in pairs if type(value) in (int, float)}


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is no JSON")


def _is_complete(sample: dict[str, int | float] | None, wanted: Mapping[str, str]) -> bool:
    for name, kind in wanted.items():
        value = (sample or {}).get(name)
        if value is None or not -(2**63) <= value < 2**63:
            return False
        if not (type(value) is int if kind == "integer" else math.isfinite(value)):
            return False
    return True


def _refuse_topics(table: Table, time: str, names: tuple[str, ...]) -> None:
    """Raises LogError if one time has two samples that differ."""
    stamps = table.columns[time]
    order = np.argsort(stamps, kind="stable")
    same = np.flatnonzero(np.diff(stamps[order]) == 0)
    for name in names:
        values = table.columns[name][order]
        differs = same[values[same] != values[same + 1]]
        if differs.size:
            row = int(order[differs[0] + 1])
            raise LogError(
                f"{table.location(row)}: time {stamps[row]} has two samples, and {name} differs. "
                "Position, velocity and target in one file? Record one topic a file."
            )
