"""Which run is which: point, seed and scenario of run k are computed from k, so nothing is listed.

The points are the product of axes: the rows of `together`, then each key of `vary` in the order of
the file, then the draws. The last axis changes fastest, and within a point the seeds. The plan is
plain data; its text goes to the workers, and its hash says whether two folders hold the same sweep.
"""

from __future__ import annotations

import hashlib
import json
import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

from ballbar.cell.arrays import Array
from ballbar.cell.extended_yaml import Value, with_changes
from ballbar.cell.schema import Strict
from ballbar.scenario import Scenario
from ballbar.sim.streams import stream
from ballbar.sweep.file import LABEL, SEED, Changes, Draw, Seeds

# Most runs of a chunk: with 40 ms a run, a worker writes (or loses, at kill -9) one every second.
CHUNK_RUNS = 25
# Chunks of a sweep with at least as many runs, so that some hundred runs still occupy every worker.
MIN_CHUNKS = 50


class PlanData(Strict):
    """Everything that decides the table of a sweep; keys as in the sweep file."""

    name: str
    version: str  # of the code (version.py)
    scenario: dict[str, Any]  # plain data, `change` applied
    together: list[Changes]  # rows, keys dotted
    vary: dict[str, list[Any]]
    draw: dict[str, Draw]
    draws: int | None = None
    seed: int
    seeds: Seeds
    files: dict[str, str]  # name -> SHA-256


@dataclass(frozen=True, eq=False)
class Factor:
    """One factor of the product of points."""

    section: str  # of the sweep file: together, vary, draw
    rows: Sequence[Changes]

    @property
    def key(self) -> str:
        """Name that distinguishes it from the other axes: its key under `vary`, or its section."""
        return next(iter(self.rows[0])) if self.section == "vary" else self.section

    def name(self, row: int) -> str | int:
        """Name of a row in plans that have grown: its content, or the number of a draw."""
        return row if self.section == "draw" else plain_text(self.rows[row])

    @cached_property
    def numbers(self) -> dict[str | int, int]:
        """Number of each row by its name."""
        return {self.name(row): row for row in range(len(self))}

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True, eq=False)
class Draws(Sequence[Changes]):
    """The rows of the draw axis, each made when it is read."""

    variates: Mapping[str, Array]  # (draws,) [1] standard variates of each key
    distributions: Mapping[str, Draw]

    def __len__(self) -> int:
        return min(len(column) for column in self.variates.values())

    def __getitem__(self, index: Any) -> Any:  # no slices: rows are read one by one
        columns = self.variates.items()
        return {key: self.distributions[key].at(float(column[index])) for key, column in columns}


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

    text: str  # JSON of PlanData: everything below follows from it

    @classmethod
    def of(cls, data: PlanData) -> Plan:
        """The plan with this content."""
        return cls(json.dumps(data.model_dump(exclude_none=True)))

    @cached_property
    def data(self) -> PlanData:
        return PlanData.model_validate_json(self.text)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of everything that decides the table."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @cached_property
    def axes(self) -> tuple[Factor, ...]:
        data, axes = self.data, []
        if data.together:
            axes.append(Factor("together", data.together))
        for key, values in data.vary.items():
            axes.append(Factor("vary", [{key: value} for value in values]))
        if data.draw:
            variates, count = {}, data.draws or 0
            for key, draw in data.draw.items():  # each from a stream of its own
                rng = stream(data.seed, f"sweep {key}")
                variates[key] = rng.standard_normal(count) if draw.normal else rng.random(count)
            axes.append(Factor("draw", Draws(variates, data.draw)))
        return tuple(axes)

    @property
    def seeds(self) -> int:
        """Runs of each point."""
        return self.data.seeds.count

    @cached_property
    def points(self) -> int:
        return math.prod(len(axis) for axis in self.axes)

    @property
    def runs(self) -> int:
        return self.points * self.seeds

    @cached_property
    def grid_point_runs(self) -> int:
        """Runs of one point of the grid: its draws and their seeds, which follow each other."""
        return self.seeds * math.prod(len(axis) for axis in self.axes if axis.section == "draw")

    @cached_property
    def _first_runs(self) -> Sequence[int]:
        """First run of each chunk, and the number of runs.

        They follow from the plan alone, so that the chunks are the same for all workers.
        """
        size = max(1, min(CHUNK_RUNS, self.runs // MIN_CHUNKS))
        recorded = self.data.scenario.get("identify", {}).get("data", "files") == "files"
        if size == self.seeds == 1 and recorded:
            points = (point_of(self, point) for point in range(self.points))
            simulated = [  # values that decide the recording of a point
                {k: v for k, v in values.items() if not k.startswith("identify.")}
                for values in points
            ]
            changes = (i for i in range(1, self.runs) if simulated[i] != simulated[i - 1])
            return (0, *changes, self.runs)  # few long runs: one recording serves a chunk
        return (*range(0, self.runs, size), self.runs)

    @property
    def chunks(self) -> int:
        return len(self._first_runs) - 1

    def chunk(self, number: int) -> range:
        """Numbers of the runs of a chunk."""
        return range(*self._first_runs[number : number + 2])

    def chunk_of(self, run: int) -> int:
        """Number of the chunk that has a run."""
        return bisect_right(self._first_runs, run) - 1

    @cached_property
    def columns(self) -> dict[str, list[Value]]:
        """Varied key (or `label`, first) -> values by which its column gets a type.

        These are all values of the key, or a single one where it is drawn.
        """
        columns: dict[str, list[Value]] = {}
        for axis in self.axes:
            for row in [axis.rows[0]] if axis.section == "draw" else axis.rows:
                for key, value in row.items():
                    columns.setdefault(key, []).append(value)
        return dict(sorted(columns.items(), key=lambda column: column[0] != LABEL))


def plain_text(value: Value) -> str:
    """Text by which plain data are compared: 1 and 1.0 differ, as they do in the table."""
    return json.dumps(value, sort_keys=True)


def point_of(plan: Plan, point: int) -> Changes:
    """The varied values at a point, keys in the order of the axes."""
    rows = []
    for axis in reversed(plan.axes):
        point, index = divmod(point, len(axis))
        rows.append(axis.rows[index])
    return {key: value for row in reversed(rows) for key, value in row.items()}


def scenario_data(plan: Plan, values: Changes) -> str:
    """A scenario with its varied values, as the JSON that `Scenario` validates."""
    return json.dumps(with_values(plan.data.scenario, values))


def with_values(scenario: Mapping[str, Value], values: Changes) -> dict[str, Value]:
    """Scenario data with its varied values. Raises InputError as `with_changes`."""
    return with_changes(scenario, {key: v for key, v in values.items() if key != LABEL})


def run_of(plan: Plan, number: int) -> Run:
    """Run `number`, from 0."""
    point, index = divmod(number, plan.seeds)
    values, scenario = _at_point(plan, point)
    seed = plan.data.seeds.first + index
    scenario = scenario.model_copy(update={SEED: seed})
    return Run(number=number, point=point, seed=seed, values=values, scenario=scenario)


@lru_cache(maxsize=2)
def _at_point(plan: Plan, point: int) -> tuple[Changes, Scenario]:
    """Values and scenario of a point, validated once for all its seeds."""
    values = point_of(plan, point)
    return values, Scenario.model_validate_json(scenario_data(plan, values), strict=True)
