"""A history in words, as a table, as plain data, and as a page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ballbar.cell.errors import InputError
from ballbar.cell.files import write_new
from ballbar.cell.number_text import significant_text
from ballbar.history.events import SeriesFit
from ballbar.history.figure import history_image
from ballbar.history.history import AxisFinding, Due, History, Pair
from ballbar.report.numbers import MISSING, decimals_for, listed
from ballbar.report.section import template
from ballbar.units import MM, MRAD, UM, URAD

LISTED = 2  # changes of one result that its row names
CAUSES = {
    "collision": "a collision, or a zero that was set again",
    "gear": "the gear was replaced, or is damaged",
    "change": "at once or gradually, which later results will show",
}
HEAD = (
    *("date", "nominal robot off [mm]", "stated [mm]"),
    *("changed since the first", "since the one before"),
)


def sentences(history: History) -> list[str]:
    """One sentence for each finding, or that nothing was found."""
    axes = sorted({fit.series.axis for fit in history.fits})
    return [_sentence(finding) for finding in history.findings] or [
        f"No axis changed by more than chance explains, of {len(history.fits)} quantities of axes "
        f"{listed([str(axis) for axis in axes])}."
        if axes
        else "Nothing can be compared: no quantity of an axis is stated on two days."
    ]


def _sentence(finding: AxisFinding) -> str:
    what, axes = "; ".join(_amounts(finding.events)), [str(axis) for axis in finding.axes]
    if finding.kind == "wear":
        return f"Axis {axes[0]} wears since {finding.end} at the latest: {what}."
    axis = f"{'axes' if len(axes) > 1 else 'axis'} {listed(axes)}"
    return f"Between {finding.begin} and {finding.end} {axis} changed: {what}: " + (
        f"{CAUSES[finding.kind]}."
    )


def _amounts(events: tuple[Pair, ...]) -> Iterator[str]:
    """Name and size (k = 2) of each event, sine and cosine of a ripple together."""
    merged: dict[str, list[Pair]] = {}
    for fit, event in events:
        merged.setdefault(_label(fit), []).append((fit, event))
    for name, members in merged.items():
        factor, unit = _unit(members[0][0])
        sizes = np.array([event.size for _, event in members])
        size, sign = (sizes[0], "+") if sizes.size == 1 else (np.linalg.norm(sizes), "")
        spread = 2.0 * factor * max(event.sigma for _, event in members)
        decimals = decimals_for([spread], digits=1)
        month = " a month" if members[0][1].drift else ""
        yield f"{name} {size * factor:{sign}.{decimals}f} ± {spread:.{decimals}f} {unit}{month}"


def _label(fit: SeriesFit) -> str:
    """The quantity of a series, such as `zero of axis 3`."""
    axis, kind = fit.series.axis, fit.series.kind
    if kind == "twist":
        return f"angle of axis {axis} to {axis + 1}"
    order = f" ({fit.series.name.split('_')[1]} a turn)" if kind == "ripple" else ""
    return f"{kind} of axis {axis}{order}"


def _unit(fit: SeriesFit) -> tuple[float, str]:
    """Factor and name of the unit that is shown."""
    return (URAD, "urad/(N m)") if fit.series.kind == "compliance" else (MRAD, "mrad")


def due_sentence(due: Due) -> str:
    """The days between which the next calibration is due."""
    tolerance, sigma = (significant_text(x * MM) for x in (due.tolerance, due.sigma))
    if due.sigma >= due.tolerance:
        return (
            f"The last calibration does not hold {tolerance} mm: its stated uncertainty is {sigma} "
            "mm."
        )
    window = f"not before {due.earliest or 'ten years'}"
    if due.latest is not None:
        window = f"between {due.earliest} and {due.latest}"
    slow, fast = (significant_text(rate * UM, 2) for rate in due.rates)
    return (
        f"Next calibration at {tolerance} mm mean TCP error: {window}; the tool drifts by {slow} "
        f"to {fast} um a month (95 %)."
    )


def rows(history: History) -> list[tuple[str, ...]]:
    """Rows of the table: a result each, as HEAD names the columns."""
    table, used = [], list[int]()
    for k, result in enumerate(history.results):
        changed = ["", ""]
        if not result.acceptable:
            changed = [f"not used: verdict {result.calibration.file.fit.status}", ""]
        elif used:
            changed = [_changed(history, first, k) for first in (used[0], used[-1])]
        used += [k] * result.acceptable
        numbers = (history.nominal[k], result.calibration.tcp_sigma)
        day = f"{result.day}{'' if result.measured else ' (file)'}"
        table.append((day, *(significant_text(float(x) * MM) for x in numbers), *changed))
    return table


def _changed(history: History, first: int, last: int) -> str:
    """The largest change of each axis between two results."""
    largest: dict[int, str] = {}
    for fit, size, z in history.changes(first, last):
        factor, unit = _unit(fit)
        text = f"{fit.series.kind} {significant_text(size * factor, 2, sign=True)} {unit}"
        largest.setdefault(fit.series.axis, f"axis {fit.series.axis}: {text} ({abs(z):.0f} sigma)")
    texts, more = list(largest.values()), len(largest) - LISTED
    return ", ".join(texts[:LISTED] + [f"{more} more"] * (more > 0)) or MISSING


def history_data(history: History, due: Due | None) -> dict[str, Any]:
    """The history as plain data: results as in the table, sizes in SI units."""
    findings = zip(history.findings, sentences(history), strict=False)
    return {
        "results": [dict(zip(HEAD, row, strict=True)) for row in rows(history)],
        "findings": [
            {name: getattr(finding, name) for name in ("kind", "axes")}
            | {"begin": f"{finding.begin}", "end": f"{finding.end}", "sentence": sentence}
            | {"sizes": {fit.series.name: [e.size, e.sigma] for fit, e in finding.events}}
            for finding, sentence in findings
        ],
        "due": due
        and asdict(due)
        | {name: (day := getattr(due, name)) and f"{day}" for name in ("earliest", "latest")}
        | {"sentence": due_sentence(due)},
    }


def say_history(out: Console, history: History, due: Due | None) -> None:
    """Print the table, the findings, and when calibration is due."""
    table = Table(box=None, pad_edge=False)
    for k, name in enumerate(HEAD):
        table.add_column(escape(name), justify="right" if k in (1, 2) else "left", no_wrap=k == 0)
    for row in rows(history):
        table.add_row(*map(escape, row))
    out.print(table)
    colour = "yellow" if history.findings else "green"
    for sentence in sentences(history):
        out.print(f"[{colour}]{escape(sentence)}[/]")
    if due is not None:
        out.print(escape(due_sentence(due)))
    out.print(f"Named are changes beyond {history.limit:.1f} sigma and 5 um at the tool.")


def write_history(path: Path, history: History, due: Due | None) -> None:
    """Write the page, or the figure alone, by the ending of a new file's name.

    Raises InputError for another ending, and where the file exists.
    """
    kind, title = path.suffix.lower(), history.results[0].calibration.robot.title
    said = [*sentences(history), *([due_sentence(due)] if due else [])]
    if kind not in (".html", ".svg", ".png"):
        what = f"ends in {kind or 'nothing'}, and a history is written as"
        raise InputError.at(path, what, ".html, .svg or .png.")
    if kind != ".html":
        write_new(path, history_image(history, [title, *said], kind))
        return
    figure = Markup(history_image(history, (), ".svg").decode())
    page = template("history.html").render(
        history=history, title=title, sentences=said, head=HEAD, rows=rows(history), figure=figure
    )
    write_new(path, page.encode())
