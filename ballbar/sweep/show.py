"""What `ballbar sweep` shows: a bar while it runs, then where the table is, what failed, and the grid at a glance."""

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

from ballbar.sweep.file import Value
from ballbar.sweep.plan import Plan
from ballbar.sweep.run import Outcome
from ballbar.sweep.run import Progress as Report
from ballbar.sweep.summary import (
    FIGURES,
    MAX_POINTS,
    GridPoint,
    failures_of,
    grid_keys,
    grid_points,
)
from ballbar.terminal import moves

BAR_AFTER = 2.0  # [s] what is done sooner needs no bar
WIDTH = 160  # characters of the summary in a pipe or file


@contextmanager
def run_bar(console: Console, plan: Plan) -> Iterator[Report]:
    """A bar of the runs done, on a terminal and after two seconds; elsewhere nothing."""
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("runs"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not moves(console),
    )
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


def say_outcome(out: Console, outcome: Outcome) -> bool:
    """Prints what a sweep came to. Returns whether it is finished and any of its runs succeeded."""
    folder = outcome.folder
    plan = folder.plan
    if not outcome.finished:
        out.print(
            f"[yellow]stopped:[/] {outcome.done} of {plan.runs} runs are done and kept in {escape(str(folder.path))}."
        )
        out.print("The same command goes on from there.")
        return False
    _say_grid(out, outcome)
    kept = "" if outcome.kept == 0 else f", {outcome.kept} of them from before"
    out.print(
        f"Table {escape(str(folder.table))} and {escape(folder.csv.name)}: {plan.runs} runs{kept}"
    )
    failures = failures_of(folder.table)
    if failures.count:
        out.print(
            f"[red]{failures.count} of {plan.runs} runs failed;[/] most often ({failures.of_reason}): {escape(failures.reason)}"
        )
    else:
        out.print("no run failed")
    return failures.count < plan.runs


def _say_grid(out: Console, outcome: Outcome) -> None:
    plan = outcome.folder.plan
    points = list(grid_points(outcome.folder.table, plan))
    keys = grid_keys(plan)
    figures = [
        name
        for name in FIGURES
        if any(point.figures.get(name, np.empty(0)).size for point in points)
    ]
    table = Table(box=None, pad_edge=False)
    for key in keys:
        table.add_column(escape(key.replace(".", ".\n")), overflow="fold", vertical="bottom")
    for heading in (
        "runs",
        "failed",
        *(heading for name in figures for heading in (f"{name}\nmedian", "95 %")),
    ):
        table.add_column(heading, justify="right", vertical="bottom")
    for point in points:
        table.add_row(
            *(escape(_shown(point.values.get(key))) for key in keys), *_numbers(point, figures)
        )
    (out if out.is_terminal else Console(file=out.file, width=WIDTH, quiet=out.quiet)).print(table)
    if (rest := plan.runs // plan.cell_runs - MAX_POINTS) > 0:
        out.print(f"... and {rest} more points of the grid, in the table")


def _numbers(point: GridPoint, figures: list[str]) -> list[str]:
    cells = [str(point.runs), str(point.failed)]
    for values in (point.figures[name] for name in figures):
        cells += [
            f"{np.quantile(values, share):.3g}" if values.size else "-" for share in (0.5, 0.95)
        ]
    return cells


def _shown(value: Value) -> str:
    return "-" if value is None else value if isinstance(value, str) else json.dumps(value)
