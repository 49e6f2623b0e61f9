"""A history in words, as a table, as plain data, and as a page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ballbar.cell.errors import InputError
from ballbar.cell.files import write_new
from ballbar.cell.foreign_text import printable
from ballbar.cell.number_text import significant_text
from ballbar.history.events import Event, SeriesFit
from ballbar.history.figure import history_png, history_svg
from ballbar.history.history import Due, Finding, History
from ballbar.report.numbers import MISSING, decimals_for, listed
from ballbar.report.section import template
from ballbar.units import MM, MRAD, UM, URAD

LISTED = 2  # changes of one result that its row names
CAUSES = {
    "collision": "a collision, or a zero that was set anew",
    "gear": "the gear was replaced, or is damaged",
    "change": "at once or gradually, which later results will show",
}


def sentences(history: History) -> list[str]:
    """One sentence for each finding, or that nothing was found."""
    if history.findings:
        return [_sentence(finding, history) for finding in history.findings]
    axes = sorted({fit.series.axis for fit in history.fits})
    return [
        f"No axis changed by more than chance explains, of {len(history.fits)} quantities of axes "
        f"{listed([str(axis) for axis in axes])}."
        if axes
        else "Nothing can be compared: no quantity of an axis is stated on two days."
    ]


def _sentence(finding: Finding, history: History) -> str:
    begin, end = finding.begin, finding.end
    if finding.kind == "wear":
        since = f"since {begin}" if begin == end else f"since between {begin} and {end}"
        if begin == history.results[0].day:
            since = "over all results" if begin == end else f"since {end} at the latest"
        what = "; ".join(_amounts(finding.events, " a month"))
        return f"Axis {finding.axes[0]} wears {since}: {what}."
    what = "; ".join(_amounts(finding.events, ""))
    where = f"axis {finding.axes[0]}" if len(finding.axes) == 1 else f"axes {_axes(finding)}"
    cause = CAUSES[finding.kind]
    if len(finding.axes) > 1 and finding.kind == "collision":
        cause = "a collision"
    return f"Between {begin} and {end} {where} changed: {what}: {cause}."


def _axes(finding: Finding) -> str:
    return listed([str(axis) for axis in finding.axes])


def _amounts(events: Sequence[tuple[SeriesFit, Event]], tail: str) -> Iterator[str]:
    """Name and size of each event, sine and cosine of a ripple together; `tail` follows units."""
    merged: dict[str, list[tuple[SeriesFit, Event]]] = {}
    for fit, event in sorted(events, key=lambda pair: -pair[1].gain):
        merged.setdefault(label(fit), []).append((fit, event))
    for name, members in merged.items():
        size = float(np.linalg.norm([event.size for _, event in members]))
        sigma = max(event.sigma for _, event in members)
        sign = len(members) == 1
        text = amount(members[0][0], members[0][1].size if sign else size, sigma, sign=sign)
        month = tail or (" a month" if members[0][1].drift else "")
        yield f"{name} {text}{month}"


def label(fit: SeriesFit) -> str:
    """What a series is of, such as `zero of axis 3`."""
    series = fit.series
    if series.kind == "twist":
        return f"angle of axis {series.axis} to {series.axis + 1}"
    parts = series.name.split("_")
    order = f" ({parts[1]} a turn)" if series.kind == "ripple" else ""
    return f"{series.kind} of axis {series.axis}{order}"


def scale(unit: str) -> tuple[float, str]:
    """Factor and name of the unit that is shown."""
    return (URAD, "urad/(N m)") if unit == "rad/(N m)" else (MRAD, "mrad")


def amount(fit: SeriesFit, size: float, sigma: float, *, sign: bool = True) -> str:
    """A size with its expanded uncertainty (k = 2)."""
    factor, unit = scale(fit.series.unit)
    decimals = decimals_for([2.0 * sigma * factor], digits=1)
    shown = f"{size * factor:{'+' if sign else ''}.{decimals}f}"
    return f"{shown} ± {2.0 * sigma * factor:.{decimals}f} {unit}"


def due_sentence(due: Due) -> str:
    """When the next calibration is due."""
    tolerance = f"{significant_text(due.tolerance * MM)} mm (mean TCP error)"
    if due.sigma >= due.tolerance:
        sigma = significant_text(due.sigma * MM)
        return (
            f"The last calibration does not hold {tolerance} at all: its stated uncertainty is "
            f"{sigma} mm."
        )
    fast = f"at most {significant_text(due.rates[1] * UM, 2)} um a month"
    if due.earliest is None:
        return f"Next calibration at {tolerance}: not before ten years, for the tool drifts {fast}."
    if due.latest is None:
        return (
            f"Next calibration at {tolerance}: not before {due.earliest}: the tool drifts {fast}."
        )
    slow = significant_text(due.rates[0] * UM, 2)
    return (
        f"Next calibration at {tolerance}: due between {due.earliest} and {due.latest}: the tool "
        f"drifts by {slow} to {significant_text(due.rates[1] * UM, 2)} um a month (95 %)."
    )


HEAD = (
    "date",
    "nominal robot off [mm]",
    "stated [mm]",
    "changed since the first",
    "since the one before",
)


def rows(history: History) -> list[tuple[str, ...]]:
    """Rows of the table: a result each, as HEAD names the columns."""
    used = [k for k, r in enumerate(history.results) if r.acceptable]
    table = []
    for k, result in enumerate(history.results):
        before = [j for j in used if j < k]
        pairs = ((before[0], k), (before[-1], k)) if before and result.acceptable else ()
        changed = [_changed(history, *pair) for pair in pairs] or ["", ""]
        if not result.acceptable:
            changed[0] = f"not used: verdict {result.calibration.file.fit.status}"
        day = f"{result.day}{'' if result.measured else ' (file)'}"
        sigma = result.calibration.tcp_sigma
        numbers = (significant_text(x * MM) for x in (history.nominal[k], sigma))
        table.append((day, *numbers, *changed))
    return table


def _changed(history: History, first: int, last: int) -> str:
    """The largest change of each axis between two results."""
    largest: dict[int, str] = {}
    for fit, size, z in history.changes(first, last):
        factor, unit = scale(fit.series.unit)
        text = f"{fit.series.kind} {significant_text(size * factor, 2, sign=True)} {unit}"
        largest.setdefault(fit.series.axis, f"axis {fit.series.axis}: {text} ({abs(z):.0f} sigma)")
    texts = list(largest.values())
    more = len(texts) - LISTED
    return ", ".join(texts[:LISTED] + [f"{more} more"] * (more > 0)) or MISSING


def remarks(history: History) -> list[str]:
    """What the reader of the history has to know."""
    return [
        f"Changes are named beyond {history.limit:.1f} sigma and 5 um at the tool: in one of 1000 "
        "histories of an unchanged robot anything is. ± is two standard deviations.",
        "Deviations are those of a repetition: path, instrument and plate are the same."
        if history.repeated
        else "The whole stated uncertainty counts, since results are of still poses, or path, "
        "instrument or model differ.",
        "Lengths, the zero of axis 1 (the base) and the last axis's mounting of the tool are not "
        "compared; no temperature is corrected.",
        *(
            ["(file): the day of the file, for nothing says when was measured."]
            if not all(r.measured for r in history.results)
            else []
        ),
    ]


def history_data(history: History, due: Due | None) -> dict[str, Any]:
    """The history as plain data, SI units."""
    return {
        "results": [
            {
                "file": str(r.calibration.path),
                "date": r.day.isoformat(),
                "measured": r.measured,
                "acceptable": r.acceptable,
                "tcp_error_nominal_mean_m": float(nominal),
                "tcp_sigma_m": r.calibration.tcp_sigma,
            }
            for r, nominal in zip(history.results, history.nominal, strict=True)
        ],
        "findings": [
            {
                "kind": finding.kind,
                "axes": list(finding.axes),
                "begin": finding.begin.isoformat(),
                "end": finding.end.isoformat(),
                "events": [
                    {
                        "name": fit.series.name,
                        "drift": event.drift,
                        "size": event.size,
                        "sigma": event.sigma,
                        "unit": fit.series.unit + " a month" * event.drift,
                    }
                    for fit, event in finding.events
                ],
                "sentence": sentence,
            }
            for finding, sentence in zip(history.findings, sentences(history), strict=False)
        ],
        "due": None
        if due is None
        else {
            "tolerance_m": due.tolerance,
            "earliest": due.earliest and due.earliest.isoformat(),
            "latest": due.latest and due.latest.isoformat(),
            "rates_m_a_month": list(due.rates),
            "sentence": due_sentence(due),
        },
    }


def history_page(history: History, due: Due | None) -> str:
    """The history as one page of HTML."""
    first, last = (r.day for r in (history.results[0], history.results[-1]))
    robot = history.results[0].calibration.robot.title
    return template("history.html").render(
        title=robot,
        subtitle=f"{len(history.results)} results, {first} to {last}",
        band="care" if history.findings else "good",
        heading="Changed" if history.findings else "Unchanged",
        sentences=[*sentences(history), *([due_sentence(due)] if due else [])],
        head=HEAD,
        rows=rows(history),
        remarks=remarks(history),
        figure=Markup(history_svg(history)),
    )


def say_history(out: Console, history: History, due: Due | None) -> None:
    """Print the table, the findings, and when calibration is due."""
    table = Table(
        box=None,
        pad_edge=False,
        title=f"History of {history.results[0].calibration.robot.title}",
        title_justify="left",
    )
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
    for remark in remarks(history):
        out.print(f"[dim]{escape(remark)}[/]")


def write_history(path: Path, history: History, due: Due | None) -> None:
    """Write the page, or the figure alone, by the ending of a new file's name.

    Raises InputError for another ending, and where the file exists.
    """
    match path.suffix.lower():
        case ".html":
            content = printable(history_page(history, due), allowed="\n\t").encode()
        case ".svg":
            content = history_svg(history).encode()
        case ".png":
            content = history_png(history)
        case other:
            what = f"ends in {other or 'nothing'}, and a history is written as"
            raise InputError.at(path, what, ".html, .svg or .png.")
    write_new(path, content)
