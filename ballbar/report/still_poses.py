"""Sections of what only still poses show: errors of what was left out, joint errors, places."""

from __future__ import annotations

import numpy as np

from ballbar.figure_style import AFTER, BEFORE, PURPLE
from ballbar.report.line_plot import Distribution, cumulative, order_spectra
from ballbar.report.maps import AFTER_SCALE, BEFORE_SCALE, workspace_map
from ballbar.report.numbers import significant
from ballbar.report.section import Section, section
from ballbar.report.summary import QUANTITIES
from ballbar.result.run_data import RunData
from ballbar.units import MM, MRAD, URAD
from cell.arrays import Array
from ident.corrections.joint_harmonics import harmonic_name
from ident.fitted_robot import MOSTLY_PRIOR
from ident.table_estimate import TableEstimate

Row = dict[str, object]  # of a table, by the columns of the template


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
    search = result.search
    values = dict(zip(result.fit.model.unknowns.names, result.fit.x.tolist(), strict=True))
    rows: list[Row] = []
    for o in search.orders:
        name = harmonic_name(o.joint, o.order)
        size = float(np.hypot(values[f"{name}_cos"], values[f"{name}_sin"]))
        rows.append(
            {
                "joint": o.joint + 1,
                "order": f"{o.order:g}",
                "amplitude": f"{size * URAD:.0f}",
                "score": f"{o.score:.0f}",
                "gain": f"{o.gain * 100.0:.1f}",
                "aliases": ", ".join(f"{a:g}" for a in o.aliases),
            }
        )
    spectra = order_spectra(search.spectrum_before, search.spectrum_after)
    return [section("orders.html", {"orders": "Joint errors"}, spectra=spectra, orders=rows)]


def robot_section(run: RunData) -> list[Section]:
    """DH rows, and the sag of the joints under unit weights."""
    result = run.identification.poses
    if result is None or run.recordings:
        return []
    layout = result.fit.model.unknowns
    parameters = []
    for k, parameter in enumerate(layout.parameters):
        scale, unit = (MM, "mm") if parameter.is_length else (MRAD, "mrad")
        parameters.append(_row(result, parameter.name, float(layout.mean[k]), scale, unit, 3))
    sag = [
        _row(result, coefficient.name, 0.0, URAD, "urad/m", 1) | {"nominal": "0"}
        for correction in result.fit.model.corrections
        if correction.name == "unit_weights"
        for coefficient in correction.coefficients
    ]
    links = {"parameters": "Parameters", "sag": "Sag"}
    return [section("robot.html", links, parameters=parameters, sag=sag)]


def _row(
    result: TableEstimate, name: str, nominal: float, scale: float, unit: str, decimals: int
) -> Row:
    """One unknown of the robot; nominal : in SI, as its value is."""
    i = result.fit.model.unknowns.names.index(name)
    value, sigma = float(result.fit.x[i]), float(np.sqrt(result.fit.covariance[i, i]))
    return {
        "name": name,
        "unit": unit,
        "nominal": f"{nominal * scale:.{decimals}f}",
        "identified": f"{value * scale:.{decimals}f}",
        "deviation": f"{(value - nominal) * scale:+.{decimals}f}",
        "sigma": f"{sigma * scale:.{decimals}f}",
        "known": result.information_gain[i] > MOSTLY_PRIOR,
    }


def place_sections(run: RunData) -> list[Section]:
    """Fitted ranges, seats and targets, the groups of poses, and the findings of the import."""
    poses, tables = run.identification.poses, run.tables
    if poses is None:
        return []
    ends = np.rad2deg([poses.table.q.min(axis=0), poses.table.q.max(axis=0)])
    placements = [
        (f"{kind} {name}", _mm(estimate.placement.origin), _mm(estimate.sigma))
        for kind, places in (("seat", poses.seats), ("target", poses.targets))
        for name, estimate in places.items()
    ]
    groups = [
        (
            group.seat,
            group.target,
            group.file,
            group.size,
            QUANTITIES[group.measured],
            significant(float(error.mean()) * MM, 3),
        )
        for group, error in zip(poses.table.groups, poses.errors, strict=True)
    ]
    return [
        section(
            "places.html",
            {"ranges": "Fitted ranges", "places": "Seats and targets"},
            alone=poses.alone,
            ranges=[(j, f"{a:.1f}", f"{b:.1f}") for j, (a, b) in enumerate(ends.T, start=1)],
            placements=placements,
            groups=groups,
            findings=[f for _, _, content in tables for f in content.report.findings],
        )
    ]


def _mm(lengths: Array) -> list[str]:
    return [f"{v * MM:.3f}" for v in lengths]
