"""The folder of a sweep: its plan, the chunks that are done, and in the end the table.

DIR/files/                 files that the scenarios name, as they were at the start
DIR/plan.yaml              what is computed, and its hash
DIR/chunks/HASH/           of each plan, so that chunks of two plans are never mixed:
    plan.json              the plan
    000123.json            finished chunks, each complete
    done                   when the table is that of this plan
DIR/NAME.parquet, .csv     the table

A plan that has grown has more seeds, draws, values under `vary` or rows under `together`. The runs
of the smaller ones are runs of it under other numbers: it takes over their rows, and their chunks
stay. Anything else that differs makes another sweep.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

from ballbar.cell.errors import InputError
from ballbar.cell.extended_yaml import Value
from ballbar.cell.files import claimed_folder, write_whole, write_yaml
from ballbar.cell.strict_yaml import load_yaml, parse_model
from ballbar.sweep.chunk import Files, Row, unpack
from ballbar.sweep.file import flattened
from ballbar.sweep.plan import Plan, PlanData, plain_text, point_of
from ballbar.sweep.table import chunk_rows, write_table

_FILES = "files"
_CHUNKS = "chunks"
_PLAN = "plan.yaml"
_STORED, _DONE = "plan.json", "done"
_HEAD = ("plan", "runs")  # what plan.yaml states before the plan
MAX_CHANGED = 10  # keys that differ, named at once
_rows = lru_cache(maxsize=8)(chunk_rows)  # of chunks of earlier plans


@dataclass(frozen=True)
class SweepFolder:
    """Folder of one sweep's results."""

    path: Path
    plan: Plan

    @property
    def table(self) -> Path:
        return self.path / f"{self.plan.data.name}.parquet"

    @property
    def csv(self) -> Path:
        return self.path / f"{self.plan.data.name}.csv"

    @property
    def started(self) -> bool:
        """Whether the folder holds a plan."""
        return (self.path / _PLAN).exists()

    @property
    def checked(self) -> bool:
        """Whether the folder holds this plan, whose points were checked when it was written."""
        return self.started and load_yaml(self.path / _PLAN).data.get("plan") == self.plan.digest

    @property
    def complete(self) -> bool:
        """Whether the table is there and of this plan."""
        return all(path.exists() for path in (self._chunks / _DONE, self.table, self.csv))

    def chunk(self, number: int) -> Path:
        return self._chunks / f"{number:06d}.json"

    def missing_runs(self) -> dict[int, list[int]]:
        """Each chunk that is not done -> its runs that no earlier plan has either."""
        done = self._done
        return {
            chunk: [run for run in self.plan.chunk(chunk) if self._earlier_chunk(run) is None]
            for chunk in range(self.plan.chunks)
            if chunk not in done
        }

    @property
    def _chunks(self) -> Path:
        return self.path / _CHUNKS / self.plan.digest[:16]

    @property
    def _done(self) -> set[int]:
        """Numbers of the chunks that are done."""
        return {int(path.stem) for path in self._chunks.glob("[0-9]*.json")}

    @cached_property
    def _earlier(self) -> list[tuple[SweepFolder, set[int]]]:
        """The smaller plans that this one grew from, and numbers of their chunks that are done."""
        plans = [
            Plan(file.read_text("utf-8")) for file in (self.path / _CHUNKS).glob(f"*/{_STORED}")
        ]
        smaller = [plan for plan in plans if plan.digest != self.plan.digest]
        folders = [SweepFolder(self.path, p) for p in smaller if not changed_keys(self.plan, p)]
        return [(folder, folder._done) for folder in folders]

    def _earlier_chunk(self, run: int) -> tuple[Path, int] | None:
        """File and number of the row of a run that an earlier plan has."""
        for folder, done in self._earlier:
            number = earlier_number(self.plan, run, folder.plan)
            if number is not None and (chunk := folder.plan.chunk_of(number)) in done:
                return folder.chunk(chunk), number
        return None

    def _earlier_row(self, run: int) -> Row:
        """The row of a run that an earlier plan has, with its numbers in this one."""
        place = self._earlier_chunk(run)
        assert place is not None, f"run {run} was not computed"
        row, point = _rows(place[0])[place[1]], run // self.plan.seeds
        return row | {"run": run, "point": point} | point_of(self.plan, point)

    @property
    def files(self) -> Path:
        return self.path / _FILES

    def start(self, files: Files) -> None:
        """Writes the files and the plan, unless the folder has this plan already."""
        if not self.checked:
            unpack(files, self.files)
            write_whole(self._chunks / _STORED, self.plan.text.encode())
            for done in (self.path / _CHUNKS).glob(f"*/{_DONE}"):
                done.unlink()  # the table is of another plan from now on
            head = dict(zip(_HEAD, (self.plan.digest, self.plan.runs), strict=True))
            write_yaml(self.path / _PLAN, head | json.loads(self.plan.text))

    def keep(self, number: int, rows: list[Row]) -> None:
        """Writes a finished chunk: the rows that were computed, and those of earlier plans."""
        computed = {row["run"]: row for row in rows}
        every = [computed.get(run) or self._earlier_row(run) for run in self.plan.chunk(number)]
        write_whole(self.chunk(number), json.dumps(every).encode())

    def finish(self) -> None:
        """Writes the table from all chunks."""
        chunks = [self.chunk(number) for number in range(self.plan.chunks)]
        write_table(chunks, self.plan.columns, {"parquet": self.table, "csv": self.csv})
        write_whole(self._chunks / _DONE, b"")


@contextmanager
def open_folder(path: Path, plan: Plan) -> Iterator[SweepFolder]:
    """The folder of a sweep, new or begun, locked for this process.

    Raises InputError when it holds something else or another plan, or another process works in it.
    """
    folder = SweepFolder(path, plan)
    written = (_PLAN, folder.table.name, folder.csv.name)
    with claimed_folder(path, {_FILES, _CHUNKS, *written}, "a sweep"):
        if folder.started and not folder.checked:
            _refuse_unless_grown(path / _PLAN, plan)
        yield folder


def _refuse_unless_grown(file: Path, plan: Plan) -> None:
    """Raises InputError unless the plan is that of plan.yaml with more seeds, draws or points."""
    document = load_yaml(file)
    stored, version = document.data, plan.data.version
    if stored.get("version") != version:
        reason = f"were computed by version {stored.get('version')}, this is {version}"
    else:
        document = replace(document, data={k: stored[k] for k in stored if k not in _HEAD})
        changed = changed_keys(plan, Plan.of(parse_model(document, PlanData)))
        if not changed:
            return
        reason = f"are of another sweep (changed: {', '.join(changed[:MAX_CHANGED])})"
    what = f"its chunks {reason}; nothing was run."
    raise InputError.at(file, what, "Choose another folder with --out, or delete this one.")


def changed_keys(plan: Plan, earlier: Plan) -> list[str]:
    """Keys of a plan that differ from those of an earlier one by more than growth."""
    new, old = plan.data, earlier.data
    changed = [key for key in ("name", "version") if getattr(new, key) != getattr(old, key)]
    now, then = ({k: plain_text(v) for k, v in flattened(d.scenario).items()} for d in (new, old))
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
    names: dict[str, str | int] = {}
    for axis in reversed(plan.axes):
        point, row = divmod(point, len(axis))
        names[axis.key] = axis.name(row)
    result = 0
    for axis in earlier.axes:
        number_there = axis.numbers.get(names[axis.key])
        if number_there is None:
            return None
        result = result * len(axis) + number_there
    return result * earlier.seeds + seed


def _holds(values: Sequence[Value], others: Sequence[Value]) -> bool:
    """Whether every one of the others is among the values."""
    return {plain_text(value) for value in others} <= {plain_text(value) for value in values}
