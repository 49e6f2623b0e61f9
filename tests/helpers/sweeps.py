"""Sweeps in a folder: read from a text, computed by this process, and their tables as bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from ballbar.sweep.check import LoadedSweep, check_points, load_sweep
from ballbar.sweep.chunk import Row, Task, Trial, run_chunk
from ballbar.sweep.run import SweepOutcome, Workers, run_sweep
from tests.helpers import sweep_work
from tests.helpers.simulated_recordings import SCENARIOS

HEAD = f"""schema: ballbar-sweep/1
name: tried
scenario: {SCENARIOS / "irb2400.yaml"}
"""
GRID = """vary:
  errors.joint_noise.sigma_rad: [1.0e-6, 1.0e-5]
  cell.ballbar_position_m.0: [0.70, 0.72]
seeds: {first: 2, count: 5}
"""


def loaded(folder: Path, text: str) -> LoadedSweep:
    """A sweep file with this text after the head, its points checked."""
    file = folder / "sweep.yaml"
    file.write_text(text if text.startswith("schema") else HEAD + text)
    sweep = load_sweep(file)
    check_points(sweep)
    return sweep


def inline(task: Task) -> AbstractContextManager[Workers]:
    """One worker: this process."""

    def submit(runs: Sequence[int]) -> Future[list[Row]]:
        future: Future[list[Row]] = Future()
        future.set_result(run_chunk(task.text, runs, task.trial, task.top))
        return future

    return nullcontext(Workers(submit, lambda: 1))


def swept(
    sweep: LoadedSweep,
    folder: Path,
    workers: Callable[[Task], AbstractContextManager[Workers]],
    trial: Trial = sweep_work.figures,
    progress: Callable[[int, str], None] = lambda *_: None,
) -> SweepOutcome:
    return run_sweep(sweep, folder, trial, workers, progress=progress)


def table_bytes(outcome: SweepOutcome) -> tuple[bytes, bytes]:
    return outcome.folder.table.read_bytes(), outcome.folder.csv.read_bytes()
