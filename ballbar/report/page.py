"""report.html: one page about one run, the verdict in sentences before any number.

RunData -> summary, TCP view, machine, recordings, provenance -> templates/report.html. No script,
no request to another host.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from ballbar.report.machine import machine_section
from ballbar.report.numbers import significant
from ballbar.report.provenance import provenance
from ballbar.report.recording import recording_sections
from ballbar.report.summary import summary
from ballbar.report.tcp_view import tcp_section, tcp_view
from ballbar.result.run_data import RunData
from cell.files import write_whole


def write_report(path: Path, data: RunData, *, command: str) -> None:
    """Write the report of one run, whole or not at all.

    command : as the user typed it; absolute paths in it are cut to their last part.
    """
    write_whole(path, render_report(data, command=command, written=datetime.now(UTC)).encode())


def render_report(data: RunData, *, command: str, written: datetime) -> str:
    """The page as text; the same inputs give the same text."""
    view = tcp_view(data)
    return template("report.html").render(
        title=data.name,
        result=data.identification,
        against_truth=data.comparison is not None,
        several=data.several,
        summary=summary(data, view),
        tcp=tcp_section(data, view),
        machine=machine_section(data),
        recordings=recording_sections(data),
        provenance=provenance(data, command, written),
    )


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
    return environment.get_template(name)
