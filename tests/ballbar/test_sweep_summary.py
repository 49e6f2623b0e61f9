"""The summary that `ballbar sweep` prints of its table, and which chunk has which run."""

from __future__ import annotations

import io
import time
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from rich.console import Console

from ballbar.sweep.plan import CHUNK_RUNS, MIN_CHUNKS
from ballbar.sweep.run import COUNT_PERIOD, SweepOutcome, _refreshed
from ballbar.sweep.show import run_bar, say_outcome
from ballbar.sweep.table import MAX_POINTS
from tests.helpers import sweep_work
from tests.helpers.sweeps import GRID, inline, loaded, swept


def said(outcome: SweepOutcome, width: int = 160) -> tuple[bool, list[str]]:
    out = Console(file=io.StringIO(), width=width)
    good = say_outcome(out, outcome)
    assert isinstance(out.file, io.StringIO)
    return good, [" ".join(line.split()) for line in out.file.getvalue().splitlines()]


def made(tmp_path: Path, text: str) -> SweepOutcome:
    return swept(loaded(tmp_path, text), tmp_path / "out", inline, sweep_work.figures_with_failures)


def test_median_and_95_percent_of_each_point_are_those_of_its_runs(tmp_path: Path) -> None:
    outcome = made(tmp_path, GRID.replace("count: 5", "count: 12"))
    good, lines = said(outcome)
    table = pd.read_parquet(outcome.folder.table)
    keys = ["errors.joint_noise.sigma_rad", "cell.ballbar_position_m.0"]
    rows = []
    for (sigma, place), runs in table.groupby(keys):
        values = runs["distance_mm_mrad"].dropna()
        quantiles = [f"{values.quantile(share):.3g}" for share in (0.5, 0.95)]
        rows.append(" ".join([str(sigma), f"{place:g}", "12", "4", *quantiles]))
    at = lines.index(next(line for line in lines if line.startswith("1e-06")))
    assert [line.replace("0.70 ", "0.7 ") for line in lines[at : at + 4]] == rows
    headings = " ".join(lines[:at])
    assert "errors. cell. joint_noise. ballbar_position_m." in headings
    assert headings.endswith("sigma_rad 0 runs failed median 95 %")
    assert good
    folder = outcome.folder
    assert lines[at + 4] == f"Table {folder.table} and {folder.csv.name}: 48 runs"
    failed = "16 of 48 runs failed; most often (8): no motion at 0.7 m in 4 s"
    assert lines[at + 5 :] == [failed]


def test_a_sweep_without_grid_or_results_shows_its_counts(tmp_path: Path) -> None:
    outcome = replace(made(tmp_path, "seeds: {first: 2, count: 4}\n"), resumed=3)
    good, lines = said(outcome)
    assert not good
    assert lines[:2] == ["runs failed", "4 4"]
    assert lines[2].endswith(": 4 runs, 3 of them from before")
    assert lines[3].startswith("4 of 4 runs failed; most often (2): no motion at 0.7 m in 4 s")
    other = tmp_path / "other"
    other.mkdir()
    good, lines = said(made(other, "seeds: {first: 7, count: 2}\n"))
    assert good
    assert lines[-1] == "no run failed"


def test_a_sweep_that_was_stopped_says_how_far_it_came(tmp_path: Path) -> None:
    outcome = made(tmp_path, "seeds: {count: 4}\n")
    outcome.folder.table.unlink()
    good, lines = said(replace(outcome, done=3), width=400)
    assert not good
    assert lines == [
        f"stopped: 3 of 4 runs are done and kept in {outcome.folder.path}.",
        "The same command goes on from there.",
    ]


def test_of_a_long_grid_the_first_points_are_shown(tmp_path: Path) -> None:
    places = [round(0.6 + 1e-3 * k, 3) for k in range(MAX_POINTS + 3)]
    outcome = made(
        tmp_path, f"vary: {{cell.ballbar_position_m.0: {places}}}\nseeds: {{first: 9, count: 1}}\n"
    )
    _, lines = said(outcome)
    assert sum(line.startswith("0.6") for line in lines) == MAX_POINTS
    assert "... and 3 more points of the grid, in the table" in lines


@pytest.mark.parametrize(("runs", "size"), [(20, 1), (MIN_CHUNKS * 3 + 7, 3), (5000, CHUNK_RUNS)])
def test_chunks_share_out_the_runs_and_each_knows_its_own(
    tmp_path: Path, runs: int, size: int
) -> None:
    plan = loaded(tmp_path, f"seeds: {{count: {runs}}}\n").plan
    chunks = [plan.chunk(number) for number in range(plan.chunks)]
    assert [run for chunk in chunks for run in chunk] == list(range(runs))
    assert {len(chunk) for chunk in chunks[:-1]} == {size}
    assert len(chunks[-1]) <= size
    for number, chunk in enumerate(chunks):
        assert {plan.chunk_of(run) for run in (chunk[0], chunk[-1])} == {number}


def test_points_of_one_recording_are_one_chunk(tmp_path: Path) -> None:
    """Few long runs that differ in their identification alone."""
    noise = "errors.joint_noise.sigma_rad: [1.0e-6, 1.0e-5]"
    text = f"vary:\n  {noise}\n  identify.samples: [300, 400]\nseeds: {{count: 1}}\n"
    plan = loaded(tmp_path, text).plan
    assert [plan.chunk(number) for number in range(plan.chunks)] == [range(2), range(2, 4)]


def test_where_there_is_no_terminal_no_bar_is_shown(tmp_path: Path) -> None:
    out = Console(file=io.StringIO())
    with run_bar(out, loaded(tmp_path, "seeds: {count: 3}\n").plan) as report:
        report(1, "running")
    assert isinstance(out.file, io.StringIO)
    assert out.file.getvalue() == ""


def test_a_bar_begins_where_a_sweep_takes_long_and_never_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    begun = list[float]()
    monkeypatch.setattr("ballbar.sweep.show.Progress.start", lambda _: begun.append(now[0]))
    monkeypatch.setattr("ballbar.sweep.show.animated", lambda _: True)
    out = Console(file=io.StringIO(), force_terminal=True)
    with run_bar(out, loaded(tmp_path, "seeds: {count: 3}\n").plan) as report:
        for at in (1.0, 1.9, 2.1):
            now[0] = at
            report(1, "running")
    assert begun == [2.1]


def test_workers_of_a_cluster_are_counted_again_after_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each question to the scheduler takes its time; the number changes slowly."""
    now, counts = [100.0], iter([2, 3])
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    latest = _refreshed(lambda: next(counts))
    assert latest() == 2
    now[0] += 0.99 * COUNT_PERIOD
    assert latest() == 2
    now[0] += 0.02 * COUNT_PERIOD
    assert latest() == 3
    assert latest() == 3
