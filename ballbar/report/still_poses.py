"""Sections of what only still poses show: errors of what was left out, joint errors, places."""

from __future__ import annotations

import numpy as np

from ballbar.figure_style import AFTER, BEFORE, PURPLE
from ballbar.report.line_plot import Distribution, cumulative, order_spectra
from ballbar.report.maps import AFTER_SCALE, BEFORE_SCALE, workspace_map
from ballbar.report.section import Section, section
from ballbar.result.run_data import RunData
from ballbar.units import MM


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
            findings=[f for _, _, content in tables for f in content.report.findings],
        )
    ]
