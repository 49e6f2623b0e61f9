"""One chunk of a sweep: what a worker computes, in another process or on another machine.

A worker gets the plan as text and returns rows. The files that the scenarios name are kept with the
sweep and sent to workers on other machines. They lie as the names in the scenario lead, also out of
its folder (`../paths/a.yaml`). An absolute name is left as it is: its file counts for the plan, but
must be on every machine.

This module imports neither pyarrow nor anything
that shows results, which keeps the start of a worker short (benchmarks/start_time.py).
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

import numpy as np

from ballbar.cell.errors import InputError
from ballbar.cell.extended_yaml import Value
from ballbar.cell.threads import ONE_THREAD
from ballbar.code_version import code_version
from ballbar.scenario import Scenario
from ballbar.sweep.plan import Plan, Run, run_of

Row = dict[str, Value]  # column -> value
Files = tuple[tuple[str, bytes], ...]  # (name in the scenario, content), in order of the names
# (scenario, folder to which its file names are relative) -> results of one run by name
Trial = Callable[[Scenario, Path], Mapping[str, float | int | str]]


@dataclass(frozen=True, eq=False)
class Task:
    """Data that all chunks of a sweep share."""

    text: str  # of the plan
    trial: Trial
    files: Files  # files that the scenarios name
    top: Path  # folder on this machine that holds those files (`unpack`)


DONE, FAILED = "done", "failed"  # status of a run

# folder made for one run or one worker
_TEMPORARY = re.compile(rf"{re.escape(gettempdir())}[\\/]ballbar-[\w-]+[\\/]")


def run_chunk(text: str, runs: Sequence[int], trial: Trial, top: Path) -> list[Row]:
    """The rows of some runs of a chunk; a run that fails is a row with its reason.

    text : text of the plan. runs : their numbers. top : folder with the files that the scenarios
    name.

    Raises InputError when the code of this worker is of another version than the plan; OSError and
    MemoryError, which are failures of the machine and not of the run.
    """
    plan = _plan(text)
    if code_version() != plan.data.version:
        raise InputError(
            f"a worker has version {code_version()}, the sweep {plan.data.version}. Install the "
            "same version everywhere, and leave the code alone while a sweep runs."
        )
    return [_row(plan, run_of(plan, number), top, trial) for number in runs]


def run_chunk_remotely(text: str, runs: Sequence[int], trial: Trial, files: Files) -> list[Row]:
    """The rows of `run_chunk`, on a machine that does not have the files.

    Raises InputError also when this worker computes with several threads, which changes the last
    digits of the results.
    """
    if unset := [name for name in ONE_THREAD if os.environ.get(name) != "1"]:
        raise InputError(
            "a worker computes with several threads. Start it with a nanny, Dask's default, or "
            f"with {'=1 '.join(unset)}=1."
        )
    folder = _unpacked(files)  # held until the chunk is done, should another sweep replace it
    return run_chunk(text, runs, trial, Path(folder.name))


@lru_cache(maxsize=2)
def _unpacked(files: Files) -> TemporaryDirectory[str]:
    """Folder with the files, which lasts as long as this worker so that trials may cache by it."""
    top = TemporaryDirectory(prefix="ballbar-sweep-")
    unpack(files, Path(top.name))
    return top


def unpack(files: Files, top: Path) -> None:
    """Writes the files below `top`, to where their names lead from `scenario_folder`.

    Files with absolute names are left out.
    """
    folder = scenario_folder((name for name, _ in files), top)
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files:
        if not Path(name).is_absolute():
            path = folder / os.path.normpath(name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


def scenario_folder(names: Iterable[str], top: Path) -> Path:
    """The folder below `top` that lies as deep as the names lead up."""
    depth = max((Path(os.path.normpath(name)).parts.count("..") for name in names), default=0)
    return Path(top, *["scenario"] * depth)


@lru_cache(maxsize=1)
def _plan(text: str) -> Plan:
    return Plan(text)


def _row(plan: Plan, run: Run, top: Path, trial: Trial) -> Row:
    """The row of a run: the fixed columns, the varied values, and the results or the reason."""
    folder = scenario_folder(plan.data.files, top)
    row: Row = {
        "sweep": plan.data.name,
        "scenario": run.scenario.name,
        "version": plan.data.version,
        "run": run.number,
        "point": run.point,
        "seed": run.seed,
        "status": DONE,
        "reason": None,
    } | run.values
    try:
        results = trial(run.scenario, folder)
    except (OSError, MemoryError):
        raise
    except Exception as error:  # whatever a run can raise is its result; the sweep goes on
        return row | {"status": FAILED, "reason": _reason(error, folder, top)}
    if clash := row.keys() & results.keys():
        raise ValueError(
            f"run {run.number}: results have the names of other columns: "
            f"{', '.join(sorted(clash))}. Rename them in the trial."
        )
    return row | {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in results.items()
    }


def _reason(error: Exception, *folders: Path) -> str:
    """The sentence of a failure in one line, without folders of this machine.

    An error that is not of our packages has its type before the sentence.
    """
    sentence = str(error)
    for folder in folders:
        sentence = sentence.replace(f"{folder}{os.sep}", "")
    sentence = " ".join(_TEMPORARY.sub("", sentence).split())
    ours = type(error).__module__.startswith("ballbar.")
    return sentence if ours else f"{type(error).__name__}: {sentence}"
