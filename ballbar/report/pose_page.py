"""report.html of an identification from still poses; the look of the report on logs.

PoseRun -> verdict, tiles, errors, comparison with the truth where it is known, parameters, joint
errors, seats and targets, provenance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from markupsafe import Markup

from ballbar.figure_style import AFTER, BEFORE, PURPLE
from ballbar.report.figures import (
    AFTER_SCALE,
    BEFORE_SCALE,
    Curve,
    cumulative,
    order_spectra,
    workspace_map,
)
from ballbar.report.numbers import listed, significant
from ballbar.report.page import template
from ballbar.report.provenance import InputFile, hashed, versions, without_folders
from ballbar.report.summary import Tile
from ballbar.report.tcp_view import TcpRow, tcp_row
from ballbar.result.calibration_content import KNOWN
from ballbar.result.compare import Comparison
from ballbar.result.run_data import PoseRun
from ballbar.units import MM, MRAD, URAD
from cell.arrays import Array
from cell.files import write_whole
from cell.foreign_text import printable
from cell.pose_file import pose_file_path
from ident.corrections.joint_harmonics import harmonic_name
from ident.pose_result import PoseIdentification
from ident.verdict import Status

_BANDS = {Status.GOOD: "good", Status.SUSPECT: "care"}
_HEADINGS = {Status.GOOD: "Acceptable", Status.SUSPECT: "Acceptable, with care"}
_SOURCES = {
    "length": "distances",
    "point": "points",
    "pose": "whole poses",
    "socket": "touched sockets",
}


@dataclass(frozen=True)
class Row:
    """One unknown of the robot."""

    name: str
    unit: str
    nominal: str
    identified: str
    deviation: str
    sigma: str
    known: bool


@dataclass(frozen=True)
class RangeRow:
    """Fitted range of a joint."""

    joint: int
    lower: str
    upper: str


@dataclass(frozen=True)
class OrderRow:
    """A joint error found by evidence."""

    joint: int
    order: str
    amplitude: str
    score: str
    gain: str
    aliases: str


@dataclass(frozen=True, eq=False)
class TruthSection:
    """TCP error over the fitted ranges where the true robot is known."""

    poses: int
    target: str
    rows: list[TcpRow]
    cumulative: Markup
    maps: tuple[Markup, Markup]


def write_pose_report(
    path: Path, run: PoseRun, comparison: Comparison | None = None, *, command: str
) -> None:
    """Write the report, whole or not at all.

    comparison : with the truth, where it is known. command : as the user typed it.
    """
    page = render_pose_report(run, comparison, command=command, written=datetime.now(UTC))
    write_whole(path, printable(page, allowed="\n\t").encode())


def render_pose_report(
    run: PoseRun, comparison: Comparison | None = None, *, command: str, written: datetime
) -> str:
    """The page as text; the same inputs give the same text."""
    result = run.identification
    outcomes = [outcome for _, _, outcome in run.held_out]
    failed = [outcome.name for outcome in outcomes if not outcome.acceptable]
    verdict = result.verdict
    return template("poses.html").render(
        title=run.name,
        subtitle=_subtitle(run),
        band=_BANDS.get(verdict.status, "bad") if run.acceptable else "bad",
        heading=f"Held-out poses not explained: {', '.join(failed)}"
        if failed
        else _HEADINGS.get(verdict.status, "Not acceptable"),
        sentences=[*(outcome.sentence for outcome in outcomes), verdict.sentence],
        warnings=verdict.warnings,
        tiles=_tiles(result, comparison),
        truth=None if comparison is None else _truth(result, comparison),
        cumulative=_error_figure(result),
        maps=_maps(result),
        spectra=_spectra(result),
        orders=_orders(result),
        parameters=_parameters(result),
        sag=_sag(result),
        ranges=_ranges(result),
        placements=_placements(result),
        groups=[
            (
                p.still.seat,
                p.still.target,
                p.still.file,
                p.still.size,
                _SOURCES[p.still.measured],
                significant(float(np.linalg.norm(p.closure.error[:3], axis=0).mean()) * MM, 3),
            )
            for p in result.fit.linear.evaluations
        ],
        findings=[f for _, _, content in run.folders for f in content.report.findings],
        command=without_folders(command),
        versions=versions(simulated=comparison is not None),
        inputs=_inputs(run),
        written=f"{written:%Y-%m-%d %H:%M:%S} UTC",
    )


def _subtitle(run: PoseRun) -> str:
    table = run.identification.table
    kinds = listed(sorted({_SOURCES[g.measured] for g in table.groups}))
    return f"{table.robot.title}; {table.size} still poses, {kinds}."


def _tiles(result: PoseIdentification, comparison: Comparison | None) -> list[Tile]:
    validation, fit = result.cross_validation, result.fit
    orders = result.search.orders if result.search else ()
    fitted, before = result.residual_means
    known = [] if comparison is None else [_tcp_tile(comparison)]
    return [
        *known,
        Tile(
            "Stated TCP uncertainty",
            f"{result.sigma_at_poses.mean() * MM:.3f} mm",
            f"mean at the measured poses; extrapolated over the whole ranges "
            f"{result.tcp_sigma.mean() * MM:.3f} mm",
        ),
        Tile(
            "Error where it was not fitted",
            f"{validation.mean * MM:.3f} mm",
            f"mean; 95 % below {validation.quantile * MM:.3f} mm",
        ),
        Tile("Nominal robot", f"{before * MM:.3f} mm", "mean, seats and targets fitted"),
        Tile("Fitted poses", f"{fitted * MM:.3f} mm", f"mean of {validation.counting.sum()}"),
        Tile("Joint errors", str(len(orders)), "orders found by evidence"),
        Tile("Unknowns", str(fit.model.unknowns.count), f"{fit.iterations} iterations"),
    ]


def _tcp_tile(comparison: Comparison) -> Tile:
    tcp, before = comparison.tcp, comparison.tcp_nominal
    return Tile(
        "TCP error against the truth",
        f"{tcp.mean * MM:.3f} mm",
        f"mean; largest {tcp.maximum * MM:.3f} mm; nominal robot {before.mean * MM:.3f} mm",
    )


def _truth(result: PoseIdentification, comparison: Comparison) -> TruthSection:
    tcp, before = comparison.tcp, comparison.tcp_nominal
    curves = [
        Curve("nominal robot", before.error, BEFORE),
        Curve("identified robot", tcp.error, AFTER),
        Curve("stated sigma", result.tcp_sigma, AFTER, dashed=True),
    ]
    return TruthSection(
        poses=tcp.error.size,
        target=comparison.target,
        rows=[
            tcp_row("nominal robot", before.error, "before", before.error_without_scale),
            tcp_row("identified robot", tcp.error, "after", tcp.error_without_scale),
            tcp_row("stated sigma", result.tcp_sigma, "after"),
        ],
        cumulative=cumulative(curves, label="TCP error"),
        maps=(
            workspace_map(
                before.position, before.error, (), label="nominal robot", colours=BEFORE_SCALE
            ),
            workspace_map(
                tcp.position, tcp.error, (), label="identified robot", colours=AFTER_SCALE
            ),
        ),
    )


def _error_figure(result: PoseIdentification) -> Markup:
    curves = [
        Curve("nominal robot", result.residual_nominal, BEFORE),
        Curve("identified, left out", result.cross_validation.error, PURPLE),
        Curve("identified, fitted poses", result.residual, AFTER),
    ]
    return cumulative(curves, label="error of a pose")


def _maps(result: PoseIdentification) -> list[Markup]:
    places = np.concatenate([p.target_closure.robot.tip.T for p in result.fit.linear.evaluations])
    before = workspace_map(
        places, result.residual_nominal, (), label="nominal robot", colours=BEFORE_SCALE
    )
    after = workspace_map(
        places, result.cross_validation.error, (), label="identified, left out", colours=AFTER_SCALE
    )
    return [before, after]


def _spectra(result: PoseIdentification) -> Markup | None:
    if result.search is None:
        return None
    return order_spectra(result.search.spectrum_before, result.search.spectrum_after)


def _orders(result: PoseIdentification) -> list[OrderRow]:
    if result.search is None:
        return []
    layout, x = result.fit.model.unknowns, result.fit.x
    values = dict(zip(layout.names, x.tolist(), strict=True))
    rows = []
    for o in result.search.orders:
        name = harmonic_name(o.joint, o.order)
        size = float(np.hypot(values[f"{name}_cos"], values[f"{name}_sin"]))
        rows.append(
            OrderRow(
                o.joint + 1,
                f"{o.order:g}",
                f"{size * URAD:.0f}",
                f"{o.score:.0f}",
                f"{o.gain * 100.0:.1f}",
                ", ".join(f"{a:g}" for a in o.aliases),
            )
        )
    return rows


def _parameters(result: PoseIdentification) -> list[Row]:
    layout = result.fit.model.unknowns
    sigma, gain = result.sigma, result.information_gain
    rows = []
    for k, parameter in enumerate(layout.parameters):
        scale, unit = (MM, "mm") if parameter.is_length else (MRAD, "mrad")
        value, nominal = float(result.fit.x[k]), float(layout.mean[k])
        rows.append(
            Row(
                name=parameter.name,
                unit=unit,
                nominal=f"{nominal * scale:.3f}",
                identified=f"{value * scale:.3f}",
                deviation=f"{(value - nominal) * scale:+.3f}",
                sigma=f"{sigma[parameter.name] * scale:.3f}",
                known=gain[parameter.name] > KNOWN,
            )
        )
    return rows


def _sag(result: PoseIdentification) -> list[Row]:
    """The coefficients of unit weights."""
    values = dict(zip(result.fit.model.unknowns.names, result.fit.x.tolist(), strict=True))
    corrections = [c for c in result.fit.model.corrections if c.name == "unit_weights"]
    return [
        Row(
            name=c.name,
            unit="urad/m",
            nominal="0",
            identified=f"{values[c.name] * URAD:.1f}",
            deviation=f"{values[c.name] * URAD:+.1f}",
            sigma=f"{result.sigma[c.name] * URAD:.1f}",
            known=result.information_gain[c.name] > KNOWN,
        )
        for correction in corrections
        for c in correction.coefficients
    ]


def _ranges(result: PoseIdentification) -> list[RangeRow]:
    low, high = np.rad2deg(result.table.q.min(axis=0)), np.rad2deg(result.table.q.max(axis=0))
    return [
        RangeRow(j + 1, f"{a:.1f}", f"{b:.1f}")
        for j, (a, b) in enumerate(zip(low, high, strict=True))
    ]


def _placements(result: PoseIdentification) -> list[tuple[str, list[str], list[str]]]:
    """Seats and targets: name, position, sigma [mm]."""
    layout, x = result.fit.model.unknowns, result.fit.x
    deviations = np.sqrt(np.diag(result.fit.covariance))
    rows = []
    for kind, places, place in (
        ("seat", layout.seats, layout.seat),
        ("target", layout.targets, layout.target),
    ):
        for name, part in places.items():
            origin: Array = place(x, name).origin
            rows.append(
                (
                    f"{kind} {name}",
                    [f"{v * MM:.3f}" for v in origin],
                    [f"{v * MM:.3f}" for v in deviations[part][:3]],
                )
            )
    return rows


def _inputs(run: PoseRun) -> list[InputFile]:
    """poses.yaml and the files that it reads, by their last part."""
    folders: Sequence[tuple[str, Path]] = [
        *((name, folder) for name, folder, _ in run.folders),
        *((outcome.name, folder) for folder, _, outcome in run.held_out),
    ]
    out = []
    for name, folder in folders:
        file = pose_file_path(folder)
        entry = hashed(file.parent, file.name)
        out.append(InputFile(f"{name}/{entry.name}", entry.size, entry.sha256))
    return out
