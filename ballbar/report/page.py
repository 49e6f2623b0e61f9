"""report.html: one page about one run, the verdict in sentences before any number.

Each section says itself whether the run has what it shows. The script of the page shows values at
the cursor and asks no host for anything.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ballbar.cell.files import write_whole
from ballbar.cell.foreign_text import printable
from ballbar.figure_style import AFTER, BEFORE, PURPLE
from ballbar.report.budget import budget_section
from ballbar.report.line_plot import Distribution, cumulative, order_spectra
from ballbar.report.machine import (
    advised_steps,
    diagnosis_section,
    held_out_imports,
    machine_sections,
)
from ballbar.report.maps import AFTER_SCALE, BEFORE_SCALE, workspace_map
from ballbar.report.performance import performance_section
from ballbar.report.provenance import provenance_section
from ballbar.report.recording import recording_sections
from ballbar.report.section import Section, machine_row, section, template
from ballbar.report.summary import summary
from ballbar.report.tcp_view import tcp_section, tcp_view
from ballbar.result.run_data import RunData
from ballbar.units import MM


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
        tcp_section(run, view),
        *diagnosis_section(run, steps),
        *performance_section(run),
        *budget_section(run),
        *machine_sections(run),
        *joint_error_section(run),
        *place_sections(run),
        *recording_sections(run),
        *held_out_imports(run),
        provenance_section(run, command, written),
        _limits(run, view.scale),
    ]
    return template("report.html").render(
        title=run.name,
        summary=summary(run, view, steps.advice),
        sections=sections,
        navigation=_navigation(sections),
    )


def _limits(run: RunData, scale: float) -> Section:
    return section(
        "limits.html",
        {"limits": "How to read"},
        machine_row(run),
        result=run.identification,
        against_truth=run.comparison is not None,
        scale=scale,
    )


def _navigation(sections: list[Section]) -> dict[str, list[tuple[str, str]]]:
    """Links of all sections, row by row."""
    rows: dict[str, list[tuple[str, str]]] = {}
    for part in sections:
        rows.setdefault(part.row, []).extend(part.links)
    return {row: links for row, links in rows.items() if links}


def error_section(run: RunData) -> list[Section]:
    """Errors over the poses and the workspace: nominal, fitted, and left out of the fit."""
    result = run.identification.poses
    if result is None:
        return []
    curves = [
        Distribution("nominal robot", result.residual_nominal, BEFORE),
        Distribution("identified, left out", result.cross_validation.error, PURPLE),
        Distribution("identified, fitted poses", result.residual, AFTER),
    ]
    points = result.fit.linear.evaluations[result.fit.still]
    places = np.concatenate([p.target_closure.robot.tip.T for p in points])
    maps = [
        workspace_map(places, errors, (), label=label, colours=colours)
        for errors, label, colours in (
            (result.residual_nominal, "nominal robot", BEFORE_SCALE),
            (result.cross_validation.error, "identified, left out", AFTER_SCALE),
        )
    ]
    figure = cumulative(curves, label="error of a pose")
    return [section("errors.html", {"errors": "Errors"}, cumulative=figure, maps=maps)]


def joint_error_section(run: RunData) -> list[Section]:
    """Scores of all orders before and after the search, and the joint errors found."""
    result = run.identification.poses
    if result is None or result.search is None:
        return []
    spectra = order_spectra(result.search.spectrum_before, result.search.spectrum_after)
    links = {"orders": "Joint errors"}
    return [section("orders.html", links, spectra=spectra, orders=result.search.orders)]


def place_sections(run: RunData) -> list[Section]:
    """Fitted ranges, seats and targets, the groups of poses, and the findings of the import."""
    poses, tables = run.identification.poses, run.tables
    if poses is None:
        return []
    ends = np.rad2deg([poses.table.q.min(axis=0), poses.table.q.max(axis=0)])
    return [
        section(
            "places.html",
            {"ranges": "Fitted ranges", "places": "Seats and targets"},
            poses=poses,
            ranges=ends.T.tolist(),
            errors=[float(error.mean()) * MM for error in poses.errors],
            findings=[f for _, content in tables for f in content.report.findings],
        )
    ]
