"""report.html: one page about one run, the verdict in sentences before any number.

Each section says itself whether the run has what it shows. The script of the page shows values at
the cursor and asks no host for anything.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from ballbar.report.diagnosis import advised_steps, diagnosis_section
from ballbar.report.machine import held_out_imports, machine_section
from ballbar.report.provenance import provenance_section
from ballbar.report.recording import recording_sections
from ballbar.report.section import MACHINE, Section, section, template
from ballbar.report.still_poses import (
    error_section,
    joint_error_section,
    place_sections,
    robot_section,
)
from ballbar.report.summary import summary
from ballbar.report.tcp_view import tcp_section, tcp_view
from ballbar.result.run_data import RunData
from cell.files import write_whole
from cell.foreign_text import printable


def write_report(path: Path, run: RunData, *, command: str) -> None:
    """Write the report of one run, whole or not at all.

    command : as the user typed it; absolute paths in it are cut to their last part.
    """
    page = render_report(run, command=command, written=datetime.now(UTC))
    write_whole(path, printable(page, allowed="\n\t").encode())


def render_report(run: RunData, *, command: str, written: datetime) -> str:
    """The page as text; the same inputs give the same text."""
    view, steps = tcp_view(run), advised_steps(run)
    sections = [
        *error_section(run),
        *tcp_section(run, view),
        *diagnosis_section(run, steps),
        *machine_section(run),
        *joint_error_section(run),
        *robot_section(run),
        *place_sections(run),
        *recording_sections(run),
        *held_out_imports(run),
        provenance_section(run, command, written),
        _limits(run, view.scale if view else None),
    ]
    return template("report.html").render(
        title=run.name,
        summary=summary(run, view, steps.advice),
        sections=sections,
        navigation=_navigation(sections),
    )


def _limits(run: RunData, scale: float | None) -> Section:
    return section(
        "limits.html",
        {"limits": "How to read"},
        MACHINE if run.recordings else "",
        result=run.identification,
        moving=bool(run.recordings),
        against_truth=run.comparison is not None,
        scale=scale,
    )


def _navigation(sections: list[Section]) -> dict[str, list[tuple[str, str]]]:
    """Links of all sections, row by row."""
    rows: dict[str, list[tuple[str, str]]] = {}
    for part in sections:
        rows.setdefault(part.row, []).extend(part.links)
    return {row: links for row, links in rows.items() if links}
