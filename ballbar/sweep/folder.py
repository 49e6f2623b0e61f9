"""The folder of a sweep: its plan, the parts that are done, and in the end the table.

DIR/files/                files that the scenarios name, as they were at the start
DIR/plan.yaml             what is computed, and its hash: parts of another plan are never mixed in
DIR/parts/000123.parquet  finished parts, each whole
DIR/NAME.parquet, .csv    the table
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ballbar.sweep.files import Files, unpack
from ballbar.sweep.part import Row
from ballbar.sweep.plan import Plan
from ballbar.sweep.table import part_bytes, write_table
from cell.errors import InputError
from cell.files import claim_folder, write_whole, write_yaml
from cell.strict_yaml import load_yaml

_FILES = "files"
_LOCK = ".lock"
_PARTS = "parts"
_PLAN = "plan.yaml"


@dataclass(frozen=True)
class SweepFolder:
    """Where one sweep's results lie."""

    path: Path  # absolute
    plan: Plan

    @property
    def table(self) -> Path:
        return self.path / f"{self.plan.name}.parquet"

    @property
    def csv(self) -> Path:
        return self.path / f"{self.plan.name}.csv"

    @property
    def started(self) -> bool:
        """Whether the folder holds a plan."""
        return (self.path / _PLAN).exists()

    @property
    def checked(self) -> bool:
        """Whether the folder holds this plan: its points were checked then."""
        return self.started and load_yaml(self.path / _PLAN).data.get("plan") == self.plan.digest

    @property
    def complete(self) -> bool:
        return self.table.exists() and self.csv.exists()

    def part(self, number: int) -> Path:
        return self.path / _PARTS / f"{number:06d}.parquet"

    def missing(self) -> list[int]:
        """Numbers of the parts that are not done."""
        done = {path.name for path in (self.path / _PARTS).glob("*.parquet")}
        return [number for number in range(self.plan.parts) if self.part(number).name not in done]

    @property
    def files(self) -> Path:
        return self.path / _FILES

    def start(self, files: Files) -> None:
        """Writes the files and plan.yaml, unless they are there."""
        if not self.started:
            unpack(files, self.files)
            write_yaml(
                self.path / _PLAN,
                {"plan": self.plan.digest, "runs": self.plan.runs, **json.loads(self.plan.text)},
            )

    def keep(self, number: int, rows: list[Row]) -> None:
        """Writes a finished part."""
        write_whole(self.part(number), part_bytes(rows, self.plan.columns))

    def finish(self) -> None:
        """Writes the table from all parts."""
        write_table(
            [self.part(number) for number in range(self.plan.parts)],
            {"parquet": self.table, "csv": self.csv},
        )


@contextmanager
def open_folder(path: Path, plan: Plan) -> Iterator[SweepFolder]:
    """The folder of a sweep, new or begun, for this process alone.

    Raises InputError when it holds something else, another plan, or another process works in it.
    """
    folder = SweepFolder(path.absolute(), plan)
    results = {
        name for file in (folder.table, folder.csv) for name in (file.name, f".{file.name}.part")
    }
    claim_folder(path, {_FILES, _LOCK, _PLAN, f".{_PLAN}.part", _PARTS, *results}, "a sweep")
    if folder.started and not folder.checked:
        _refuse_other_plan(path / _PLAN, plan)
    path.mkdir(parents=True, exist_ok=True)
    with (path / _LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{path}: another process works on this sweep. Wait for it, or choose another folder with --out."
            ) from None
        yield folder


def _refuse_other_plan(file: Path, plan: Plan) -> None:
    found: dict[str, Any] = load_yaml(file).data
    if found.get("version") != plan.data["version"]:
        what = f"its parts were computed by version {found.get('version')}, this is {plan.data['version']}"
    else:
        other = ", ".join(key for key, value in plan.data.items() if found.get(key) != value)
        what = f"its parts are of another sweep (other: {other or 'the order of keys'})"
    raise InputError(
        f"{file}: {what}; nothing was run. Choose another folder with --out, or delete this one."
    )
