"""report.html: one page about one run, the verdict in sentences before any number.

RunData -> summary, TCP view, diagnosis, machine, recordings, provenance -> templates/report.html.
Its script shows values at the cursor and asks no host for anything.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup, escape

from ballbar.report.log_figures import log_section
from ballbar.report.machine import machine_section
from ballbar.report.matplotlib_figures import (
    SphereFigures,
    cell_figure,
    correlation_figure,
    sphere_figures,
)
from ballbar.report.numbers import significant
from ballbar.report.provenance import provenance
from ballbar.report.recording import recording_sections, residual_section
from ballbar.report.summary import summary
from ballbar.report.tcp_view import TcpSection, tcp_section, tcp_view
from ballbar.result.run_data import RunData
from cell.files import write_whole
from cell.foreign_text import printable
from cell.processes import Begin

if TYPE_CHECKING:
    from ballbar.report.diagnosis import DiagnosisSection


@dataclass(frozen=True)
class BegunParts:
    """Functions that give the parts of a page that take longest; `begin_parts` makes them."""

    diagnosis: Callable[[], DiagnosisSection]
    tcp: Callable[[], TcpSection]
    spheres: list[Callable[[], SphereFigures]]  # of each recording
    cells: list[Callable[[], str]]  # likewise
    correlations: Callable[[], str]


def begin_parts(data: RunData, begin: Begin = partial) -> BegunParts:
    """Begins maps and predictions of a report; begin : meanwhile (ballbar.report.process)."""
    cell = data.identification.robot.cell
    shown = replace(data, simulation=None)  # no part needs its motion, which is large to send
    return BegunParts(
        diagnosis=partial(_diagnosis, shown),
        tcp=begin(tcp_section, shown),
        spheres=[begin(sphere_figures, fitted) for fitted in data.recordings],
        cells=[begin(cell_figure, cell, fitted) for fitted in data.recordings],
        correlations=begin(correlation_figure, data.identification.robot),
    )


def write_report(path: Path, data: RunData, parts: BegunParts, *, command: str) -> None:
    """Write the report of one run, whole or not at all.

    command : as the user typed it; absolute paths in it are cut to their last part.
    """
    page = render_report(data, parts, command=command, written=datetime.now(UTC))
    write_whole(path, printable(page, allowed="\n\t").encode())


def render_report(data: RunData, parts: BegunParts, *, command: str, written: datetime) -> str:
    """The page as text; the same inputs give the same text."""
    view = tcp_view(data)
    logs = [log_section(fitted) for fitted in data.recordings]
    machine, origin = machine_section(data), provenance(data, command, written)
    diagnosed, tcp, spheres = parts.diagnosis(), parts.tcp(), [drawn() for drawn in parts.spheres]
    residuals = [
        residual_section(fitted, drawn)
        for fitted, drawn in zip(data.recordings, spheres, strict=True)
    ]
    return template("report.html").render(
        title=data.name,
        result=data.identification,
        against_truth=data.comparison is not None,
        several=data.several,
        summary=summary(data, view),
        tcp=tcp,
        diagnosis=diagnosed,
        machine=machine,
        correlations=parts.correlations(),
        recordings=recording_sections(data, residuals, logs, [cell() for cell in parts.cells]),
        provenance=origin,
    )


def _diagnosis(data: RunData) -> DiagnosisSection:
    from ballbar.report.diagnosis import diagnosis  # noqa: PLC0415  imports the planner

    return diagnosis(data)


def template(name: str) -> Template:
    """A page of ballbar/report/templates: text from files is escaped, a missing value an error."""
    environment = Environment(
        loader=PackageLoader("ballbar.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["significant"] = significant
    environment.filters["with_code"] = _with_code
    return environment.get_template(name)


def _with_code(text: str) -> Markup:
    """A sentence, escaped, with what stands between backticks as code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))
