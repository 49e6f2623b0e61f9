"""Which run is which: run k of a sweep -> its point, its seed, its scenario; computed from k, so nothing is listed.

The points are the product of axes: the rows of `together`, then each key of `vary` in the order of the file, then the
draws. The last axis changes fastest, and within a point the seeds. The plan is plain data; its text goes to the workers,
and its hash says whether two folders hold the same sweep.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

from ballbar.scenario import Scenario
from ballbar.sweep.file import LABEL, SEED, Changes, Value
from cell.arrays import Array
from cell.errors import InputError
from sim.streams import stream

PART_RUNS = 25  # most runs of a part: with 40 ms a run, a part is lost (kill -9) or written every second and worker
MIN_PARTS = 50  # of a sweep with at least as many runs, so that a few hundred runs still keep every worker busy


@dataclass(frozen=True, eq=False)
class Axis:
    """One factor of the product of points."""

    section: str  # of the sweep file: together, vary, draw
    rows: Sequence[Changes]

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True, eq=False)
class Draws(Sequence[Changes]):
    """The rows of the draw axis, each made when asked for."""

    raw: Mapping[str, Array]  # (draws,) standard variates of each key
    distributions: Mapping[str, Mapping[str, Sequence[float]]]

    def __len__(self) -> int:
        return min(len(column) for column in self.raw.values())

    def __getitem__(self, index: Any) -> Any:  # no slices: rows are asked for one by one
        return {
            key: _drawn(self.distributions[key], float(column[index]))
            for key, column in self.raw.items()
        }


@dataclass(frozen=True, eq=False)
class Run:
    """One run of a sweep."""

    number: int  # from 0
    point: int  # from 0
    seed: int
    values: Changes  # what varies: dotted key (or label) -> value
    scenario: Scenario


@dataclass(frozen=True, eq=False)
class Plan:
    """A sweep whose every run is known."""

    text: str  # JSON: everything below follows from it

    @cached_property
    def data(self) -> dict[str, Any]:
        """name, version, scenario (plain data, `change` applied), together, vary, draw, draws, seed, seeds, files (hashes)."""
        return dict(json.loads(self.text))

    @cached_property
    def digest(self) -> str:
        """Of everything that decides the table."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        return _axes(self.data)

    @property
    def name(self) -> str:
        return str(self.data["name"])

    @property
    def seeds(self) -> int:
        """Runs of each point."""
        return int(self.data["seeds"]["count"])

    @cached_property
    def points(self) -> int:
        return math.prod(len(axis) for axis in self.axes)

    @property
    def runs(self) -> int:
        return self.points * self.seeds

    @cached_property
    def cell_runs(self) -> int:
        """Runs of one point of the grid: its draws and their seeds, which follow each other."""
        return self.seeds * math.prod(len(axis) for axis in self.axes if axis.section == "draw")

    @property
    def part_runs(self) -> int:
        """Runs of a part; follows from the number of runs alone, so that the parts are the same whoever computes them."""
        return max(1, min(PART_RUNS, self.runs // MIN_PARTS))

    @property
    def parts(self) -> int:
        return -(-self.runs // self.part_runs)

    def part(self, number: int) -> range:
        """Runs of a part."""
        return range(number * self.part_runs, min((number + 1) * self.part_runs, self.runs))

    @cached_property
    def columns(self) -> dict[str, list[Value]]:
        """Key of every varied value (or `label`) -> values by which its column gets a type: all of them, or one of the drawn."""
        columns: dict[str, list[Value]] = {}
        for axis in self.axes:
            for row in [axis.rows[0]] if axis.section == "draw" else axis.rows:
                for key, value in row.items():
                    columns.setdefault(key, []).append(value)
        return dict(sorted(columns.items(), key=lambda column: column[0] != LABEL))


def with_changes(data: Mapping[str, Value], changes: Changes) -> dict[str, Value]:
    """Scenario data with the values at dotted keys replaced, or added; `data` itself stays as it is.

    Raises InputError when a key leads through a value that holds nothing below it.
    """
    changed = dict(data)
    for key, value in changes.items():
        if key != LABEL:
            changed = _replaced(changed, key.split("."), value, key)
    return changed


def point_of(plan: Plan, point: int) -> Changes:
    """The varied values at a point, keys in the order of the axes."""
    rows = []
    for axis in reversed(plan.axes):
        point, index = divmod(point, len(axis))
        rows.append(axis.rows[index])
    return {key: value for row in reversed(rows) for key, value in row.items()}


def scenario_data(plan: Plan, values: Changes) -> str:
    """A scenario with its varied values, as the JSON that `Scenario` validates."""
    return json.dumps(with_changes(plan.data["scenario"], values))


def run_of(plan: Plan, number: int) -> Run:
    """Run `number`, from 0."""
    point, index = divmod(number, plan.seeds)
    values, scenario = _at_point(plan, point)
    seed = int(plan.data["seeds"]["first"]) + index
    return Run(number, point, seed, values, scenario.model_copy(update={SEED: seed}))


@lru_cache(maxsize=2)
def _at_point(plan: Plan, point: int) -> tuple[Changes, Scenario]:
    """Values and scenario of a point, validated once for all its seeds."""
    values = point_of(plan, point)
    return values, Scenario.model_validate_json(scenario_data(plan, values), strict=True)


def _axes(data: Mapping[str, Any]) -> tuple[Axis, ...]:
    together = [Axis("together", data["together"])] if data["together"] else []
    grid = [
        Axis("vary", [{key: value} for value in values]) for key, values in data["vary"].items()
    ]
    return (*together, *grid, *_draw_axis(data))


def _draw_axis(data: Mapping[str, Any]) -> list[Axis]:
    count, distributions = data["draws"], data["draw"]
    if not distributions:
        return []
    raw = {}
    for key, distribution in distributions.items():
        rng = stream(data["seed"], f"sweep {key}")
        raw[key] = rng.standard_normal(count) if "normal" in distribution else rng.random(count)
    return [Axis("draw", Draws(raw, distributions))]


def _drawn(distribution: Mapping[str, Sequence[float]], raw: float) -> float:
    kind, (first, second) = next(iter(distribution.items()))
    if kind == "normal":
        return first + second * raw
    if kind == "uniform":
        return first + (second - first) * raw
    return min(
        max(first * math.exp(math.log(second / first) * raw), first), second
    )  # rounding must not leave the bounds


def _replaced(node: Value, parts: list[str], value: Value, key: str) -> Any:
    if not parts:
        return value
    head, rest = parts[0], parts[1:]
    if isinstance(node, list):
        if not head.isdecimal() or int(head) >= len(node):
            raise InputError(f"{key}: the list has no item {head}; it has {len(node)}, from 0")
        return [
            _replaced(item, rest, value, key) if i == int(head) else item
            for i, item in enumerate(node)
        ]
    if node is not None and not isinstance(node, dict):
        raise InputError(
            f"{key}: the scenario has the value {node!r} above {head}, with no keys of its own"
        )
    below = node or {}
    return {**below, head: _replaced(below.get(head), rest, value, key)}
