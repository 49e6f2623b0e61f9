"""The folder of a sweep: its plan, the chunks that are done, and in the end the table.

DIR/files/                 files that the scenarios name, as they were at the start
DIR/plan.yaml              what is computed, and its hash: chunks of two plans are never mixed
DIR/chunks/000123.parquet  finished chunks, each complete
DIR/NAME.parquet, .csv     the table
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ballbar.sweep.chunk import Row
from ballbar.sweep.files import Files, unpack
from ballbar.sweep.plan import Plan
from ballbar.sweep.table import chunk_bytes, write_table
from cell.errors import InputError
from cell.files import claimed_folder, write_whole, write_yaml
from cell.strict_yaml import load_yaml

_FILES = "files"
_CHUNKS = "chunks"
_PLAN = "plan.yaml"


@dataclass(frozen=True)
class SweepFolder:
    """Folder of one sweep's results."""

    path: Path  # absolute
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
        return self.table.exists() and self.csv.exists()

    def chunk(self, number: int) -> Path:
        return self.path / _CHUNKS / f"{number:06d}.parquet"

    def missing(self) -> list[int]:
        """Numbers of the chunks that are not done."""
        done = {path.name for path in (self.path / _CHUNKS).glob("*.parquet")}
        return [number for number in range(self.plan.chunks) if self.chunk(number).name not in done]

    @property
    def files(self) -> Path:
        return self.path / _FILES

    def start(self, files: Files) -> None:
        """Writes the files and plan.yaml, unless the folder has a plan already."""
        if not self.started:
            unpack(files, self.files)
            head = {"plan": self.plan.digest, "runs": self.plan.runs}
            write_yaml(self.path / _PLAN, head | json.loads(self.plan.text))

    def keep(self, number: int, rows: list[Row]) -> None:
        """Writes a finished chunk."""
        write_whole(self.chunk(number), chunk_bytes(rows, self.plan.columns))

    def finish(self) -> None:
        """Writes the table from all chunks."""
        chunks = [self.chunk(number) for number in range(self.plan.chunks)]
        write_table(chunks, {"parquet": self.table, "csv": self.csv})


@contextmanager
def open_folder(path: Path, plan: Plan) -> Iterator[SweepFolder]:
    """The folder of a sweep, new or begun, locked for this process.

    Raises InputError when it holds something else or another plan, or another process works in it.
    """
    folder = SweepFolder(path.absolute(), plan)
    written = (_PLAN, folder.table.name, folder.csv.name)
    with claimed_folder(path, {_FILES, _CHUNKS, *written}, "a sweep"):
        if folder.started and not folder.checked:
            _refuse_other_plan(path / _PLAN, plan)
        yield folder


def _refuse_other_plan(file: Path, plan: Plan) -> None:
    stored, data = load_yaml(file).data, json.loads(plan.text)
    if stored.get("version") != data["version"]:
        reason = f"were computed by version {stored.get('version')}, this is {data['version']}"
    else:
        changed = ", ".join(key for key in data if stored.get(key) != data[key])
        reason = f"are of another sweep (changed: {changed or 'the order of keys'})"
    raise InputError(
        f"{file}: its chunks {reason}; nothing was run. Choose another folder with --out, or "
        "delete this one."
    )
