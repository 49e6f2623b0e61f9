"""Output of `ballbar sweep`: a bar while it runs, then the grid, the table and the failures."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from ballbar.sweep.plan import Plan
from ballbar.sweep.run import Progress as RunProgress
from ballbar.sweep.run import SweepOutcome
from ballbar.sweep.table import MAIN_RESULTS, MAX_POINTS, failures_of, grid_keys, grid_points
from ballbar.terminal import animated, wide_console

BAR_AFTER = 2.0  # [s] a sweep that ends sooner shows no bar
WIDTH = 160  # characters of the summary in a pipe or file


@contextmanager
def run_bar(console: Console, plan: Plan) -> Iterator[RunProgress]:
    """A bar of the runs done, on a terminal and after BAR_AFTER; elsewhere nothing is shown."""
    done_of_all = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    times = (TextColumn("runs"), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    quiet = not animated(console)
    bar = Progress(*done_of_all, *times, console=console, transient=True, disable=quiet)
    task = bar.add_task("starting", total=plan.runs)
    since = time.monotonic()

    def report(done: int, stage: str) -> None:
        bar.update(task, completed=done, description=stage)
        if not bar.live.is_started and time.monotonic() - since > BAR_AFTER:
            bar.start()

    try:
        yield report
    finally:
        if bar.live.is_started:  # else rich would leave an empty line
            bar.stop()


def say_outcome(out: Console, outcome: SweepOutcome) -> bool:
    """Prints the outcome of a sweep. Returns whether it is finished and any run succeeded."""
    folder, runs = outcome.folder, outcome.folder.plan.runs
    if not outcome.finished:
        out.print(
            f"[yellow]stopped:[/] {outcome.done} of {runs} runs are done and kept in "
            f"{escape(str(folder.path))}."
        )
        out.print("The same command goes on from there.")
        return False
    _say_grid(out, outcome)
    resumed = f", {outcome.resumed} of them from before" if outcome.resumed else ""
    table = f"{escape(str(folder.table))} and {escape(folder.csv.name)}"
    out.print(f"Table {table}: {runs} runs{resumed}")
    failures = failures_of(folder.table)
    failed = f"[red]{failures.count} of {runs} runs failed;[/] most often ({failures.of_reason}): "
    out.print(f"{failed}{escape(failures.reason)}" if failures.count else "no run failed")
    return failures.count < runs


def _say_grid(out: Console, outcome: SweepOutcome) -> None:
    plan = outcome.folder.plan
    points = list(grid_points(outcome.folder.table, plan))
    keys = grid_keys(plan)
    results = [
        name
        for name in MAIN_RESULTS
        if any(point.results.get(name, np.empty(0)).size for point in points)
    ]
    table = Table(box=None, pad_edge=False)
    for key in keys:
        table.add_column(escape(key.replace(".", ".\n")), overflow="fold", vertical="bottom")
    spread = [heading for name in results for heading in (f"{name}\nmedian", "95 %")]
    for heading in ("runs", "failed", *spread):
        table.add_column(heading, justify="right", vertical="bottom")
    for point in points:
        cells = []
        for value in map(point.values.get, keys):
            text = value if isinstance(value, str) else json.dumps(value)
            cells.append("-" if value is None else escape(text))
        cells += [str(point.runs), str(point.failed)]
        for values in (point.results[name] for name in results):
            quantiles = np.quantile(values, (0.5, 0.95)) if values.size else ()
            cells += [f"{value:.3g}" for value in quantiles] or ["-", "-"]
        table.add_row(*cells)
    wide_console(out, WIDTH).print(table)
    if (more := plan.runs // plan.grid_point_runs - MAX_POINTS) > 0:
        out.print(f"... and {more} more points of the grid, in the table")
