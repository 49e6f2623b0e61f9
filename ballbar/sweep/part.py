"""One part of a sweep: what a worker does, in another process of this machine or on another machine.

A worker gets the plan as text and gives back rows. It needs nothing of the table (pyarrow), which keeps its start short.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

import numpy as np

from ballbar.scenario import Scenario
from ballbar.sweep.file import Value
from ballbar.sweep.files import Files, scenario_folder, unpack
from ballbar.sweep.plan import Plan, Run, run_of
from ballbar.sweep.version import code_version
from cell.errors import InputError
from cell.threads import ONE_THREAD

Row = dict[str, Value]  # column -> value
Work = Callable[
    [Scenario, Path], Mapping[str, float | int | str]
]  # scenario, folder of its files -> figures of the run


@dataclass(frozen=True, eq=False)
class Job:
    """What all parts of a sweep share."""

    text: str  # of the plan
    work: Work
    files: Files  # that the scenarios name
    top: Path  # folder of this machine with those files (files.py, `unpack`)


DONE, FAILED = "done", "failed"  # status of a run

_TEMPORARY = re.compile(
    rf"{re.escape(gettempdir())}{os.sep}ballbar-[\w-]+{os.sep}"
)  # a folder made for one run or one worker
_OURS = ("cell", "sim", "acquisition", "ident", "ballbar")


def run_part(text: str, part: int, work: Work, top: Path) -> list[Row]:
    """The rows of a part, one a run; a run that fails is a row with its reason.

    text : of the plan. top : folder with the files that the scenarios name (files.py).

    Raises InputError when this worker's code is of another version than the plan; OSError and MemoryError, which are the
    machine's failures, not the run's.
    """
    plan = _plan(text)
    if code_version() != (expected := plan.data["version"]):
        raise InputError(
            f"a worker has version {code_version()}, the sweep {expected}. "
            "Install the same version everywhere, and leave the code alone while a sweep runs."
        )
    return [_row(plan, run_of(plan, number), top, work) for number in plan.part(part)]


def run_part_elsewhere(text: str, part: int, work: Work, files: Files) -> list[Row]:
    """As `run_part`, on a machine that does not have the files.

    Raises InputError too when this worker computes with several threads, which changes the last digits.
    """
    if several := [name for name in ONE_THREAD if os.environ.get(name) != "1"]:
        raise InputError(
            f"a worker computes with several threads. Start it with a nanny, Dask's default, or with {'=1 '.join(several)}=1."
        )
    top = _unpacked(
        files
    )  # held until the part is done, should another sweep's files take its place
    return run_part(text, part, work, Path(top.name))


@lru_cache(maxsize=2)
def _unpacked(files: Files) -> TemporaryDirectory[str]:
    """The files in a folder that lasts as long as this worker process: what is computed from them is kept between runs."""
    top = TemporaryDirectory(prefix="ballbar-sweep-")
    unpack(files, Path(top.name))
    return top


@lru_cache(maxsize=1)
def _plan(text: str) -> Plan:
    return Plan(text)


def _row(plan: Plan, run: Run, top: Path, work: Work) -> Row:
    folder = scenario_folder(plan.data["files"], top)
    row: Row = {
        "sweep": plan.name,
        "scenario": run.scenario.name,
        "version": plan.data["version"],
        "run": run.number,
        "point": run.point,
        "seed": run.seed,
        "status": DONE,
        "reason": None,
    } | run.values
    try:
        figures = work(run.scenario, folder)
    except (OSError, MemoryError):
        raise
    except Exception as error:  # whatever a run can raise is its result; the sweep goes on
        return row | {"status": FAILED, "reason": _reason(error, folder, top)}
    if clash := row.keys() & figures.keys():
        raise ValueError(
            f"run {run.number}: figures have the names of other columns: {', '.join(sorted(clash))}"
        )
    return row | {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in figures.items()
    }


def _reason(error: Exception, *folders: Path) -> str:
    """The sentence of a failure, with its type if it is not one of ours; one line, and no folder of this machine in it."""
    sentence = str(error)
    for folder in folders:
        sentence = sentence.replace(f"{folder}{os.sep}", "")
    sentence = " ".join(_TEMPORARY.sub("", sentence).split())
    ours = type(error).__module__.partition(".")[0] in _OURS
    return sentence if ours else f"{type(error).__name__}: {sentence}"
