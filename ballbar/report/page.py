"""report.html: one page about one run, the verdict in sentences before any number.

RunData -> summary, TCP view, machine, recordings, provenance -> templates/report.html. No script,
no request to another host.
"""

from __future__ import annotations

from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from ballbar.report.diagnosis import diagnosis
from ballbar.report.log_figures import log_section
from ballbar.report.machine import machine_section
from ballbar.report.numbers import significant
from ballbar.report.provenance import provenance
from ballbar.report.recording import recording_sections, residual_section
from ballbar.report.summary import summary
from ballbar.report.tcp_view import tcp_section, tcp_view
from ballbar.result.run_data import RunData
from cell.files import write_whole
from cell.foreign_text import printable
from cell.processes import Begin


def write_report(path: Path, data: RunData, *, command: str, begin: Begin = partial) -> None:
    """Write the report of one run, whole or not at all.

    command : as the user typed it; absolute paths in it are cut to their last part. begin : draws
        some of it meanwhile.
    """
    page = render_report(data, command=command, written=datetime.now(UTC), begin=begin)
    write_whole(path, printable(page, allowed="\n\t").encode())


def render_report(data: RunData, *, command: str, written: datetime, begin: Begin = partial) -> str:
    """The page as text; the same inputs give the same text."""
    logs = [begin(log_section, fitted) for fitted in data.recordings]
    figures = [begin(residual_section, fitted) for fitted in data.recordings]
    view = tcp_view(data)
    tcp, machine = tcp_section(data, view), machine_section(data)
    last_first = [drawn() for drawn in reversed(figures)]  # what comes last may not be begun yet
    return template("report.html").render(
        title=data.name,
        result=data.identification,
        against_truth=data.comparison is not None,
        several=data.several,
        summary=summary(data, view),
        tcp=tcp,
        diagnosis=diagnosis(data),
        machine=machine,
        recordings=recording_sections(data, last_first[::-1], [drawn() for drawn in logs]),
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
