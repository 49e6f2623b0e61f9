"""report.html: one page about one run, the verdict in sentences before any number.

RunData -> summary, TCP view, diagnosis, machine, recordings, provenance -> templates/report.html.
Its script shows values at the cursor and asks no host for anything.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup, escape

from ballbar.report.machine import machine_section
from ballbar.report.maps import correlation_map
from ballbar.report.numbers import significant
from ballbar.report.provenance import provenance
from ballbar.report.recording import recording_section
from ballbar.report.summary import summary
from ballbar.report.tcp_view import tcp_section, tcp_view
from ballbar.result.run_data import RunData
from cell.files import write_whole
from cell.foreign_text import printable
from ident.estimator.uncertainty import correlated_groups


def write_report(path: Path, data: RunData, *, command: str) -> None:
    """Write the report of one run, whole or not at all.

    command : as the user typed it; absolute paths in it are cut to their last part.
    """
    page = render_report(data, command=command, written=datetime.now(UTC))
    write_whole(path, printable(page, allowed="\n\t").encode())


def render_report(data: RunData, *, command: str, written: datetime) -> str:
    """The page as text; the same inputs give the same text."""
    from ballbar.report.diagnosis import diagnosis  # noqa: PLC0415  imports the planner

    view, covariance = tcp_view(data), data.identification.robot.covariance
    return template("report.html").render(
        title=data.name,
        result=data.identification,
        against_truth=data.comparison is not None,
        several=data.several,
        summary=summary(data, view),
        tcp=tcp_section(data, view),
        diagnosis=diagnosis(data),
        machine=machine_section(data),
        correlations=correlation_map(
            covariance, correlated_groups(covariance.values, covariance.names)
        ),
        recordings=[
            recording_section(data, number, fitted)
            for number, fitted in enumerate(data.recordings, start=1)
        ],
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
    environment.filters["with_code"] = _with_code
    return environment.get_template(name)


def _with_code(text: str) -> Markup:
    """A sentence, escaped, with what stands between backticks as code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))
